"""Contacts of another size than is believed: with the pad's ellipses the plate is driven for the true ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hapticd.config.sections import Config, SolverConfig
from hapticd.sim.fingers.fingertip import Fingertip
from hapticd.sim.fingers.pad_ellipse import calibrated
from hapticd.sim.lockstep import Run, run
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.score import rms
from hapticd.sim.settings import Settings

RADIUS_MM = 6.0


def strokes(config: Config) -> Run:
    plate = PlateSettings.of("fingertip")
    settings = Settings(plate=plate, fingertip=Fingertip(RADIUS_MM, RADIUS_MM), config=config)
    return run("strokes", settings=settings, seed=1, seconds=1.5)


def test_reported_discs_of_6_mm_are_driven_as_a_known_radius_not_as_5_mm() -> None:
    known = strokes(Config(solver=replace(SolverConfig(), contact_radius_mm=RADIUS_MM)))
    believed, reported = strokes(Config()), strokes(calibrated(Config()))
    off_um, believed_off_um = (rms(np.subtract(one.reference_um, known.reference_um)) for one in (reported, believed))
    assert believed_off_um > 0.2
    assert off_um < 0.3 * believed_off_um
    assert reported.score.contact_leak_um < believed.score.contact_leak_um
    assert reported.score.contact_leak_um < 1.05 * known.score.contact_leak_um
