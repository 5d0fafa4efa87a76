"""The window of a run that the demo compares and draws, judged by itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.friction import DEFAULT_FRICTION_CURVE
from ...sim.plate.ground_truth import GroundTruth, PlateSettings
from ...sim.score import Score, felt, score
from ...values import ComplexArray, FloatArray

CONTACT_EVERY = 8  # ticks: 4 ms, in which a finger moves 0.4 mm


@dataclass(frozen=True, slots=True)
class Film:
    """A window of a run; arrays over T control ticks as in `lockstep.Run`."""

    title: str
    plate: PlateSettings
    t_s: FloatArray
    finger_true_mm: FloatArray
    target_um: FloatArray
    plate_um: ComplexArray
    score: Score

    @classmethod
    def between(cls, title: str, plate: PlateSettings, run: Callable[[str], Any], start_s: float, end_s: float) -> Film:
        """Return the window of a run, whose arrays `run` returns by their names."""
        part = slice(*np.searchsorted(run("t_s"), (start_s, end_s)))
        t_s, finger_mm, target_um, truth_um, plate_um, reference_um = (
            run(name)[part] for name in ("t_s", "finger_true_mm", "target_um", "truth_um", "plate_um", "reference_um")
        )
        judged = score(
            *(t_s, finger_mm, target_um, truth_um, plate_um, GroundTruth(plate).shapes),
            limited=np.zeros(len(t_s), dtype=bool),
            every=CONTACT_EVERY,
            reference_um=reference_um,
        )
        return cls(title, plate, t_s, finger_mm, target_um, plate_um, judged)

    def contacts(self, seconds: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return instants of the first `seconds` (T',), then over each contact (T',N) the friction relative to bare
        glass, by the built-in curve, and the friction that was asked."""
        part = slice(None, int(np.searchsorted(self.t_s, self.t_s[0] + seconds)), CONTACT_EVERY)
        _, got = felt(self.finger_true_mm[part], self.plate_um[part], GroundTruth(self.plate).shapes)
        asked = DEFAULT_FRICTION_CURVE.frictions(self.target_um[part], np.zeros_like(got))
        return self.t_s[part], got, asked

    def field_um(self, index: int, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return the plate's amplitude on a grid (Y, X) at one instant."""
        points_mm = np.stack(np.meshgrid(x_mm, y_mm), axis=-1)
        return np.asarray(np.abs(GroundTruth(self.plate).shapes(points_mm) @ self.plate_um[index]))

    @property
    def seconds(self) -> float:
        return float(np.ptp(self.t_s)) if len(self.t_s) else 0.0
