"""The plate during a session, through the client library: presents a combination, and rests in between."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from .protocol import Design, Friction

if TYPE_CHECKING:
    from hapticd_client import Client, FingerState, PlateState

WALKER = "study-walker"
STATE_WITHIN_S = 2.0
MAX_STEP_S = 0.25  # between two states of one touch
RECENT_S = 0.5  # the speed that a participant is told


@dataclass(slots=True)
class Touch:
    """How the plate was explored since the last `present`: time on the plate, way, and share of time at the limit."""

    touched_s: float = 0.0
    way_mm: float = 0.0
    limited_s: float = 0.0
    recent: deque[tuple[float, float]] = field(default_factory=deque)  # (duration s, way mm), RECENT_S of them

    @property
    def speed_mm_s(self) -> float:
        """The mean speed while the finger was down; 0 before."""
        return self.way_mm / self.touched_s if self.touched_s > 0 else 0.0

    @property
    def recent_mm_s(self) -> float:
        """The speed of late."""
        span_s = sum(step_s for step_s, _ in self.recent)
        return sum(way_mm for _, way_mm in self.recent) / span_s if span_s > 0 else 0.0

    @property
    def limited_frac(self) -> float:
        """The share of the time on the plate in which some target was missed for a mode's limit."""
        return self.limited_s / self.touched_s if self.touched_s > 0 else 0.0

    def add(self, step_s: float, way_mm: float, *, limited: bool) -> None:
        """One step from state to state with the finger down."""
        self.touched_s += step_s
        self.way_mm += way_mm
        self.limited_s += step_s * limited
        self.recent.append((step_s, way_mm))
        while sum(span_s for span_s, _ in self.recent) > RECENT_S:
            self.recent.popleft()


class Stage:
    """One daemon's plate. `present` sets what is felt; call `step` all the time: it follows fingers that land.

    The participant's finger is the one that has been down longest; others are left alone, as two modes serve two
    fingers. Raises the client library's errors.
    """

    def __init__(self, client: Client, design: Design) -> None:
        self._client = client
        self._design = design
        self._friction: Friction | None = None
        self._last: tuple[FingerState, PlateState] | None = None
        self._finger: tuple[int, int | str] | None = None
        self._states = client.states(STATE_WITHIN_S)
        self.touch = Touch()
        self.mark = _marker(client)

    def present(self, friction: Friction) -> None:
        """From now on the finger on the plate feels this, and the virtual one, from its line's start, the opposite."""
        self._friction, self._finger, self._last, self.touch = friction, None, None, Touch()
        _, walker_um = self._design.amplitudes_um(friction)
        self._client.virtual(WALKER, path=self._design.line_mm, speed_mm_s=self._design.line_speed_mm_s)
        self._client.set(WALKER, amplitude_um=walker_um)

    def rest(self) -> None:
        """The plate stands still, and nobody walks on it."""
        self._friction = None
        self._client.release()

    def step(self) -> PlateState:
        """Wait for the next state (the daemon sends ten or more a second), and give a finger that landed its due."""
        state = next(self._states)
        finger = next((finger for finger in state.fingers if not finger.virtual), None)
        if self._friction is None or finger is None:
            self._last = None
            return state
        if self._finger != (state.instance, finger.id):
            own_um, _ = self._design.amplitudes_um(self._friction)
            self._client.set(finger, amplitude_um=own_um)
            self._finger = (state.instance, finger.id)
        self._measure(finger, state)
        return state

    def _measure(self, finger: FingerState, state: PlateState) -> None:
        if self._last is not None:
            before, state_before = self._last
            step_s = (state.t_ns - state_before.t_ns) * 1e-9
            if before.id == finger.id and 0 < step_s < MAX_STEP_S:
                way_mm = math.hypot(finger.x_mm - before.x_mm, finger.y_mm - before.y_mm)
                self.touch.add(step_s, way_mm, limited=state.limited)
        self._last = finger, state


def _marker(client: Client) -> Callable[[str], object]:
    """How this daemon is told of the moments of an experiment; does nothing where it does not take them."""
    marker = getattr(client, "marker", None)
    if marker is None or "marker" not in client.capabilities().get("ops", ()):
        return lambda _: None
    return marker  # type: ignore[no-any-return]
