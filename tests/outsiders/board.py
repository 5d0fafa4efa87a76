"""A board written from firmware/PROTOCOL.md alone: framing, clock, references, limits, dead-man, and a plate.

It shares no code with hapticd or the firmware. Tools are answered "busy". `censor` makes it hostile.
"""

from __future__ import annotations

import cmath
import math
import re
import struct
from collections import deque
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

PROTOCOL = Path(__file__).parents[2] / "firmware" / "PROTOCOL.md"

HELLO_REQUEST, REFERENCE, KEEPALIVE, TIME_REQUEST, CLEAR_FAULT, SET_CONTROLLER, SET_MODEL = range(1, 8)
SWEEP, RAW_VOLTAGE, SET_TELEMETRY, STOP = 9, 10, 11, 13
HELLO, STATUS, TIME, VERDICT = 0x81, 0x82, 0x83, 0x88
QUIET, LIVE, FAULT = 0, 1, 2
DONE, OUT_OF_RANGE, BUSY = 0, 1, 2

CONTROL_HZ, DRIVE_HZ, V_LIMIT_V = 2000.0, 29205.0, 150.0
TICK_US = 500
STATUS_US, DEADMAN_US, RAMP_TICKS = 100_000, 50_000, 20
AHEAD_US, STALE_US = 1_000_000, 50_000
ARMING = 3
WRAP = 1 << 32
DECAY_1_S, GAIN_UM_PER_V_S = 183.5, 5.17  # of both modes; they lie 10 Hz to either side of the drive
DETUNING_RAD_S = (-62.8, 62.8)

Polyline = list[tuple[int, list[complex]]]  # knots: instant on the unwrapped clock, phasor of each mode


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


