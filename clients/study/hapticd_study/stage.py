"""Plate of a session, through the client library: presents stimuli, and measures the exploration."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import msgspec

from hapticd_contract.targets import ClientTargets, FingerTarget

from .experiment import Experiment, Levels
from .session import ERRORS

if TYPE_CHECKING:
    from hapticd_client import Client, FingerState, PlateState

STATE_WITHIN_S = 2.0
MAX_STEP_S = 0.25  # between two states of one touch
RECENT_S = 0.5  # window of the displayed speed


@dataclass(slots=True)
class _Mean:
    """Mean over the time in which telemetry has a value; None for none."""

    sum_s: float = 0.0
    span_s: float = 0.0

    def add(self, value: float | None, step_s: float) -> None:
        if value is not None:
            self.sum_s += value * step_s
            self.span_s += step_s

    @property
    def value(self) -> float | None:
        return self.sum_s / self.span_s if self.span_s > 0 else None


@dataclass(slots=True)
class _Touch:
    """Exploration since the last `present`, while the finger was down: time, speed, the share of time in which a mode's
    limit caused a missed target, and what was felt."""

    touched_s: float = 0.0
    path_mm: float = 0.0
    limited: _Mean = field(default_factory=_Mean)
    friction: _Mean = field(default_factory=_Mean)
    pressure: _Mean = field(default_factory=_Mean)
    errors: dict[str, float | None] = field(default_factory=dict)  # ERRORS of the last state,
    t_daemon_ns: int | None = None  # and its instant
    recent: deque[tuple[float, float]] = field(default_factory=deque)  # (duration s, path mm), RECENT_S of them

    @property
    def speed_mm_s(self) -> float:
        """Mean speed; 0 before a touch."""
        return self.path_mm / self.touched_s if self.touched_s > 0 else 0.0

    @property
    def recent_mm_s(self) -> float:
        """Mean speed over the last RECENT_S."""
        span_s = sum(step_s for step_s, _ in self.recent)
        return sum(path_mm for _, path_mm in self.recent) / span_s if span_s > 0 else 0.0

    def add(self, finger: FingerState, step_s: float, path_mm: float, *, limited: bool) -> None:
        """Add one step between two states with the finger down."""
        self.errors = {name: getattr(finger, name) for name in ERRORS}
        self.touched_s += step_s
        self.path_mm += path_mm
        self.limited.add(float(limited), step_s)
        self.friction.add(finger.felt_friction, step_s)
        self.pressure.add(finger.pressure_frac, step_s)
        self.recent.append((step_s, path_mm))
        while sum(span_s for span_s, _ in self.recent) > RECENT_S:
            self.recent.popleft()


class Stage:
    """One daemon's plate. `present` sets the stimulus; call `step` continuously: it sets the targets of landed fingers.

    The participant's first finger is the one that has been down longest; fingers for which the experiment has no target
    get none. Raises the client library's errors.
    """

    def __init__(self, client: Client, experiment: Experiment) -> None:
        self._client = client
        self._experiment = experiment
        self._scene: ClientTargets | None = None
        self._own: dict[int, FingerTarget] = {}
        self._last: tuple[FingerState, PlateState] | None = None
        self._fingers: tuple[int | str, ...] | None = None
        self._states = client.states(STATE_WITHIN_S)
        self.touch = _Touch()
        self.mark: Callable[[str], object] = client.marker  # an instant of the experiment

    def present(self, levels: Levels) -> None:
        """Lay the scene of a trial with these levels; virtual fingers start from their paths' beginning."""
        self._scene = scene = self._experiment.targets(levels)
        self._own = {one.finger: one for one in scene.targets if isinstance(one.finger, int)}
        self._fingers, self._last, self.touch = None, None, _Touch()
        self._client.put(self._with_fingers(()))

    def rest(self) -> None:
        """Stop the plate, and remove virtual fingers, surfaces and effects."""
        self._scene = None
        self._client.release()

    def step(self) -> PlateState:
        """Wait for the next state (ten or more a second), and set the targets of fingers that landed."""
        state = next(self._states)
        fingers = tuple(finger for finger in state.fingers if not finger.virtual)
        if self._scene is None or not fingers:
            self._last = None
            return state
        known = (state.instance, *[finger.id for finger in fingers[: len(self._own)]])
        if known != self._fingers:
            self._client.put(self._with_fingers(known[1:]))
            self._fingers = known
        self._measure(fingers[0], state)
        return state

    def _with_fingers(self, ids: tuple[int | str, ...]) -> ClientTargets:
        """Return the scene with the targets of as many fingers as are down."""
        assert self._scene is not None
        own = [
            msgspec.structs.replace(self._own[place], finger=finger)
            for finger, place in zip(ids, sorted(self._own), strict=False)
        ]
        others = [one for one in self._scene.targets if isinstance(one.finger, str)]
        return msgspec.structs.replace(self._scene, targets=(*own, *others))

    def _measure(self, finger: FingerState, state: PlateState) -> None:
        if self._last is not None:
            before, state_before = self._last
            step_s = (state.t_ns - state_before.t_ns) * 1e-9
            if before.id == finger.id and 0 < step_s < MAX_STEP_S:
                path_mm = math.hypot(finger.x_mm - before.x_mm, finger.y_mm - before.y_mm)
                self.touch.add(finger, step_s, path_mm, limited=state.limited)
        self.touch.t_daemon_ns = state.t_ns
        self._last = finger, state
