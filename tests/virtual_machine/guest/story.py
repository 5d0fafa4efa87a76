"""One daemon, two fingers, and a pad that comes, goes and changes from Bluetooth to the cable: step by step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import msgspec
from bluetooth import BluetoothPad
from cable import CablePad
from daemon import Daemon
from hand import Hand
from kernel import wait_for
from plate import MOVES_UM, RESTS_UM, is_as_asked, measured_um, wait_state

from hapticd.wire.trackpad import PADS
from hapticd_client import PlateState

LEFT, RIGHT, SLID = (-824, 275), (1317, -386), (700, 600)  # raw, y away from the user
PAD = PADS["mt2-bt"].geometry
SLID_MM = (SLID[0] - PAD.centre_raw[0]) / PAD.units_per_mm[0]
BLUETOOTH_IDS = 0x004C, 0x0265
SHORT_MOUSE_REPORT = bytes.fromhex("02 00 01 00")  # what a pad says that has lost the enable


class Story:
    """What the steps share. `steps` gives them in their order; each returns what it saw."""

    def __init__(self, cable: CablePad) -> None:
        self.daemon = Daemon()
        self.client = self.daemon.client()
        self._cable = cable
        self._pad: BluetoothPad | CablePad = cable
        self._moved_um = 0.0

    def steps(self) -> Iterator[tuple[str, Callable[[], dict[str, Any]]]]:
        yield "daemon-bluetooth", self._connect
        yield "daemon-mouse-mode", self._mouse_mode
        yield "daemon-unplugged", self._unplug
        yield "daemon-replugged", self._connect
        yield "daemon-cable", self._change_to_cable
        yield "daemon-cable-pulled", self._unplug
        yield "daemon-cable-back", self._plug
        yield "daemon-ended", self._end

    def _touch(self) -> dict[str, Any]:
        """Two fingers land, are given opposite targets, and one slides."""
        self._hand = Hand(self._pad, {1: LEFT, 2: RIGHT})
        landed = wait_state(self.client, "two fingers", lambda state: len(state.fingers) == 2)
        driven = wait_state(self.client, "a plate that is driven and moves", self._is_driven)
        self._hand.slide(1, SLID, frames=60)
        slid = wait_state(self.client, "the slide's end", _has_slid)
        return self._saw(landed=landed, driven=driven, slid=slid) | {"plate_um": self._moved_um}

    def _is_driven(self, state: PlateState) -> bool:
        if not is_as_asked(self.client, state):
            return False
        self._moved_um = measured_um(self.client)
        return any(state.modal_um) and self._moved_um > MOVES_UM

    def _mouse_mode(self) -> dict[str, Any]:
        """The pad forgets the enable."""
        assert isinstance(self._pad, BluetoothPad)
        before = len(self._pad.features)
        self._hand.lift()
        self._pad.send(SHORT_MOUSE_REPORT)
        wait_for("another enable", lambda: len(self._pad.features) > before)
        self._hand = Hand(self._pad, {1: LEFT, 2: RIGHT})
        landed = wait_state(self.client, "two fingers", lambda state: len(state.fingers) == 2)
        return self._saw(landed=landed) | _features(self._pad.features[before:])

    def _unplug(self) -> dict[str, Any]:
        """Under the fingers: the pad's last word is that they are down."""
        self._hand.freeze()
        self._pad.unplug()
        quiet = wait_state(self.client, "a quiet plate", lambda s: not s.fingers and not any(s.modal_um))
        wait_for("a plate at rest", lambda: measured_um(self.client) < RESTS_UM)
        return self._saw(quiet=quiet)

    def _connect(self) -> dict[str, Any]:
        self._pad = BluetoothPad(*BLUETOOTH_IDS)
        wait_for("two enables, the driver's and the daemon's", lambda: len(self._pad.features) >= 2)
        return self._touch() | _features(self._pad.features)

    def _change_to_cable(self) -> dict[str, Any]:
        """The user plugs the cable into a pad that was on Bluetooth, under the fingers."""
        self._unplug()
        self._pad = self._cable
        return self._plug()

    def _plug(self) -> dict[str, Any]:
        self._cable.features.clear()
        self._cable.plug()
        wait_for("two enables, the driver's and the daemon's", lambda: len(self._cable.collect()) >= 2)
        return self._touch() | _features(self._cable.features)

    def _end(self) -> dict[str, Any]:
        self._hand.lift()
        self.client.close()
        exit_code = self.daemon.end()
        self._pad.unplug()
        return {"exit": exit_code, "log": self.daemon.lines()}

    def _saw(self, **states: PlateState) -> dict[str, Any]:
        return {**{name: msgspec.to_builtins(state) for name, state in states.items()}, "log": self.daemon.lines()}


def _has_slid(state: PlateState) -> bool:
    return len(state.fingers) == 2 and min(abs(finger.x_mm - SLID_MM) for finger in state.fingers) < 0.01


def _features(features: list[bytes]) -> dict[str, list[str]]:
    return {"features": [feature.hex() for feature in features]}
