"""One rule for the output files of all commands: nothing is overwritten that --force does not name."""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import hapticd
from hapticd.__main__ import COMMANDS, main
from hapticd.__main__ import parser as cli_parser
from hapticd.errors import HapticdError, UsageError
from hapticd.regular_file import opened
from hapticd.tools import outputs

PACKAGE = Path(hapticd.__file__).parent

# A call of each command up to its output, a name with the right suffix, and one with that of another kind of file.
OUTPUTS = [
    (("simulate", "rest", "--json"), "f.json", "f.npz"),
    (("simulate", "rest", "--out"), "f.npz", "f.json"),
    (("simulate", "rest", "--plot"), "f.png", "f.mcap"),
    (("simulate", "rest", "--record"), "f.mcap", "f.png"),
    (("export", "in.mcap", "--plot"), "f.png", "f.mcap"),
    (("export", "in.mcap", "--hdf5"), "f.h5", "f.mcap"),
    (("plate", "map", "--plot"), "f.pdf", "f.npz"),
    (("plate", "map", "--out"), "f.npz", "f.png"),
    (("plate", "--out"), "f.csv", "f.png"),
    (("plate", "--plot"), "f.svg", "f.toml"),
    (("plate", "--json"), "f.json", "f"),
    (("doctor", "latency", "--sim", "--json"), "f.json", "f.csv"),
    (("doctor", "latency", "--sim", "--plot"), "f.PNG", "f.toml"),
    (("bench", "tick", "--json"), "f.json", "f.png"),
    (("firmware", "sweep", "--plot"), "f.png", "f.toml"),
    (("doctor", "--bundle"), "f.tar.gz", "f.tar"),
    (("demo", "--out"), "f.png", "f.json"),
]
IDS = [" ".join(command) for command, _, _ in OUTPUTS]


@pytest.fixture(autouse=True)
def _in_an_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("in.mcap").write_text("a recording", encoding="utf-8")


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one sentence of a call that is refused as a wrong call, before any work."""
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    return printed.err


@pytest.mark.parametrize(("command", "name"), [row[:2] for row in OUTPUTS], ids=IDS)
def test_an_existing_file_is_kept(command: tuple[str, ...], name: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(name).write_text("a day's work", encoding="utf-8")
    assert refused(capsys, *command, name).startswith(f"hapticd: {name}: exists already")
    assert Path(name).read_text(encoding="utf-8") == "a day's work"


@pytest.mark.parametrize("force", [[], ["--force"]], ids=["plain", "forced"])
@pytest.mark.parametrize(("command", "other"), [row[::2] for row in OUTPUTS], ids=IDS)
def test_a_file_of_another_kind_is_never_overwritten(
    command: tuple[str, ...], other: str, force: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    Path(other).write_text("a day's work", encoding="utf-8")
    assert refused(capsys, *command, other, *force).startswith(
        f"hapticd: {other}: has the name of another kind of file"
    )
    assert Path(other).read_text(encoding="utf-8") == "a day's work"


@pytest.mark.parametrize(("command", "name"), [row[:2] for row in OUTPUTS], ids=IDS)
def test_a_folder_that_is_missing_is_refused(
    command: tuple[str, ...], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "its directory is missing" in refused(capsys, *command, f"nowhere/{name}")
    Path(name).mkdir()
    assert "is a directory" in refused(capsys, *command, name)


@pytest.mark.parametrize(
    "command",
    [
        ("export", "same.png", "--plot", "same.png"),
        ("export", "link.png", "--plot", "same.png"),
        ("export", "same.h5", "--hdf5", "same.h5"),
        ("plate", "map", "--modes", "same.npz", "--out", "same.npz"),
        ("plate", "map", "--modes", "./same.npz", "--out", "same.npz"),
    ],
    ids=" ".join,
)
def test_an_input_is_not_overwritten_even_by_force(
    command: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("same.png", "same.h5", "same.npz"):
        Path(name).write_text("a day's work", encoding="utf-8")
    Path("link.png").symlink_to("same.png")
    assert "is an input of this command" in refused(capsys, *command, "--force")
    assert Path(command[-1]).read_text(encoding="utf-8") == "a day's work"


def test_a_forced_output_is_replaced(capsys: pytest.CaptureFixture[str]) -> None:
    Path("map.npz").write_text("old", encoding="utf-8")
    arguments = ("plate", "map", "--finger=-30,20", "--cells", "3", "--out", "map.npz")
    assert main([*arguments, "--force"]) == 0
    capsys.readouterr()
    assert Path("map.npz").read_bytes().startswith(b"PK")


def all_parsers(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from all_parsers(below)


@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "study"])  # that is another distribution's
def test_every_option_that_writes_is_declared_as_an_output(command: str) -> None:
    (commands,) = (action for action in cli_parser(command)._actions if isinstance(action, argparse._SubParsersAction))
    for parser in all_parsers(commands.choices[command]):
        declared = parser.get_default("outputs") or {}
        for action in parser._actions:
            writes = (action.help or "").startswith(("write ", "draw "))
            if writes and action.nargs != 0 and action.dest != "save":  # firmware's, which adds to a file
                assert action.dest in declared, f"{parser.prog} {action.option_strings}"


ELSEWHERE = {
    "compiled/prerequisites.py",  # a folder of its own
    "files/recording/mcap_writer.py",  # recordings take the next free name
    "io/clients/keys.py",  # keys are refused by name
    "io/clients/runtime_dir.py",  # the daemon's lock
    "io/devices/replay.py",  # for tests: no command writes reports
    "io/host/cpu_latency.py",  # a device
    "io/host/journal.py",  # a socket
    "sim/rig/files.py",  # the rig's own folder
    "sim/rig/program.py",  # likewise
    "tools/daemon_process.py",  # its own folder
    "tools/plate_verdict.py",  # its own folder
    "tools/install_service.py",  # its destinations are fixed
    "regular_file.py",  # the one place
    "tools/view/program.py",  # the address, in a folder of its own
}


def is_writing(call: ast.Call) -> bool:
    """Whether it opens a file to write it, in any of Python's ways."""
    of = call.func.value if isinstance(call.func, ast.Attribute) else None
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    if name in ("write_text", "write_bytes"):
        return of is not None and getattr(of, "id", "") != "outputs"
    if name not in ("open", "fdopen"):
        return False
    words = [node.value for node in ast.walk(call) if isinstance(node, ast.Constant)]
    flags = [node.attr for node in ast.walk(call) if isinstance(node, ast.Attribute)]
    return "O_CREAT" in flags or any(re.fullmatch("[wax][bt+]*", word) for word in words if isinstance(word, str))


