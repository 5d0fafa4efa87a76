"""A run's figures, its table and its file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from hapticd.errors import HapticdError
from hapticd.sim import lockstep, report
from hapticd.sim.lockstep import Run
from hapticd.sim.settings import paper_settings


@pytest.fixture(scope="module")
def circles() -> Run:
    return lockstep.run("circles", seed=2, seconds=2.0)


@pytest.fixture(scope="module")
def result(circles: Run) -> dict[str, object]:
    return report.figures(circles, report.compare(circles))


def test_figures_compare_the_run_with_the_papers_scheme_and_perfect_knowledge(
    circles: Run, result: dict[str, dict[str, float]]
) -> None:
    paper = lockstep.run("circles", settings=paper_settings(circles.settings), seed=2, seconds=2.0)

    assert result["hapticd"]["leak_um"] == circles.score.leak_um
    assert result["paper"]["leak_um"] == paper.score.leak_um
    assert result["leak_ratio"] == pytest.approx(paper.score.leak_um / circles.score.leak_um)
    assert result["perfect"]["leak_um"] < result["hapticd"]["leak_um"] < result["paper"]["leak_um"]
    assert (result["scenario"], result["seed"], result["seconds"]) == ("circles", 2, 2.0)
    assert result["status"] == circles.status


# --- the step response, on steps that are known -------------------------------------------------------------------

T_S = (np.arange(4000) + 1) / 2000.0


def first_order(tau_s: float, final_um: complex, delay_s: float = 0.0) -> np.ndarray:
    since_s = np.maximum(T_S - 1.0 - delay_s, 0.0)
    return final_um * (1.0 - np.exp(-since_s / tau_s))


@pytest.mark.parametrize(("final_um", "delay_s"), [(1.0, 0.0), (-0.25, 0.006)])
def test_settling_counts_from_one_per_cent_whatever_delay_and_sign(final_um: float, delay_s: float) -> None:
    result = report.step_response(T_S, first_order(0.01, final_um, delay_s), t_step_s=1.0)
    assert result["final_um"] == pytest.approx(final_um)
    assert result["settling_ms"] == pytest.approx(0.01 * math.log(50.0) * 1e3, abs=1.0)
    assert result["overshoot_frac"] == pytest.approx(0.0, abs=1e-9)


# --- the file -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["circles.npz", "circles"])
def test_the_file_holds_the_same_arrays_under_the_given_name(circles: Run, tmp_path: Path, name: str) -> None:
    report.save(circles, tmp_path / name)

    assert [path.name for path in tmp_path.iterdir()] == [name]
    with np.load(tmp_path / name) as file:
        assert sorted(file.files) == sorted(report.ARRAYS)
        for array in report.ARRAYS:
            np.testing.assert_array_equal(file[array], getattr(circles, array))
            assert file[array].dtype == getattr(circles, array).dtype


def test_a_file_that_cannot_be_written_is_a_sentence(circles: Run, tmp_path: Path) -> None:
    with pytest.raises(HapticdError, match=r"circles.npz: cannot be written \(No such file or directory\)"):
        report.save(circles, tmp_path / "nowhere" / "circles.npz")
