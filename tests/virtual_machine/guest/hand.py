"""Fingers on a virtual Magic Trackpad 2: frames at the pad's own pace, with its own clock, for as long as they rest."""

from __future__ import annotations

import threading
import time

from bluetooth import BluetoothPad
from cable import CablePad

from hapticd.sim.fingers.sensor import PadRecord, encode_mt2

PERIOD_S = 0.01125
Point = tuple[int, int]


class Hand:
    """Fingers at raw positions, by contact id. Sends from the construction to `freeze` or `lift`."""

    def __init__(self, pad: BluetoothPad | CablePad, fingers: dict[int, Point]) -> None:
        self._pad = pad
        self._is_usb = isinstance(pad, CablePad)
        self._fingers = fingers
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._rest, daemon=True)
        self._thread.start()

    def slide(self, contact_id: int, to: Point, frames: int) -> None:
        """Move one finger there in equal steps; returns when it has arrived."""
        (x, y), (x_to, y_to) = self._fingers[contact_id], to
        for i in range(1, frames + 1):
            point = x + (x_to - x) * i // frames, y + (y_to - y) * i // frames
            self._fingers = {**self._fingers, contact_id: point}
            time.sleep(PERIOD_S)

    def freeze(self) -> None:
        """No more frames; the pad's last word is that the fingers are down."""
        self._ended.set()
        self._thread.join()

    def lift(self) -> None:
        self.freeze()
        self._send({})

    def _rest(self) -> None:
        while not self._ended.wait(PERIOD_S):
            self._send(self._fingers)

    def _send(self, fingers: dict[int, Point]) -> None:
        records = [PadRecord(contact_id, x, y) for contact_id, (x, y) in fingers.items()]
        self._pad.send(encode_mt2(time.monotonic_ns() // 1_000_000, records, usb=self._is_usb))
