"""Fakes of plate, participant and clock for a session without a daemon; each state takes 10 ms."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

from hapticd_client import FingerState, PlateState
from hapticd_contract.targets import ClientTargets
from hapticd_study.panel import Screen

STATE_NS = 10_000_000
T_START_NS = 7_000_000_000_001
POLLS = 60  # until a key is pressed


class FakeClient:
    """The part of `hapticd_client.Client` that a study uses, and its clock; keeps targets, markers, releases.

    One finger moves to the right at `speed_mm_s`; another `finger` takes its place, `more` landed later.
    """

    def __init__(self) -> None:
        self.t_ns = T_START_NS
        self.finger: int | None = 1
        self.more: tuple[int, ...] = ()
        self.speed_mm_s = 50.0
        self.limited = False
        self.instance = 1
        self.targets_um: dict[int | str, float] = {}
        self.released: list[dict[int | str, float]] = []
        self.markers: list[str] = []
        self.virtuals: tuple[str, ...] = ()

    def monotonic(self) -> float:
        return self.t_ns * 1e-9

    def time(self) -> float:
        return 1.7e9 + self.t_ns * 1e-9

    def put(self, message: ClientTargets) -> None:
        self.message = message
        self.targets_um = {one.finger: one.amplitude_um or 0.0 for one in message.targets}
        self.virtuals = tuple(one.name for one in message.virtuals)

    def release(self) -> None:
        self.released.append(dict(self.targets_um))
        self.targets_um.clear()
        self.virtuals = ()

    def marker(self, text: str) -> None:
        self.markers.append(text)

    def states(self, timeout_s: float) -> Iterator[PlateState]:
        assert timeout_s > 0
        while True:
            self.t_ns += STATE_NS
            x_mm = self.speed_mm_s * (self.t_ns - T_START_NS) * 1e-9
            places = [(name, 0.0, True) for name in self.virtuals]
            places += [(key, x_mm if key == self.finger else 30.0, False) for key in (self.finger, *self.more) if key]
            fingers = tuple(
                FingerState(
                    key, x, 0.0, x, 0.0, None, None, virtual, felt_friction=0.25, pressure_frac=0.2, bias_jnd=-0.5
                )
                for key, x, virtual in places
            )
            yield PlateState(
                self.instance, self.t_ns, self.t_ns, "ACTIVE", fingers, (0.0, 0.0), self.limited, 10.0, 16.0
            )


class Person:
    """A panel with a participant: `answer` returns the key pressed on a screen after POLLS polls."""

    def __init__(self, answer: Callable[[Screen], str | None]) -> None:
        self._answer = answer
        self._polls = 0
        self.screens: list[Screen] = []
        self.notes: deque[str] = deque(maxlen=200)

    def show(self, screen: Screen) -> None:
        self.screens.append(screen)
        self._polls = 0

    def note(self, text: str) -> None:
        self.notes.append(text)

    def pressed(self) -> str | None:
        self._polls = (self._polls + 1) % POLLS
        return None if self._polls else self._answer(self.screens[-1])
