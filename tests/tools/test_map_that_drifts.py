"""A plate whose map goes on changing while it is touched: the service follows, and goes back where the plate does."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest
from calibrating import CalibratingSimulation, lifting
from faulty_simulation import FaultySimulation

from hapticd.config.sections import Config, TrackpadConfig
from hapticd.sim.plate.ground_truth import GroundTruth
from hapticd.sim.settings import Settings, in_world
from hapticd.sim.world_errors import MapChange, WorldErrors
from hapticd.values import FloatArray

RAMP_S, BACK_S, END_S = 50.0, 76.0, 124.0  # the map has changed, is as scanned again, the end
STILL = 1  # the finger that asks for 0
SETTINGS = in_world(
    Settings(config=Config(trackpad=TrackpadConfig(correct_while_touched=True))),
    WorldErrors(map_change=MapChange(waves_frac=0.08), seed=3),
)


class DriftingPlate(GroundTruth):
    """`share` of the map's change has happened."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings.plate)
        world = replace(settings.plate.world, map_change=MapChange())
        self._scanned = GroundTruth(replace(settings.plate, world=world))
        self.share = 0.0

    def shapes(self, points_mm: npt.ArrayLike) -> FloatArray:
        scanned = self._scanned.shapes(points_mm)
        shapes: FloatArray = scanned + self.share * (super().shapes(points_mm) - scanned)
        return shapes


class Leaks(NamedTuple):
    """Of the still finger, RMS in um: before there is a verdict, once all has changed, and as the run ends."""

    first: float
    changed: float
    back: float


def leaks(simulation: FaultySimulation) -> Leaks:
    plate = simulation.world.plate = DriftingPlate(SETTINGS)
    found: list[float] = []

    def leak_um(t_from_s: float) -> float:
        seen = simulation.world.recording()
        chosen = (seen.t_s > t_from_s) & np.isfinite(seen.finger_mm[:, STILL, 0])
        moved_um = (plate.shapes(seen.finger_mm[chosen, STILL]) * seen.plate_um[chosen]).sum(axis=1)
        return float(np.sqrt(np.mean(np.abs(moved_um) ** 2)))

    def advanced(done: float) -> None:
        t_s = done * END_S
        if t_s >= 20.0 and not found:
            found.append(leak_um(1.0))
        if t_s >= BACK_S and len(found) == 1:
            found.append(leak_um(RAMP_S + 10.0))
        plate.share = min(t_s / RAMP_S, 1.0) if t_s < BACK_S else 0.0

    simulation.run(END_S, advanced)
    return Leaks(*found, leak_um(END_S - 20.0))


@pytest.mark.long
@pytest.mark.timeout(600)
def test_a_map_that_goes_on_changing_is_followed_and_taken_back_with_the_plate() -> None:
    following = CalibratingSimulation(lifting(SETTINGS, END_S), SETTINGS, 1)
    followed, left = leaks(following), leaks(FaultySimulation(lifting(SETTINGS, END_S), SETTINGS, 1))
    report = following.calibrations[0].task.report()
    assert followed.changed < 0.85 * left.changed
    assert report["taken_back"]  # 24 s after the plate was as scanned again, 48 s at most
    assert followed.back < 1.05 * left.back
