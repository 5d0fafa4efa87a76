"""A Linux input device without a kernel, for tests."""

from __future__ import annotations

import os
from pathlib import Path

from input_events import packed

from hapticd.io.devices.input_nodes import Axis, InputNode
from hapticd.wire.trackpad.evdev import ORIENTATION, POSITION_X, POSITION_Y, PRESSURE, SLOT, TRACKING_ID

AXES = {
    SLOT: Axis(0, 0, 9, 0),
    TRACKING_ID: Axis(0, 0, 65535, 0),
    POSITION_X: Axis(0, 0, 4000, 10),
    POSITION_Y: Axis(0, 0, 4000, 20),
    PRESSURE: Axis(0, 0, 255, 0),
    ORIENTATION: Axis(0, 0, 90, 0),
}


class FakeNode(InputNode):
    """A node whose events come from a pipe; `held` are the contacts that the kernel says are there, by slot."""

    def __init__(self, axes: dict[int, Axis] | None = None, name: str = "screen") -> None:
        self.path = Path("/dev/input/event7")
        self.fd, self._end = os.pipe2(os.O_NONBLOCK)
        self.axes = AXES if axes is None else axes
        self.held: dict[int, dict[int, int]] = {}
        self.claims = 0
        self._name = name

    @property
    def name(self) -> str:
        return self._name

    def axis(self, code: int) -> Axis | None:
        return self.axes.get(code)

    def claim(self) -> None:
        self.claims += 1

    def slots(self, count: int) -> dict[int, list[int]]:
        absent = {TRACKING_ID: -1}
        return {
            code: [self.held.get(slot, absent).get(code, 0) for slot in range(count)]
            for code in (TRACKING_ID, POSITION_X, POSITION_Y)
        }

    def close(self) -> None:
        os.close(self.fd)

    def say(self, *events: tuple[int, int, int], t_ns: int = 0) -> None:
        os.write(self._end, packed(t_ns, *events))

    def unplug(self) -> None:
        os.close(self._end)
