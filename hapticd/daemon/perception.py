"""What a person perceives: the friction that each finger gets, against the friction that was asked for it.

The friction of a contact is the mean over its disc of the friction curve at the reference's amplitude. Beyond the Weber
fraction a difference is felt. The RMS of that amplitude is contact leak or contact slip. Computed for subscribers and
recordings only.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

from ..core.friction import FrictionCurve
from ..core.plate.contact import disc_points
from ..core.plate.mode_shapes import ModeShapes
from ..values import WEBER_FRAC, Perceived, Tick, TouchPoint

log = logging.getLogger("hapticd")

Key = int | str


class Perception:
    """Friction change of each finger in the solve, and the share of time in which it was beyond the Weber fraction.

    `span_ns` is how far a point's end lies behind its beginning.
    """

    def __init__(self, modes: ModeShapes, curve: FrictionCurve, radius_mm: float, span_ns: int) -> None:
        self.modes = modes
        self._curve = curve
        self._disc = disc_points(radius_mm)
        self._span_s = span_ns * 1e-9
        self._t_last_ns = 0
        self._fails = False
        self._changes: dict[Key, float] = {}
        self._spans_ns: dict[Key, tuple[int, int]] = {}  # beyond the Weber fraction, and in all

    def judge(self, tick: Tick, modal_um: Sequence[complex]) -> dict[Key, Perceived]:
        """Return what each finger of a pass perceives under a reference (M,); its share of time is that since it came
        into the solve. A failure costs only that, because the reference was sent: it is logged once."""
        try:
            perceived = self._judged(tick, modal_um)
            self._fails = False
        except Exception:
            if not self._fails:
                log.exception("what fingers perceive is not known until it can be computed again")
            self._fails = True
            return {}
        return perceived

    def _judged(self, tick: Tick, modal_um: Sequence[complex]) -> dict[Key, Perceived]:
        self._count(tick.t_now_ns - self._t_last_ns)
        self._t_last_ns = tick.t_now_ns
        felt = {point.key: self.felt(point, modal_um) for point in tick.points}
        self._changes = {key: change for key, (change, _) in felt.items()}
        self._spans_ns = {key: self._spans_ns.get(key, (0, 0)) for key in felt}
        return {key: Perceived(change, self._weber_frac(key), rms_um) for key, (change, rms_um) in felt.items()}

    def felt(self, point: TouchPoint, modal_um: Sequence[complex]) -> tuple[float, float]:
        """Return the friction of a contact relative to that of its target, minus 1 (below 0 it is more slippery), and
        the RMS amplitude over it."""
        way_mm = math.hypot(point.end_x_mm - point.x_mm, point.end_y_mm - point.y_mm)
        sliding_mm_s = way_mm / self._span_s
        friction = square_um2 = 0.0
        for dx_mm, dy_mm, weight in self._disc:
            w_um = 0j
            for mode_um, shape in zip(modal_um, self.modes.at(point.x_mm + dx_mm, point.y_mm + dy_mm), strict=True):
                w_um += mode_um * shape
            friction += weight * self._curve.friction(abs(w_um), sliding_mm_s)
            square_um2 += weight * abs(w_um) ** 2
        return friction / self._curve.friction(point.target_um, sliding_mm_s) - 1.0, math.sqrt(square_um2)

    def _count(self, span_ns: int) -> None:
        for key, change in self._changes.items():
            beyond_ns, all_ns = self._spans_ns[key]
            self._spans_ns[key] = beyond_ns + span_ns * is_felt(change), all_ns + span_ns

    def _weber_frac(self, key: Key) -> float:
        beyond_ns, all_ns = self._spans_ns[key]
        return beyond_ns / all_ns if all_ns > 0 else float(is_felt(self._changes[key]))


def is_felt(friction_change: float) -> bool:
    """Whether a relative change of friction is beyond the Weber fraction."""
    return abs(friction_change) > WEBER_FRAC