def writes(path: Path) -> bool:
    text = path.read_text(encoding="utf-8")
    if not re.search(r"write_(text|bytes)|open\(", text):  # most files, which need no parsing
        return False
    calls = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call))
    return any(is_writing(call) for call in calls)


def test_outputs_are_opened_in_one_place() -> None:
    found = {str(path.relative_to(PACKAGE)) for path in PACKAGE.rglob("*.py") if writes(path)}
    assert found <= ELSEWHERE
    assert "regular_file.py" in found


def test_an_output_gets_its_name_when_it_is_whole() -> None:
    Path("f.json").write_text("old", encoding="utf-8")

    def half() -> None:
        with opened(Path("f.json")) as file:
            file.write(b"half")
            raise HapticdError("stopped")

    with pytest.raises(HapticdError, match="stopped"):
        half()
    assert Path("f.json").read_text(encoding="utf-8") == "old"
    assert sorted(path.name for path in Path().iterdir()) == ["f.json", "in.mcap"]


def test_two_outputs_of_one_name_are_refused() -> None:
    with pytest.raises(UsageError, match="named for two outputs"):
        outputs.check([Path("f.json"), Path("./f.json").absolute()])


def test_a_device_is_written_under_any_name(capsys: pytest.CaptureFixture[str]) -> None:
    outputs.check_suffix(Path("/dev/null"), outputs.JSON)
    outputs.check([Path("/dev/null")])
    outputs.write_text("figures", "/dev/null")
    outputs.write_text("figures", "-")
    assert capsys.readouterr().out == "figures"


@pytest.mark.parametrize(
    ("step", "option", "name"), [("modes", "--scan", "modes.npz"), ("friction", "--readings", "friction.png")]
)
def test_a_calibration_step_overwrites_neither_its_input_nor_what_it_did_not_write(
    step: str, option: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = Path(name)
    given.write_text("a day's work", encoding="utf-8")
    assert "is an input" in refused(capsys, "calibrate", step, option, str(given), "--out", ".", "--force")
    given.unlink()
    Path("hapticd.toml").write_text("[plate]\n", encoding="utf-8")
    assert "hapticd.toml: exists already" in refused(capsys, "calibrate", step, "--sim", "--out", ".")
    Path(f"{step}.png").write_text("a day's work", encoding="utf-8")
    assert f"{step}.png: exists already" in refused(capsys, "calibrate", step, "--sim", "--out", ".")


def test_a_recording_that_fails_leaves_the_earlier_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def failing(_scenario: object, path: Path, **_: object) -> None:
        path.write_text("half", encoding="utf-8")
        raise HapticdError("the disk is full")

    monkeypatch.setattr("hapticd.tools.record.simulated.run", failing)
    Path("run.mcap").write_text("a day's work", encoding="utf-8")
    assert main(["simulate", "rest", "--record", "run.mcap", "--force"]) == 1
    assert capsys.readouterr().err == "hapticd: the disk is full\n"
    assert Path("run.mcap").read_text(encoding="utf-8") == "a day's work"
    assert sorted(path.name for path in Path().iterdir()) == ["in.mcap", "run.mcap"]
