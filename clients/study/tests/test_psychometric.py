"""Psychometric functions against known ones."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import pytest

from hapticd_study.psychometric import fit

LEVELS = np.linspace(0.0, 1.0, 9)
EACH = 200


def counted(threshold: float, spread: float, guess_frac: float) -> list[tuple[float, bool]]:
    """Levels with as many right answers as the function gives, to the nearest one."""
    curve = NormalDist(threshold, spread)
    pairs = [(x, guess_frac + (1.0 - guess_frac) * curve.cdf(x)) for x in LEVELS.tolist()]
    return [(x, trial < round(EACH * share)) for x, share in pairs for trial in range(EACH)]


@pytest.mark.parametrize("guess_frac", [0.0, 0.5, 1 / 3])
@pytest.mark.parametrize(("threshold", "spread"), [(0.5, 0.15), (0.3, 0.25)])
def test_a_function_is_found_from_its_own_shares_and_mirrored(
    threshold: float, spread: float, guess_frac: float
) -> None:
    track = counted(threshold, spread, guess_frac)
    curve, mirrored = fit(track, guess_frac), fit([(-level, is_right) for level, is_right in track], guess_frac)
    assert curve is not None
    assert mirrored is not None
    assert curve.threshold == pytest.approx(threshold, abs=0.03)
    assert curve.spread == pytest.approx(spread, rel=0.25)
    low, high = curve.threshold_interval
    assert low < threshold < high < low + 0.25
    assert curve.is_bounded
    assert (mirrored.threshold, mirrored.spread) == pytest.approx((-curve.threshold, curve.spread))
    assert mirrored.threshold_interval == pytest.approx((-high, -low))


def test_levels_that_do_not_reach_the_threshold_are_said_and_one_level_is_no_curve() -> None:
    assert fit([(0.5, True)] * 20, 0.5) is None
    curve = fit([(float(level), True) for level in LEVELS for _ in range(20)], 0.5)
    assert curve is not None
    assert not curve.is_bounded
