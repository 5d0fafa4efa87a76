"""A board written from firmware/PROTOCOL.md alone: framing, clock, references and their receipts, dead-man.

It shares no code with hapticd or the firmware. Its plate is where the newest reference goes, and any setting is taken.
`censor` makes it hostile.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

PROTOCOL = Path(__file__).parents[2] / "firmware" / "PROTOCOL.md"

HELLO_REQUEST, REFERENCE, KEEPALIVE, TIME_REQUEST, CLEAR_FAULT, SET_CONTROLLER, SET_MODEL = range(1, 8)
HELLO, STATUS, TIME, VERDICT = 0x81, 0x82, 0x83, 0x88
SIZES = {HELLO_REQUEST: 0, KEEPALIVE: 2, TIME_REQUEST: 8, CLEAR_FAULT: 0, SET_CONTROLLER: 9, SET_MODEL: 21}
QUIET, LIVE = 0, 1
DONE, OUT_OF_RANGE, BUSY = 0, 1, 2
W_LIMIT_UM, ARMING = 4.0, 3
TICK_US, STATUS_US, DEADMAN_US = 500, 100_000, 50_000
WRAP = 1 << 32
PPM = 40.0  # by which its clock is fast


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE, bit by bit."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return crc


def framed(kind: int, payload: bytes) -> bytes:
    """COBS(type | payload | CRC) and the delimiter."""
    body = bytes((kind,)) + payload
    body += struct.pack("<H", crc16(body))
    out, block = bytearray(), bytearray()
    for byte in body:
        if byte:
            block.append(byte)
        if not byte or len(block) == 254:
            out += bytes((len(block) + 1,)) + block
            block.clear()
            full = bool(byte)
        else:
            full = False
    if not full:
        out += bytes((len(block) + 1,)) + block
    return bytes(out) + b"\0"


def unframed(frame: bytes) -> tuple[int, bytes] | None:
    """Type and payload of a frame without its delimiter; None if it is damaged."""
    body, at = bytearray(), 0
    while at < len(frame):
        code = frame[at]
        if at + code > len(frame):
            return None
        body += frame[at + 1 : at + code]
        at += code
        if code < 255 and at < len(frame):
            body.append(0)
    if len(body) < 3 or crc16(bytes(body[:-2])) != struct.unpack("<H", body[-2:])[0]:
        return None
    return body[0], bytes(body[1:-2])


def examples() -> dict[str, bytes]:
    """The examples of PROTOCOL.md, by message."""
    text = PROTOCOL.read_text(encoding="utf-8").split("## Examples")[1]
    return {name: bytes.fromhex(line) for name, line in re.findall(r"^([A-Z_]+) +((?:[0-9a-f]{2} ?)+)$", text, re.M)}


class Receipt(NamedTuple):
    """Of a reference: what STATUS says of it, and its largest amplitude."""

    seq: int
    received_us: int
    applied_us: int
    has_effect: bool
    peak_um: float


class Board:
    """One board. `advance` takes it to an instant of true time; `feed` is what arrives, `said` what it sends."""

    def __init__(self) -> None:
        self.said = bytearray()
        self.censor: Callable[[int, bytes], bytes | None] = lambda _, payload: payload
        self.runs_backwards = False
        self.received: list[tuple[int, int]] = []  # true time in us and type of every sound frame
        self.peaks_um: list[tuple[int, float]] = []  # true time in us, largest amplitude of the plate
        self.t_us = 0  # true time
        self.trips = self.bad_frames = self.worst_late_us = 0
        self._buffer = bytearray()
        self.reset(0x51AB)

    def reset(self, boot_id: int) -> None:
        """As by the reset pin: clock and session start again."""
        self._boot_id, self._t_boot_us = boot_id, self.t_us
        self._begin_session()

    def _begin_session(self) -> None:
        self.state, self._good = QUIET, 0
        self._newest = self._applied = Receipt(0, 0, 0, False, 0.0)
        self._waiting: list[tuple[int, Receipt]] = []
        self._t_alive_us = self._t_status_us = self.now_us

    @property
    def now_us(self) -> int:
        """The board's clock, unwrapped: it starts 1.2 s before its wrap."""
        passed_us = (self.t_us - self._t_boot_us) * (1 + PPM * 1e-6)
        return WRAP - 1_200_000 + round(-passed_us if self.runs_backwards else passed_us)

    def feed(self, data: bytes) -> None:
        for byte in data:
            if byte:
                self._buffer.append(byte)
            elif self._buffer:
                message = unframed(bytes(self._buffer))
                self._buffer.clear()
                if message is None or not self._obey(*message):
                    self.bad_frames += 1
                else:
                    self.received.append((self.t_us, message[0]))

    def _say(self, kind: int, payload: bytes) -> None:
        let_pass = self.censor(kind, payload)
        if let_pass is not None:
            self.said += framed(kind, let_pass)

    def _obey(self, kind: int, payload: bytes) -> bool:
        """Whether the message is sound."""
        if kind == REFERENCE:
            return self._take_reference(payload)
        if kind == KEEPALIVE and payload == struct.pack("<H", self._newest.seq):
            self._t_alive_us = self.now_us
        elif kind == HELLO_REQUEST:
            self._begin_session()
            _, example = unframed(examples()["HELLO"][:-1]) or (0, b"")
            version_and_hash = example[:6]
            head = struct.pack("<B16sIffHf", 2, b"outsider", self._boot_id, 2000.0, 29205.0, DEADMAN_US // 1000, 150.0)
            self._say(HELLO, version_and_hash + head + struct.pack("<2f", W_LIMIT_UM, W_LIMIT_UM))
        elif kind == TIME_REQUEST:
            self._say(TIME, payload + struct.pack("<II", self.now_us % WRAP, self.now_us % WRAP))
        elif kind != CLEAR_FAULT and kind != KEEPALIVE:
            is_busy = kind == SET_MODEL and self.state == LIVE
            self._say(VERDICT, bytes((kind, BUSY if is_busy else DONE)))
        return SIZES.get(kind, len(payload)) == len(payload)

    def _take_reference(self, payload: bytes) -> bool:
        seq, t_apply, knots, modes = struct.unpack_from("<HIBB", payload)
        if modes != 2 or not 1 <= knots <= 24 or len(payload) != 8 + 18 * knots:
            return False
        # The instant of the 32-bit count that lies nearest to now.
        ahead_us = (t_apply - self.now_us + WRAP // 2) % WRAP - WRAP // 2
        rows = list(struct.iter_unpack("<H4f", payload[8:]))
        peak_um = max(math.hypot(*row[at : at + 2]) for row in rows for at in (1, 3))
        offsets = [row[0] for row in rows]
        if not peak_um <= W_LIMIT_UM * (1 + 1e-6) or offsets != sorted(set(offsets)) or abs(ahead_us) > 1_000_000:
            return False
        self.worst_late_us = max(self.worst_late_us, -ahead_us)
        if self._newest.received_us and not 0 < (seq - self._newest.seq) % 65536 < 32768:
            return False
        start_us = self.now_us + ahead_us
        self._newest = Receipt(seq, self.now_us, 0, False, peak_um)
        self._waiting = [(t_us, receipt) for t_us, receipt in self._waiting if t_us < start_us]
        self._waiting.append((start_us, self._newest))
        self._good, self._t_alive_us = self._good + 1, self.now_us
        return True

    def advance(self, t_us: int) -> None:
        """Run all ticks until `t_us` of true time."""
        while self.t_us + TICK_US <= t_us:
            self.t_us += TICK_US
            self._tick()

    def _tick(self) -> None:
        if abs(self.now_us - self._t_alive_us) > DEADMAN_US:
            self.trips += self.state == LIVE
            self.state, self._good, self._waiting = QUIET, 0, []
        elif self._good >= ARMING:
            self.state = LIVE
        while self._waiting and self._waiting[0][0] <= self.now_us:
            receipt = self._waiting.pop(0)[1]._replace(applied_us=self.now_us, has_effect=True)
            self._applied = receipt
            self._newest = receipt if self._newest.seq == receipt.seq else self._newest
            self._status(receipt)
        self.peaks_um.append((self.t_us, self._applied.peak_um if self.state == LIVE else 0.0))
        if abs(self.now_us - self._t_status_us) >= STATUS_US:
            self._status(self._newest)

    def _status(self, of: Receipt) -> None:
        self._t_status_us, w_um = self.now_us, self.peaks_um[-1][1] if self.peaks_um else 0.0
        head = (
            self.now_us % WRAP,
            self.state,
            of.has_effect,
            0,
            2,
            of.seq,
            of.received_us % WRAP,
            of.applied_us % WRAP,
        )
        payload = struct.pack("<IBBBBHIIHII", *head, self.trips, self.bad_frames, 0)
        self._say(STATUS, payload + 2 * struct.pack("<4f", w_um, 0.0, 0.0, 0.0))
