"""`--scenario` of the commands that touch a simulated plate in real time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from hapticd.__main__ import parser as cli_parser
from hapticd.config.sections import SimConfig
from hapticd.errors import UsageError
from hapticd.sim.fingers import trajectories
from hapticd.sim.fingers.trajectories import MOST_IN_REAL_TIME
from hapticd.tools import run
from hapticd.tools.view import program as view_program

HEADER = "t_s,finger,x_mm,y_mm,target_um\n"
SIZE_MM = (137.5, 137.5)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.csv"
    path.write_text(HEADER + "0.5,1,-40,0,1\n1.5,1,-20,0,\n", encoding="utf-8")
    return path


def served(*words: str) -> SimConfig:
    return run._configuration(cli_parser("run").parse_args(["run", *words])).sim


def test_the_service_and_the_page_take_a_scenario_or_fingers_of_a_file(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(file.parent)
    assert served("--sim") == SimConfig()
    assert served("--sim", "--scenario", "hands") == SimConfig(scenario="hands")
    assert served("--sim", "--scenario", "mine.csv") == SimConfig(scenario=str(file))
    shown = view_program._simulated(cli_parser("view").parse_args(["view", "--sim", "--scenario", "mine.csv"]))
    assert shown.fingers_file == str(file)


def test_a_configuration_s_file_gives_way_to_a_scenario(file: Path) -> None:
    config = file.with_suffix(".toml")
    config.write_text("[sim]\nscenario = 'mine.csv'\n", encoding="utf-8")
    assert served("--config", str(config)).fingers_file == str(file)
    assert served("--config", str(config), "--scenario", "rest") == SimConfig(scenario="rest")


def test_the_check_of_a_reload_has_the_same_fingers(file: Path) -> None:
    options = cli_parser("run").parse_args(["run", "--sim", "--scenario", str(file)])
    assert run._check_command(options)[-3:] == ["--sim", "--scenario", str(file)]


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("view --scenario rest", "--scenario needs a simulated plate: give --sim as well."),
        ("run --sim --scenario dance", "--scenario: there is no 'dance': choose one of strokes,"),
        ("run --sim --scenario none.csv", "none.csv: cannot be read (No such file or directory)"),
    ],
)
def test_fingers_that_cannot_be_simulated_are_refused(command: str, sentence: str, refused: Callable[..., str]) -> None:
    assert sentence in refused(*command.split())


def test_in_real_time_a_user_s_own_fingers_have_room_on_the_pad(file: Path) -> None:
    def written(fingers: int) -> Path:
        lines = [f"{t_s},{n},{5 * n - 40},0,1\n" for n in range(1, fingers + 1) for t_s in (0.5, 1.0)]
        file.write_text(HEADER + "".join(lines), encoding="utf-8")
        return file

    assert len(trajectories.read_repeated(written(MOST_IN_REAL_TIME), SIZE_MM)) == MOST_IN_REAL_TIME
    with pytest.raises(UsageError, match=f"has {MOST_IN_REAL_TIME + 1} fingers: in real time at most"):
        trajectories.read_repeated(written(MOST_IN_REAL_TIME + 1), SIZE_MM)
