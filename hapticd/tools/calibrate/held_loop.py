"""The closed loop of the commissioning: each mode held alone by references, as the service sends them."""

from __future__ import annotations

import asyncio
import math

import numpy as np

from ... import board_protocol as protocol
from ...board_protocol import BoardTime, SetTelemetry, Stop, TimeRequest
from ...board_values import BoardCalibration, BoardStatus, ReferenceFrame, TelemetrySample
from ...core.board.outbox import BoardSettings
from ...core.trajectory.gate import gate
from ...design.commissioning.drive import HeldMode
from ...design.resonance import voltage_v
from ...values import Drive, Knot
from ..firmware.conversation import Conversation

EVERY_S, AHEAD_US = 0.02, 10_000
SETTLE_S, HELD_S = 0.15, 0.2
TELEMETRY_HZ = 200
WRAP_US = 1 << 32


class Loop:
    """References for a board with this calibration and control law."""

    def __init__(self, board: Conversation, calibration: BoardCalibration, law: str) -> None:
        self._board, self._modes, self._seq = board, calibration.modes, 0
        self._settings = BoardSettings(law, calibration, TELEMETRY_HZ)
        self._drive_hz = self._settings.drive_hz(board.hello)
        self.fault = ""

    async def begin(self) -> None:
        """Give the board all that the service gives it. Raises DeviceError."""
        board = self._board
        self._settings.begin(board.hello, 0)
        while (setting := self._settings.next) is not None:
            await board.demand(setting)
            self._settings.taken()
        asked = asyncio.get_running_loop().time()
        answer = await board.ask(TimeRequest(round(asked * 1e9)), BoardTime)
        self._ahead_us = answer.t_received_us - round(asyncio.get_running_loop().time() * 1e6)

    async def hold(self, mode: int, amplitude_um: float, seconds: float = HELD_S) -> HeldMode:
        """Hold one mode and return what it did after it settled; `fault` has what ended it."""
        board, modal_um = self._board, [0.0] * len(self._modes)
        modal_um[mode] = amplitude_um
        samples: list[TelemetrySample] = []
        loop = asyncio.get_running_loop()
        start_s = next_s = loop.time()
        while not self.fault and loop.time() - start_s < SETTLE_S + seconds:
            if loop.time() >= next_s:
                self._refer(tuple(modal_um))
                next_s += EVERY_S
            message = await board.receive(max(next_s - loop.time(), 0.0))
            if isinstance(message, BoardStatus) and message.fault_code:
                self.fault = protocol.FAULTS.get(message.fault_code, f"fault {message.fault_code}")
            elif isinstance(message, TelemetrySample) and loop.time() - start_s > SETTLE_S:
                samples.append(message)
        return self._held(mode, amplitude_um, samples)

    def rest(self) -> None:
        """End the drive: without references the board ramps down by its dead-man."""
        self._board.send(SetTelemetry(0))
        self._board.send(Stop())

    def _refer(self, modal_um: tuple[float, ...]) -> None:
        now_us = (self._ahead_us + round(asyncio.get_running_loop().time() * 1e6)) % WRAP_US
        safe = gate(Drive(0, (Knot(0, modal_um),)), tuple(self._board.hello.w_limit_um))
        for _ in range(3 if self._seq == 0 else 1):  # a board trusts the third frame of a stream
            self._seq += 1
            self._board.send(ReferenceFrame(self._seq, (now_us + AHEAD_US) % WRAP_US, safe))

    def _held(self, mode: int, amplitude_um: float, samples: list[TelemetrySample]) -> HeldMode:
        one = self._modes[mode]
        strongest = int(np.argmax(np.abs(one.drive))) if one.drive else mode
        measured = np.array([sample.modes[mode].measured_um for sample in samples] or [0j])
        volts = np.array([sample.modes[strongest].voltage_v for sample in samples] or [0j])
        mean = complex(measured.mean())
        return HeldMode(
            amplitude_um,
            abs(mean),
            float(np.sqrt((np.abs(measured - mean) ** 2).mean())),
            abs(complex(volts.mean())),
            max(voltage_v(one, self._drive_hz, amplitude_um), math.ulp(1.0)),
        )