class Board:
    """One board. `advance` takes it to an instant of true time; `feed` is what arrives, `said` what it sends."""

    def __init__(self, *, boot_id: int = 0x51AB, w_limit_um: float = 4.0, ppm: float = 40.0) -> None:
        self.boot_id, self.w_limit_um, self.ppm = boot_id, w_limit_um, ppm
        self.said = bytearray()
        self.censor: Callable[[int, bytes], bytes | None] = lambda _, payload: payload
        self.runs_backwards = False
        self.received: list[tuple[int, int]] = []  # true time in us and type of every sound frame
        self.peaks_um: list[tuple[int, float]] = []  # true time in us, largest amplitude of the plate
        self.t_us = 0  # true time
        self._buffer = bytearray()
        self._w_um = [0j, 0j]
        self.reset(boot_id)

    def reset(self, boot_id: int) -> None:
        """As by the reset pin: clock and session start again, and the plate rings down."""
        self.boot_id, self._t_boot_us = boot_id, self.t_us
        self.state, self.fault = QUIET, 0
        self.trips = self.bad_frames = self.late_frames = self.worst_late_us = 0
        self.saturated = self.limited = False
        self._ramp = 0
        self._t_status_us = self.now_us
        self._quiet()

    def _quiet(self) -> None:
        """No session: no references, no trust."""
        self._lines: deque[tuple[int, int, int, Polyline]] = deque()  # start, seq, received, knots
        self._line: tuple[int, int, int, Polyline] | None = None
        self._seq: int | None = None
        self._newest = self._applied = (0, 0, 0, False)  # seq, received, applied, has taken effect
        self._good, self._t_alive_us = 0, self.now_us
        self._last_um = [0j, 0j]

    @property
    def now_us(self) -> int:
        """The board's clock, unwrapped: it starts 1.2 s before its wrap."""
        passed_us = (self.t_us - self._t_boot_us) * (1 + self.ppm * 1e-6)
        return WRAP - 1_200_000 + round(-passed_us if self.runs_backwards else passed_us)

    # --- the line ---

    def feed(self, data: bytes) -> None:
        for byte in data:
            if byte:
                self._buffer.append(byte)
            elif self._buffer:
                message = unframed(bytes(self._buffer))
                self._buffer.clear()
                if message is None:
                    self._refuse()
                else:
                    self.received.append((self.t_us, message[0]))
                    self._obey(*message)

    def _say(self, kind: int, payload: bytes) -> None:
        let_pass = self.censor(kind, payload)
        if let_pass is not None:
            self.said += framed(kind, let_pass)

    def _refuse(self) -> None:
        self.bad_frames += 1
        self._good = 0

    def _obey(self, kind: int, payload: bytes) -> None:
        sizes = {HELLO_REQUEST: 0, KEEPALIVE: 2, TIME_REQUEST: 8, CLEAR_FAULT: 0, SET_CONTROLLER: 9, SET_MODEL: 21}
        if kind == REFERENCE:
            self._reference(payload)
        elif kind in (SWEEP, RAW_VOLTAGE, SET_TELEMETRY, STOP):
            self._say(VERDICT, bytes((kind, BUSY)))
        elif sizes.get(kind) != len(payload):
            self._refuse()
        elif kind == HELLO_REQUEST:
            self._hello()
        elif kind == KEEPALIVE:
            self._keep_alive(*struct.unpack("<H", payload))
        elif kind == TIME_REQUEST:
            received_us = self.now_us
            sent_us = received_us + (-30 if self.runs_backwards else 30)
            self._say(TIME, payload + struct.pack("<II", received_us % WRAP, sent_us % WRAP))
        elif kind == CLEAR_FAULT:
            self.fault = 0
            self._enter(QUIET)
        else:
            self._set(kind, payload)

    def _hello(self) -> None:
        self._ramp = 0
        self._quiet()
        if self.state != FAULT:
            self.state = QUIET
        _, example = unframed(examples()["HELLO"][:-1]) or (0, b"")
        version_and_hash = example[:6]
        head = struct.pack("<B16sIffHf", 2, b"outsider", self.boot_id, CONTROL_HZ, DRIVE_HZ, 50, V_LIMIT_V)
        self._say(HELLO, version_and_hash + head + struct.pack("<2f", self.w_limit_um, self.w_limit_um))

    def _set(self, kind: int, payload: bytes) -> None:
        if kind == SET_CONTROLLER:
            law, bandwidth_1_s, integral_time_s = struct.unpack("<Bff", payload)
            is_sound = law <= 2 and (bandwidth_1_s == 0 or 10 <= bandwidth_1_s <= 20000)
            is_sound = is_sound and (integral_time_s == 0 or 1e-4 <= integral_time_s <= 1)
        else:
            mode, decay, detuning, gain, loop_d, loop_q = struct.unpack("<Bfffff", payload)
            is_sound = mode < 2 and 1 <= decay <= 10000 and abs(detuning) <= 20000 and 1e-3 <= gain <= 1e4
            is_sound = is_sound and abs(math.hypot(loop_d, loop_q) - 1) <= 1e-3
        if kind == SET_CONTROLLER and is_sound:
            self._ramp = 0
        is_busy = kind == SET_MODEL and self.state == LIVE
        self._say(VERDICT, bytes((kind, OUT_OF_RANGE if not is_sound else BUSY if is_busy else DONE)))

    # --- references and the dead-man ---

    def _reference(self, payload: bytes) -> None:
        if len(payload) < 8:
            return self._refuse()
        seq, t_apply, knots, modes = struct.unpack_from("<HIBB", payload)
        if modes != 2 or not 1 <= knots <= 24 or len(payload) != 8 + 18 * knots:
            return self._refuse()
        # The instant of the 32-bit count that lies nearest to now.
        ahead_us = (t_apply - self.now_us + WRAP // 2) % WRAP - WRAP // 2
        rows = list(struct.iter_unpack("<H4f", payload[8:]))
        offsets = [row[0] for row in rows]
        is_sound = all(map(math.isfinite, (part for row in rows for part in row[1:]))) and ahead_us <= AHEAD_US
        if not is_sound or offsets != sorted(set(offsets)):
            return self._refuse()
        if self._seq is not None and not 0 < (seq - self._seq) % 65536 < 32768:
            self.late_frames += 1
            return None
        if ahead_us < -STALE_US:
            self.late_frames += 1
            self._good = 0
            return None
        line = [
            (self.now_us + ahead_us + 4 * offset, self._within([complex(d0, q0), complex(d1, q1)]))
            for offset, d0, q0, d1, q1 in rows
        ]
        if line[0][0] < self.now_us:
            self.late_frames += 1
            self.worst_late_us = max(self.worst_late_us, self.now_us - line[0][0])
        while self._lines and self._lines[-1][0] >= line[0][0]:
            self._lines.pop()
        if len(self._lines) < 7:
            self._lines.append((line[0][0], seq, self.now_us, line))
        self._seq, self._newest = seq, (seq, self.now_us, 0, False)
        self._good += 1
        self._t_alive_us = self.now_us
        return None

    def _within(self, modal_um: list[complex]) -> list[complex]:
        factor = min(1.0, *(self.w_limit_um / max(abs(w_um), 1e-12) for w_um in modal_um))
        if factor >= 1.0 - 1e-6:
            return modal_um
        self.limited = True
        return [factor * w_um for w_um in modal_um]

    def _keep_alive(self, seq: int) -> None:
        if seq == self._seq:
            self._t_alive_us = self.now_us
        else:
            self.late_frames += 1

    # --- time ---

    def advance(self, t_us: int) -> None:
        """Run all ticks until `t_us` of true time."""
        while self.t_us + TICK_US <= t_us:
            self.t_us += TICK_US
            self._tick()

    def _tick(self) -> None:
        is_silent = abs(self.now_us - self._t_alive_us) > DEADMAN_US
        if is_silent:
            self._good = 0
        if self.state == LIVE and is_silent:
            self.trips += 1
            self._lines.clear()
            self._line = None
            self._enter(QUIET)
        elif self.state == QUIET and self._ramp == 0 and self._good >= ARMING:
            self._enter(LIVE)
        self._start_due()
        self._drive()
        if abs(self.now_us - self._t_status_us) >= STATUS_US:
            self._status(self._newest)

    def _start_due(self) -> None:
        while self._lines and self._lines[0][0] <= self.now_us:
            self._line = self._lines.popleft()
            _, seq, received_us, _ = self._line
            self._applied = (seq, received_us, self.now_us, True)
            if self._newest[0] == seq:
                self._newest = self._applied
            self._status(self._applied)

    def _drive(self) -> None:
        """One tick of ramp, reference and plate: dW/dt = (-s + jD) W + g u, V = j u, exact over the tick."""
        self._ramp = min(self._ramp + 1, RAMP_TICKS) if self.state == LIVE else max(self._ramp - 1, 0)
        if self.state == LIVE:
            self._last_um = self._reference_um()
        ramp = self._ramp / RAMP_TICKS
        self.voltage_v = [0j, 0j]
        for k, w_um in enumerate(self._w_um):
            rate = complex(-DECAY_1_S, DETUNING_RAD_S[k])
            keep = cmath.exp(rate * TICK_US * 1e-6)
            push = GAIN_UM_PER_V_S * (keep - 1) / rate
            u_v = (ramp * self._last_um[k] - keep * w_um) / push if ramp else 0j
            if abs(u_v) > ramp * V_LIMIT_V:
                u_v *= ramp * V_LIMIT_V / abs(u_v)
                self.saturated = True
            self.voltage_v[k] = 1j * u_v
            self._w_um[k] = keep * w_um + push * u_v
        self.peaks_um.append((self.t_us, max(map(abs, self._w_um))))

    def _reference_um(self) -> list[complex]:
        if self._line is None:
            return [0j, 0j]
        knots, now_us = self._line[3], self.now_us
        for (t0_us, first), (t1_us, second) in pairwise(knots):
            if now_us < t1_us:
                part = max(now_us - t0_us, 0) / (t1_us - t0_us)
                return [a + part * (b - a) for a, b in zip(first, second, strict=True)]
        return knots[-1][1]

    def _enter(self, state: int) -> None:
        if self.state != state:
            self.state = state
            self._status(self._newest)

    def _status(self, receipt: tuple[int, int, int, bool]) -> None:
        seq, received_us, applied_us, has_effect = receipt
        flags = has_effect | self.saturated << 1 | self.limited << 2
        self._t_status_us, self.saturated, self.limited = self.now_us, False, False
        head = (self.now_us % WRAP, self.state, flags, self.fault, 2, seq, received_us % WRAP, applied_us % WRAP)
        payload = struct.pack("<IBBBBHIIHII", *head, self.trips, self.bad_frames, self.late_frames)
        for w_um, v_v in zip(self._w_um, getattr(self, "voltage_v", [0j, 0j]), strict=True):
            payload += struct.pack("<4f", w_um.real, w_um.imag, v_v.real, v_v.imag)
        self._say(STATUS, payload)
