"""The founding paper's control scheme: hold the last position, invert Phi, no sign freedom, one step per report.

Its plain PI loop is the firmware's law "pi". The simulation runs it on the same fingers as hapticd.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ..config import Config
from ..core.pipeline import PipelineSettings
from ..core.solver import solve
from ..core.solver.instant import AskedPlace, FingerTargets, InstantSolver, ModalSolution, clamped
from ..core.touch.fingers import FingerPredictor
from ..daemon.settings import pipeline_settings

ModeRow = tuple[float, ...]  # shapes of all modes at one finger, or real modal amplitudes
ModeRows = tuple[ModeRow, ...]


class SampleHold(FingerPredictor):
    """The last position: the paper's prediction. NaN before the first sample."""

    def __init__(self) -> None:
        super().__init__()
        self._place_mm = math.nan, math.nan

    def start(self, x_mm: float, y_mm: float) -> None:
        """Take the first sample of a touch."""
        self._place_mm = x_mm, y_mm

    def step(self, interval_s: float, x_mm: float, y_mm: float) -> None:  # noqa: ARG002
        """Take the next sample."""
        self._place_mm = x_mm, y_mm

    def position(self, ahead_s: float) -> tuple[float, float]:  # noqa: ARG002
        """Position in mm, at any time after the last sample."""
        return self._place_mm


def paper_pipeline(config: Config) -> PipelineSettings:
    """Return the pipeline's settings under the paper's scheme."""
    return replace(
        pipeline_settings(config),
        make_predictor=SampleHold,
        make_solver=InverseSolver,
        contact_radius_mm=0.0,
        max_knots=1,
    )


def paper_config(config: Config) -> Config:
    """Return the configuration of board and daemon under the paper's scheme: its plain PI law."""
    return replace(config, device=replace(config.device, controller="pi"))


class InverseSolver(InstantSolver):
    """The solver of the paper's scheme: `invert`, which needs nothing but places."""

    def along(self, instants: list[FingerTargets], *_: Any) -> list[ModalSolution]:
        """The solutions at these instants, with real amplitudes."""
        return [self._inverted(at.places) for at in instants]

    def _inverted(self, places: list[AskedPlace]) -> ModalSolution:
        rows = tuple(map(tuple, self._modes.evaluate([place[:2] for place in places]).tolist()))
        modal_um, limited = invert(rows, tuple([target_um for _, _, target_um in places]), self._w_limit_um)
        got_um = [abs(sum([phi * w_um for phi, w_um in zip(row, modal_um, strict=True)])) for row in rows]
        return ModalSolution(places, got_um, tuple(map(complex, modal_um)), limited)


def invert(rows: ModeRows, targets: ModeRow, limits: ModeRow) -> tuple[ModeRow, bool]:
    """Modal amplitudes by the inverse of Phi, scaled into the limits (paper, section IV.B), and `limited`.

    Defined for two fingers on two modes; any other number by `core.solver.solve`, without continuity.
    """
    if len(rows) != 2 or len(limits) != 2:
        found = solve(np.reshape(rows, (len(rows), len(limits))), targets, limits)
        return tuple(found.modal_um.tolist()), found.limited
    (a, b), (c, d) = rows
    determinant = a * d - b * c
    x, y = d * targets[0] - b * targets[1], a * targets[1] - c * targets[0]
    if not (0.0 < abs(determinant) < math.inf and abs(x) < math.inf and abs(y) < math.inf):
        return (0.0, 0.0), False
    excess = max(abs(x) / limits[0], abs(y) / limits[1])
    limited = excess > abs(determinant)
    divisor = math.copysign(excess, determinant) if limited else determinant
    return (clamped(x / divisor, limits[0]), clamped(y / divisor, limits[1])), limited
