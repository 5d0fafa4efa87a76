"""Two slippery fingers pass singular positions: their phase turns, where the paper's signs catch them."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.sim import lockstep
from hapticd.sim.fingers.scenarios import REAL
from hapticd.sim.score import settled
from hapticd.sim.settings import Settings, paper_settings


def figures(settings: Settings) -> tuple[float, float, float]:
    """Error of both, the time in which one has less than half of its target, and how far the reference steps."""
    run = lockstep.run("both-slip", settings=settings, seed=1, seconds=4.0)
    counts = settled(run.t_s, run.target_um)
    steps_um = np.abs(np.diff(run.reference_um, axis=0)).max(axis=1)
    dips = (np.abs(run.truth_um) < 0.5 * run.target_um)[counts]
    return run.score.slip_error_um, float(np.mean(dips)), float(np.quantile(steps_um, 0.999))


@pytest.mark.long
def test_free_phases_pass_singular_positions_without_the_catch_of_the_paper_s_signs() -> None:
    ours = Settings(motion=REAL)
    most = (0.55, 0.25, 0.75)  # measured: 0.46, 0.18 and 0.73
    for phases, signs, share in zip(figures(ours), figures(paper_settings(ours)), most, strict=True):
        assert phases < share * signs
