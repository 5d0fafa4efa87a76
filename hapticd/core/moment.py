"""The plate at one instant: where the fingers are, and the modal amplitudes that give each what it should feel.

Amplitudes are plain floats while one finger slips, or none: friction knows |w_i| only, and a sign is all the phase
that they need. From two slipping fingers on a sign is not enough: where the best pattern of signs changes, some finger
would be carried through 0, so the phase between fingers turns instead (`core.solver_phase`) and amplitudes are complex,
until the plate has been silent.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from ..values import SafeDrive, TouchPoint
from .knots import SHORTEST_NS, Row
from .modes import ModeShapes
from .solver import solve_fast
from .solver_phase import solve_phased_fast

Key = int | str  # a finger's id, or a virtual finger's name
Place = tuple[float, float, float]  # x_mm, y_mm and target_um: where a finger is, and what it should feel there

TURN_RAD_NS: Final = (
    50e-9  # how fast the phase between fingers turns; faster helps no finger, and costs the plate steps
)


class Moment(NamedTuple):
    """The plate at one instant: the fingers' places, the mode shapes there, and the amplitudes that serve them."""

    places: list[Place]
    phi: tuple[tuple[float, ...], ...]
    modal_um: Row
    limited: bool


class MomentSolver:
    """Places to moments, for one plate. `fade`: see `_faded`; `phase_rotation`: whether phases may turn."""

    def __init__(
        self,
        modes: ModeShapes,
        w_limit_um: tuple[float, ...],
        *,
        policy: str,
        effort: float,
        fade: float,
        phase_rotation: bool,
    ) -> None:
        self._at = modes.at
        self._w_limit_um = w_limit_um
        self._policy = policy
        self._effort = effort
        self._fade = fade
        self._rotates = phase_rotation and policy == "keep_zero"

    def solve(self, places: list[Place], previous_um: Row, since_ns: int) -> Moment:
        """The moment with these places; `previous_um` (M,) is what the plate does `since_ns` before it."""
        at = self._at
        rows: list[tuple[float, ...]] = []
        wanted_um: list[float] = []
        for x_mm, y_mm, target_um in places:
            rows.append(at(x_mm, y_mm))
            wanted_um.append(target_um)
        phi, targets_um = tuple(rows), tuple(wanted_um)
        modal_um: Row
        if self._rotates and (targets_um.count(0.0) + 2 <= len(targets_um) or type(previous_um[0]) is complex):
            turn_rad = TURN_RAD_NS * max(since_ns, SHORTEST_NS)
            previous_um = tuple(map(complex, previous_um))
            modal_um, limited = solve_phased_fast(phi, targets_um, self._w_limit_um, previous_um, turn_rad)
        else:
            modal_um, limited = solve_fast(
                phi,
                targets_um,
                self._w_limit_um,
                previous_um,  # type: ignore[arg-type]  # floats: no phase turns
                self._policy,
                self._effort,
            )
        if limited and self._fade > 0.0:
            modal_um = _faded(phi, targets_um, modal_um, self._fade)
        return Moment(places, phi, modal_um, limited)


def points(keys: Sequence[Key], first: Moment, last: Moment) -> tuple[TouchPoint, ...]:
    """The fingers at a frame's first knot, with the amplitude that the solved modes give each there."""
    told = []
    for key, (x_mm, y_mm, target_um), (end_x_mm, end_y_mm, _), row in zip(
        keys, first.places, last.places, first.phi, strict=True
    ):
        achieved_um = _amplitude_um(row, first.modal_um)
        told.append(TouchPoint(key, x_mm, y_mm, target_um, achieved_um, end_x_mm, end_y_mm))
    return tuple(told)


def moved(point: TouchPoint, now: Place) -> TouchPoint:
    """A finger that moved while the reference stood: by less than matters, or any way while all is still."""
    x_mm, y_mm, _ = now
    return point._replace(x_mm=x_mm, y_mm=y_mm, end_x_mm=x_mm, end_y_mm=y_mm)


def interpolated_um(drive: SafeDrive, t_ns: int) -> Row:
    """A polyline at `t_ns` as the board plays it: what a new one continues."""
    since_ns = t_ns - drive.t_apply_ns
    before_ns, before_um = drive.knots[0]
    for after_ns, after_um in drive.knots[1:]:
        if since_ns < after_ns:
            share = max((since_ns - before_ns) / (after_ns - before_ns), 0.0)
            return tuple([a + (b - a) * share for a, b in zip(before_um, after_um, strict=True)])
        before_ns, before_um = after_ns, after_um
    return before_um


def settles_ns(drive: SafeDrive, tolerance_um: float) -> int:
    """From when on a polyline is within the tolerance of its last knot: at once, or when it gets there."""
    last_ns, last_um = drive.knots[-1]
    for _, modal_um in drive.knots:
        for w_um, end_um in zip(modal_um, last_um, strict=True):
            if not abs(w_um - end_um) <= tolerance_um:
                return drive.t_apply_ns + last_ns
    return drive.t_apply_ns


def _faded(rows: Sequence[tuple[float, ...]], targets_um: Sequence[float], modal_um: Row, fade: float) -> Row:
    """Less amplitude where the limit leaves a slippery finger only a share of its target: that share to `fade`.

    Near a singular position the slippery finger gets next to nothing from modes at their limits, and the sticky one
    pays for it: what it feels of a position's error grows with the amplitude. All modes are scaled together, so the
    zero stays; where targets are met nothing changes.
    """
    if 0.0 not in targets_um:
        return modal_um
    share = 1.0
    for finger, target_um in enumerate(targets_um):
        if target_um > 0.0:
            share = min(share, _amplitude_um(rows[finger], modal_um) / target_um)
    scale = share**fade
    return tuple([w_um * scale for w_um in modal_um])


def _amplitude_um(row: Sequence[float], modal_um: Row) -> float:
    """What a finger gets of the modes: |w_i|."""
    w_um: complex = 0.0
    for mode, phi in enumerate(row):
        w_um += phi * modal_um[mode]
    return abs(w_um)
