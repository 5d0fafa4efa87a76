"""The stored results of the shipped plates are those of today's plates, theory and fit."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.sim.plate import stored
from hapticd.sim.plate.glasses import FINGERTIP, GLASSES, REFERENCE, WIDE
from hapticd.sim.plate.ground_truth import DRIVEN_MODES, GroundTruth, PlateSettings
from hapticd.sim.plate.shape_tables import fitted, mode_map
from hapticd.sim.plate.shapes import computed, theory

STALE = "run `python -m hapticd.sim.plate.make_stored`"
PLATES = (REFERENCE, *(pytest.param(plate, marks=pytest.mark.long) for plate in (FINGERTIP, WIDE)))


@pytest.mark.parametrize("plate", GLASSES)
def test_every_scan_of_a_shipped_plate_is_stored(plate: str) -> None:
    truth = GroundTruth(PlateSettings.of(plate))
    for seed in range(stored.SCANS):
        for is_driven in (True, False):
            assert stored.find(GLASSES[plate], *truth.scan(seed, is_driven)) is not None, STALE


@pytest.mark.parametrize("plate", PLATES)
def test_what_is_stored_is_what_theory_and_fit_give(plate: str) -> None:
    by_theory = computed(GLASSES[plate])
    measured = DRIVEN_MODES if plate == REFERENCE else ()
    for name in GLASSES[plate].modes:
        (frequency_hz, shape), (kept_hz, kept) = by_theory[name], theory(name, plate)
        assert kept_hz == pytest.approx(frequency_hz, abs=1e-5), STALE
        assert kept.nodal_lines == shape.nodal_lines
        assert name in measured or np.allclose(kept.coefficients, shape.coefficients, atol=1e-7), STALE
    truth = GroundTruth(PlateSettings.of(plate))
    for is_driven in (True, False)[len(measured) // 2 :]:
        scan = truth.scan(1, is_driven)
        error = mode_map(plate, *scan).shapes - fitted(plate, *scan).shapes
        assert np.sqrt((error**2).mean()) < 3e-6, STALE


def test_another_scan_is_not_stored_and_seeds_repeat_the_scans() -> None:
    coarse, usual = GroundTruth(PlateSettings(map_step_mm=6.0)), GroundTruth()
    assert stored.find(GLASSES[REFERENCE], *coarse.scan(1, is_driven=True)) is None
    assert usual.scan(stored.SCANS + 1, is_driven=True) == usual.scan(1, is_driven=True)
