"""Plate of a session, through the client library: presents stimuli, and measures the exploration."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from .protocol import Design, FrictionLevel

if TYPE_CHECKING:
    from hapticd_client import Client, FingerState, PlateState

WALKER = "study-walker"
STATE_WITHIN_S = 2.0
MAX_STEP_S = 0.25  # between two states of one touch
RECENT_S = 0.5  # window of the displayed speed


@dataclass(slots=True)
class _Touch:
    """Exploration since the last `present`: time on the plate, distance, and time at a limit."""

    touched_s: float = 0.0
    path_mm: float = 0.0
    limited_s: float = 0.0
    recent: deque[tuple[float, float]] = field(default_factory=deque)  # (duration s, way mm), RECENT_S of them

    @property
    def speed_mm_s(self) -> float:
        """Mean speed while the finger was down; 0 before."""
        return self.path_mm / self.touched_s if self.touched_s > 0 else 0.0

    @property
    def recent_mm_s(self) -> float:
        """Mean speed over the last RECENT_S."""
        span_s = sum(step_s for step_s, _ in self.recent)
        return sum(path_mm for _, path_mm in self.recent) / span_s if span_s > 0 else 0.0

    @property
    def limited_frac(self) -> float:
        """Share of the time on the plate in which a mode's limit caused a missed target."""
        return self.limited_s / self.touched_s if self.touched_s > 0 else 0.0

    def add(self, step_s: float, path_mm: float, *, limited: bool) -> None:
        """Add one step between two states with the finger down."""
        self.touched_s += step_s
        self.path_mm += path_mm
        self.limited_s += step_s * limited
        self.recent.append((step_s, path_mm))
        while sum(span_s for span_s, _ in self.recent) > RECENT_S:
            self.recent.popleft()


class Stage:
    """One daemon's plate. `present` sets the stimulus; call `step` continuously: it sets the target of landed fingers.

    The participant's finger is the one that has been down longest; others get no target, as two modes serve two
    fingers. Raises the client library's errors.
    """

    def __init__(self, client: Client, design: Design) -> None:
        self._client = client
        self._design = design
        self._friction: FrictionLevel | None = None
        self._last: tuple[FingerState, PlateState] | None = None
        self._finger: tuple[int, int | str] | None = None
        self._states = client.states(STATE_WITHIN_S)
        self.touch = _Touch()
        takes_markers = "marker" in client.capabilities().get("ops", ())
        # Marks an instant of the experiment, if the daemon takes markers.
        self.mark: Callable[[str], object] = client.marker if takes_markers else lambda _: None

    def present(self, friction: FrictionLevel) -> None:
        """Give the finger on the plate this stimulus, and the virtual one the opposite, from its line's start."""
        self._friction, self._finger, self._last, self.touch = friction, None, None, _Touch()
        _, virtual_um = self._design.amplitudes_um(friction)
        self._client.virtual(WALKER, path=self._design.line_mm, speed_mm_s=self._design.line_speed_mm_s)
        self._client.set(WALKER, amplitude_um=virtual_um)

    def rest(self) -> None:
        """Stop the plate, and remove the virtual finger."""
        self._friction = None
        self._client.release()

    def step(self) -> PlateState:
        """Wait for the next state (ten or more a second), and set the target of a finger that landed."""
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
                path_mm = math.hypot(finger.x_mm - before.x_mm, finger.y_mm - before.y_mm)
                self.touch.add(step_s, path_mm, limited=state.limited)
        self._last = finger, state
