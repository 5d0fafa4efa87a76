"""`--plate` and `--modes`, on every command that starts a simulated plate."""

from __future__ import annotations

import argparse

import pytest

from hapticd.__main__ import main
from hapticd.__main__ import parser as cli_parser
from hapticd.config.sections import SimConfig
from hapticd.tools import glass, run


def parsed(*words: str) -> argparse.Namespace:
    return cli_parser(words[0]).parse_args(words)


@pytest.mark.parametrize(
    "command",
    [
        ("run", "--sim"),
        ("demo",),
        ("view", "--sim"),
        ("study", "run", "--participant", "P", "--out", "x", "--sim"),
        ("latency", "--sim"),
        ("simulate", "strokes"),
    ],
)
def test_every_command_with_a_simulated_plate_takes_its_name_and_number_of_modes(command: tuple[str, ...]) -> None:
    assert glass.chosen(parsed(*command)) == SimConfig()
    assert glass.chosen(parsed(*command, "--plate", "fingertip")) == SimConfig(plate="fingertip", modes=4)
    assert glass.chosen(parsed(*command, "--modes", "3")) == SimConfig(modes=3)


def test_the_plate_becomes_part_of_the_configuration_that_is_served_and_checked() -> None:
    options = parsed("run", "--sim", "--plate", "fingertip", "--modes", "5")
    assert run.configuration(options).sim == SimConfig(plate="fingertip", modes=5)
    assert run._check_command(options)[-5:] == ["--sim", "--plate", "fingertip", "--modes", "5"]


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("run --modes 5", "--modes: 5 modes cannot be driven on the reference plate: give 2 to 4."),
        ("view --plate fingertip", "--plate, --modes and --wiring name a simulated plate: give --sim as well."),
        ("study run --participant P --out x --modes 4", "give --sim as well."),
        ("demo --modes 9", "--modes: 9 modes cannot be driven on the reference plate: give 2 to 4."),
        ("simulate strokes --plate steel", "--plate: there is no 'steel'"),
    ],
)
def test_a_plate_that_cannot_be_simulated_is_refused(
    command: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(command.split()) == 2
    assert sentence in capsys.readouterr().err
