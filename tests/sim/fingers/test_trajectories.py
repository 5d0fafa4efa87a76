"""Fingers of a file as a scenario: what is played, and one sentence for each mistake in the file."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.__main__ import main
from hapticd.errors import UsageError
from hapticd.sim.fingers import trajectories

SIZE_MM = (137.5, 137.5)
HEADER = "t_s,finger,x_mm,y_mm,target_um\n"
PRESSED = HEADER.strip() + ",pressure_frac"
COMMAS = "t_s,finger,x_mm,y_mm,target_um: add it, with commas between cells and points in numbers."
FINGERS = HEADER + (
    "# the first moves, lifts and lands again; the second rests\n"
    "0.4,1,-40,0,1\n"
    "0.4,2,30,10,0\n"
    "\n"
    "0.8,1,-20,4,\n"
    "0.9,1,,,\n"
    "1.0,1,0,0,0.5\n"
    "1.2,1,10,0,\n"
    "1.2,2,30,10,\n"
)


def written(folder: Path, text: str) -> Path:
    file = folder / "fingers.csv"
    file.write_text(text, encoding="utf-8")
    return file


def test_a_finger_moves_straight_between_lines_and_is_lifted_where_they_are_empty(tmp_path: Path) -> None:
    scenario = trajectories.read(written(tmp_path, FINGERS), SIZE_MM)
    first, second = scenario.build(1, 100.0)
    assert (scenario.name, scenario.seconds) == ("fingers.csv", 1.2)
    assert first.path is not None
    at_s = np.array([0.3, 0.4, 0.6, 0.8, 0.85, 0.95, 1.0, 1.1, 1.2, 1.3])
    x_mm = first.path.position_mm(at_s)[:, 0]
    np.testing.assert_allclose(x_mm, [np.nan, -40, -30, -20, np.nan, np.nan, 0, 5, 10, np.nan])
    np.testing.assert_allclose(first.target_um(np.array([0.3, 0.5, 0.99, 1.0])), [np.nan, 1.0, 1.0, 0.5])
    assert second.target_at_um(1.0) == 0.0


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "does not begin with the header t_s,finger,x_mm,y_mm,target_um"),
        ("t,x,y\n", "does not begin with the header"),
        ("t_s;finger;x_mm;y_mm;target_um\n0,0;1;0,0;0,0;1,0\n", "does not begin with the header " + COMMAS),
        (HEADER, "holds a header and no finger"),
        (HEADER + "0,1,0,0\n", "line 2: has 4 cells"),
        (HEADER + "0,1,a,0,1\n", "line 2: .*x_mm"),
        (HEADER + "inf,1,0,0,1\n", "line 2: .* 3600.0 .*t_s"),
        (HEADER + ",1,0,0,1\n", "line 2: .*t_s"),
        (HEADER + "0,1.5,0,0,1\n", "line 2: .*`int`.*finger"),
        (HEADER + "0,0,0,0,1\n", "line 2: .* 1 .*finger"),
        (HEADER + "0,1,0,70,1\n", "line 2: y_mm is 70: the plate reaches from -68.75 to 68.75 mm"),
        (HEADER + "0,1,nan,0,1\n", "line 2: x_mm is nan: the plate reaches"),
        (HEADER + "0,1,0,,1\n", "line 2: has one of x_mm and y_mm"),
        (HEADER + "0,1,0,0,-1\n", "line 2: .* 0.0 .*target_um"),
        (PRESSED + ",major_mm\n", "does not begin with the header"),
        (PRESSED + "\n0,1,0,0,1,1.5\n", "line 2: .* 1.0 .*pressure_frac"),
        (PRESSED + ",major_mm,minor_mm,angle_rad\n0,1,0,0,1,0.5,12,,0\n", "line 2: has one of major_mm and minor_mm"),
        (HEADER + "# x\n0.2,1,0,0,1\n0.1,1,0,0,1\n", "line 4: finger 1 is at 0.1 s after 0.2 s: sort it"),
        (HEADER + "0.2,1,0,0,1\n0.3,1,,,1\n", "finger 1 has fewer than two positions"),
        (HEADER + "0.2,1,0,0,\n0.3,1,0,0,\n", "finger 1 has no target_um"),
        ("\0\n", "does not begin with the header"),
    ],
)
def test_a_mistake_in_the_file_is_one_sentence_with_its_line(text: str, sentence: str, tmp_path: Path) -> None:
    file = written(tmp_path, text)
    with pytest.raises(UsageError) as refused:
        trajectories.read(file, SIZE_MM)
    assert re.match(f"{re.escape(str(file))}: {sentence}", str(refused.value))


@given(st.lists(st.lists(st.sampled_from(["0", "1", "0.5", "-3", "", "nan", "1e400", "x", '"', "\0"])), max_size=6))
def test_whatever_a_file_holds_it_is_a_scenario_or_a_sentence(rows: list[list[str]]) -> None:
    with TemporaryDirectory() as folder:
        file = written(Path(folder), HEADER + "\n".join(",".join(row) for row in rows))
        with suppress(UsageError):
            assert trajectories.read(file, SIZE_MM).seconds > 0.0


def test_own_fingers_are_played_and_compared_and_all_arrays_are_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = written(tmp_path, FINGERS), tmp_path / "run.npz"
    assert main(["simulate", str(file), "--seconds", "0.7", "--out", str(out)]) == 0
    assert "the paper's scheme leaks" in capsys.readouterr().err
    with np.load(out) as arrays:
        assert arrays["finger_true_mm"][-1, 1].tolist() == [30.0, 10.0]
        assert arrays["paper_truth_um"].shape == arrays["truth_um"].shape
        assert arrays["perfect_truth_um"].shape == (len(arrays["perfect_t_s"]), 2)
        assert {"paper_reference_um", "paper_finger_predicted_mm", "perfect_modal_um"} <= set(arrays.files)
        sticky_um = np.abs(arrays["perfect_truth_um"][-100:, 1])
        assert sticky_um.max() < np.abs(arrays["paper_truth_um"][-400:, 1]).max()


@pytest.mark.parametrize("fingers", [["f.csv"], ["strokes", "--motion", "real"]], ids=["of a file", "a real hand"])
def test_fingers_that_have_a_speed_of_their_own_get_no_other(
    fingers: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", *fingers, "--speed", "50"]) == 2
    assert capsys.readouterr().err.startswith("hapticd: --speed: ")


def test_the_readme_s_example_is_a_file_that_is_read(tmp_path: Path) -> None:
    page = (Path(trajectories.__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```\n(t_s,.*?)```", page, flags=re.DOTALL)
    assert len(trajectories.read(written(tmp_path, example), SIZE_MM).build(1, 100.0)) == 2
