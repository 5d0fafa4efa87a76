"""The command line: output, errors with their exit codes, and an example in every help."""

from __future__ import annotations

import argparse
import json
import logging
import re
import signal
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from hapticd import __version__
from hapticd.__main__ import COMMANDS, GROUPS, main
from hapticd.__main__ import parser as cli_parser
from hapticd.config import loader as config
from hapticd.tools.demo import program as demo


@pytest.fixture(autouse=True)
def _the_process_is_left_as_it_was() -> Iterator[None]:
    root = logging.getLogger()
    handlers, level, on_sigterm = root.handlers[:], root.level, signal.getsignal(signal.SIGTERM)
    yield
    root.handlers[:] = handlers
    root.setLevel(level)
    signal.signal(signal.SIGTERM, on_sigterm)


def outcome(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command."""
    try:
        code = main(arguments)
    except SystemExit as left:
        code = int(left.code or 0)
    output = capsys.readouterr()
    return code, output.out, output.err


def with_subcommands(name: str, parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Yield a command's parser with its full name, and those of its subcommands."""
    yield name, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below, one in action.choices.items():
                yield from with_subcommands(f"{name} {below}", one)


def test_help_groups_at_most_eighteen_commands(capsys: pytest.CaptureFixture[str]) -> None:
    _, output, _ = outcome(capsys, "--help")
    places = [output.index(f"\n  {heading}:\n    {first} ") for first, heading in GROUPS.items()]
    assert places == sorted(places)
    assert len(COMMANDS) <= 18


def test_at_most_ninety_long_options_are_shown() -> None:
    own = [name for name in COMMANDS if name != "study"]  # a distribution of its own
    shown = {
        option
        for _, parser in with_subcommands("hapticd", cli_parser(*own))
        for action in parser._actions
        for option in action.option_strings
        if option.startswith("--") and option != "--help"
    }
    assert len(shown) <= 90


def test_the_version_is_the_package_s(capsys: pytest.CaptureFixture[str]) -> None:
    code, output, complaint = outcome(capsys, "--version")
    assert (code, complaint) == (0, "")
    assert re.fullmatch(rf"hapticd {re.escape(__version__)}( \(commit [0-9a-f]{{7,}}(-dirty)?\))?\n", output)


def test_the_printed_configuration_is_a_file_that_means_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = tmp_path / "given.toml"
    given.write_text("[trackpad]\nmatrix = [0, -1, 1, 0]\n[limits]\nw_limit_um = [3.0, 2.5]\n", encoding="utf-8")
    code, output, _ = outcome(capsys, "run", "--config", str(given), "--print-config")
    assert code == 0
    table = tomllib.loads(output)
    assert table["trackpad"]["matrix"] == [0, -1, 1, 0]
    assert table["limits"]["w_limit_um"] == [3.0, 2.5]
    assert table["device"]["port"] == "sim"
    assert config.from_table(table, where="printed", folder=tmp_path) == config.load(given)


def test_a_world_is_drawn_or_comes_from_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    world, arguments = tmp_path / "world.json", ("simulate", "rest", "--seconds", "0.1", "--alone", "--json", "-")
    _, drawn, _ = outcome(capsys, *arguments, "--world", "mild", "--seed", "3")
    world.write_text(json.dumps(json.loads(drawn)["world"]))
    _, read, _ = outcome(capsys, *arguments, "--world", str(world), "--seed", "3")
    assert json.loads(read) == json.loads(drawn)
    assert outcome(capsys, *arguments, "--world", "ideal")[1] == outcome(capsys, *arguments)[1]
    code, _, complaint = outcome(capsys, *arguments, "--world", "moon")
    assert code == 2
    assert "ideal, mild, laboratory, worst, or a JSON file" in complaint
    world.write_text("{")
    code, _, complaint = outcome(capsys, *arguments, "--world", str(world))
    assert code == 2
    assert complaint.count("\n") == 1


def test_the_service_imports_no_other_command() -> None:
    program = "import sys; from hapticd.__main__ import parser; parser('run'); print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    assert "hapticd.tools.run" in loaded
    others = {command.module for name, command in COMMANDS.items() if name != "run"}
    assert not {f"hapticd.{module}" for module in others} & set(loaded)
    assert not any(name.startswith(("hapticd.sim", "numpy")) for name in loaded)


SIMULATE = ("simulate", "rest", "--seconds", "0.2", "--alone", "--json")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ((*SIMULATE, "/dev/full"), "/dev/full: cannot be written (No space left on device): choose another place."),
        ((*SIMULATE, "-"), "standard output: No space left on device"),
        (("run", "--print-config"), "standard output: No space left on device"),
    ],
)
def test_a_full_disk_is_reported_with_its_file(command: tuple[str, ...], sentence: str) -> None:
    with open("/dev/full", "w") as full:
        call = [sys.executable, "-m", "hapticd", *command]
        ended = subprocess.run(call, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert ended.returncode == 1
    assert ended.stderr.splitlines()[-1] == f"hapticd: {sentence}"
    assert "Traceback" not in ended.stderr


def test_a_demo_without_matplotlib_says_so_at_its_start_and_goes_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    played: list[Path | None] = []
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setattr(demo, "_play", lambda _options, out: played.append(out))
    code, output, _ = outcome(capsys, "demo")
    assert (code, played) == (0, [None])
    assert output.startswith(f"without a picture: A picture needs matplotlib: run `{sys.executable} -m pip install ")
    assert outcome(capsys, "demo", "--out", "no-picture-yet.png")[0] == 1  # it was asked for
    assert len(played) == 1
