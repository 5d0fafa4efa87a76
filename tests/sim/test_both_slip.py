"""Two slippery fingers pass singular positions: their phase turns, where signs alone would catch them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hapticd.sim import lockstep
from hapticd.sim.fingers.scenarios import REAL
from hapticd.sim.score import settled
from hapticd.sim.settings import Settings


def figures(settings: Settings) -> tuple[float, float, float]:
    """Error of both, the time in which one has less than half of its target, and how far the reference steps."""
    run = lockstep.run("both-slip", settings=settings, seed=1, seconds=4.0)
    counts = settled(run.t_s, run.target_um)
    steps_um = np.abs(np.diff(run.reference_um, axis=0)).max(axis=1)
    dips = (np.abs(run.truth_um) < 0.5 * run.target_um)[counts]
    return run.score.slip_error_um, float(np.mean(dips)), float(np.quantile(steps_um, 0.999))


@pytest.mark.long
def test_free_phases_pass_singular_positions_without_the_catch_of_signs_alone() -> None:
    ours = Settings(motion=REAL)
    config = replace(ours.config, solver=replace(ours.config.solver, phase_rotation=False))
    signs_alone = replace(ours, config=config)
    for phases, signs in zip(figures(ours), figures(signs_alone), strict=True):
        assert phases < signs
