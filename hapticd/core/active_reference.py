"""The reference in force: what it was made for, whether it still holds, and what the plate does by it."""

from __future__ import annotations

import math
from typing import Final

from ..values import SafeDrive, TouchPoint
from .frame import NO_FINGERS, FramePlan, KnotPlanner, Participants, moved_mm
from .phasors import Phasors
from .plate.contact import EllipseForm
from .solver.instant import AskedPlace
from .trajectory.gate import silence

_KEPT: Final = 6  # of references: the one in force at the newest sample is up to three passes old


class PlayedReference:
    """The plate at an instant that has passed: its amplitudes (M,), and for each finger its place with its target, by
    how much more amplitude it needs as it gains, and the form of its contact, where that is known."""

    def __init__(
        self,
        modal_um: Phasors,
        places: list[AskedPlace],
        speed_gains: list[float],
        forms: list[EllipseForm | None] | None = None,
    ) -> None:
        self.modal_um: Final = modal_um
        self.places: Final = places
        self.speed_gains: Final = speed_gains
        self.forms: Final = forms


class ActiveReference:
    """The last reference that was made, and those before it, back to what the plate did at the newest sample."""

    def __init__(self, modes: int, planner: KnotPlanner, tolerance_um: float) -> None:
        self.drive = silence(0, modes)
        self.fingers = NO_FINGERS  # for whom it was made
        self.is_sent = True  # the board has it, or takes it next
        self.points: tuple[TouchPoint, ...] = ()
        self.limited = False
        self._places: list[AskedPlace] = []
        self._t_settled_ns = 0
        self._recent = [self.drive]
        self._planner: Final = planner
        self._tolerance_um: Final = tolerance_um

    @property
    def is_silent(self) -> bool:
        """Whether it ends without any amplitude."""
        return not any(self.drive.knots[-1].modal_um)

    def activate(
        self,
        drive: SafeDrive,
        fingers: Participants,
        places: list[AskedPlace],
        points: tuple[TouchPoint, ...],
        *,
        limited: bool,
    ) -> None:
        """Put another in its place, made for these fingers, who are at `places` at its end."""
        self.drive, self.fingers, self._places, self.is_sent = drive, fingers, places, True
        self.points, self.limited = points, limited
        self._t_settled_ns = settles_ns(drive, self._tolerance_um)
        self._recent = [*self._recent[1 - _KEPT :], drive]

    def has_settled(self, fingers: Participants, t_apply_ns: int) -> bool:
        """Return whether it is for these fingers, and no longer changes: it may hold on."""
        return self.is_sent and t_apply_ns >= self._t_settled_ns and fingers.are(self.fingers)

    def still_holds(self, plan: FramePlan, begin: list[AskedPlace], end: list[AskedPlace], most_knots: int) -> bool:
        """Return whether it, having settled, still holds: from a frame's beginning to its end the fingers stay where
        it was made for."""
        steepness_um_mm = self._planner.steepness_1_mm * sum(abs(w_um) for w_um in self.drive.knots[-1].modal_um)
        for places in (begin, end):
            for (x_mm, y_mm, target_um), (was_x_mm, was_y_mm, was_um) in zip(places, self._places, strict=True):
                moved_um = steepness_um_mm * math.hypot(x_mm - was_x_mm, y_mm - was_y_mm)
                if target_um != was_um or not moved_um <= self._tolerance_um:
                    return False
        if steepness_um_mm > 0.0 and not self._planner.has_surfaces:
            return True  # while the plate is silent, fingers may move far: over stripes, to the same target
        ways_mm = moved_mm(begin, end)
        pieces, _, edges_ns = self._planner.pieces(plan.fingers.keys, ways_mm, plan.t_ns, plan.span_ns, most_knots)
        return pieces == 1 and not edges_ns

    def points_at(self, places: list[AskedPlace]) -> tuple[TouchPoint, ...]:
        """Return its fingers' points, at their present places."""
        return tuple(map(_moved, self.points, places))

    def um(self, t_ns: int) -> Phasors:
        """Return its amplitudes at an instant: another continues them."""
        return interpolated_um(self.drive, t_ns)

    def past_um(self, t_ns: int) -> Phasors:
        """Return the amplitudes of the reference that was in force at `t_ns`, there."""
        active = self._recent[0]
        for drive in self._recent:
            if drive.t_apply_ns <= t_ns:
                active = drive
        return interpolated_um(active, t_ns)


def _moved(point: TouchPoint, now: AskedPlace) -> TouchPoint:
    """A finger's point at its present place, for a reference that stays in force."""
    x_mm, y_mm, _ = now
    return point._replace(x_mm=x_mm, y_mm=y_mm, end_x_mm=x_mm, end_y_mm=y_mm)


def interpolated_um(drive: SafeDrive, t_ns: int) -> Phasors:
    """Amplitudes of a polyline at `t_ns` as the board plays it: a new polyline continues them."""
    since_ns = t_ns - drive.t_apply_ns
    before_ns, before_um = drive.knots[0]
    for after_ns, after_um in drive.knots[1:]:
        if since_ns < after_ns:
            share = max((since_ns - before_ns) / (after_ns - before_ns), 0.0)
            return tuple([before_um[n] + (after_um[n] - before_um[n]) * share for n in range(len(before_um))])
        before_ns, before_um = after_ns, after_um
    return before_um


def settles_ns(drive: SafeDrive, tolerance_um: float) -> int:
    """Time from which a polyline is within the tolerance of its last knot: its start or its end."""
    last_ns, last_um = drive.knots[-1]
    for _, modal_um in drive.knots[:-1]:
        for mode in range(len(last_um)):
            if not abs(modal_um[mode] - last_um[mode]) <= tolerance_um:
                return drive.t_apply_ns + last_ns
    return drive.t_apply_ns
