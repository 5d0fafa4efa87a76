"""The closed loop of a bare rig: each mode held alone at 0.1 and 1 um, then a finger on the driven plate."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import numpy as np

from ... import board_protocol as protocol
from ...board_protocol import BoardTime, SetTelemetry, Stop, TimeRequest
from ...board_values import BoardCalibration, BoardStatus, ReferenceFrame, TelemetrySample
from ...core.board.handshake import BoardSettings
from ...core.trajectory.gate import gate
from ...design.commissioning import drive
from ...design.commissioning.drive import HeldMode
from ...design.commissioning.findings import Judgement
from ...design.resonance import voltage_v
from ...files import calibration
from ...values import Drive, Knot
from ..firmware.conversation import Conversation
from . import folder
from .bench import WRAP_US, Bench, bench_step
from .resonance import CALIBRATION_FILE
from .trial import LAW

SMALL_UM, LARGE_UM, TOUCHED_UM = 0.1, 1.0, 0.5
EVERY_S, AHEAD_US = 0.02, 10_000
SETTLE_S, HELD_S = 0.15, 0.2
TELEMETRY_HZ = 200
PICTURE = """\
   reference --> [ law ] --> amplifier --> plate, then with a finger
                    ^                        |
                    +-------- sensor <-------+
"""


async def _loop(bench: Bench) -> Judgement:
    for amplitude_um in (SMALL_UM, LARGE_UM):
        async with _closed(bench) as loop:
            held = [await loop.hold(mode, min(amplitude_um, most_um)) for mode, most_um in enumerate(loop.limits_um)]
        judged = drive.judge_loop(held, loop.fault)
        if not judged.is_passed:
            return judged
    async with _closed(bench) as loop:
        still = await loop.hold(0, TOUCHED_UM)
        await bench.person.touch_plate(True)
        touched = await loop.hold(0, TOUCHED_UM, bench.touch_s)
        await bench.person.touch_plate(False)
    return judged.and_then(drive.judge_touch(still.volts_v, touched.volts_v, loop.fault))


@asynccontextmanager
async def _closed(bench: Bench) -> AsyncIterator[_Loop]:
    """Context of the loop as the service closes it: with the calibration, and the law that bears the plate. Raises
    HapticdError."""
    law = folder.merged(folder.load(bench.out).values()).get("device", {}).get("controller", LAW)
    async with bench.board() as board:
        loop = _Loop(board, calibration.load(bench.out / CALIBRATION_FILE, board.hello.modes))
        settings = BoardSettings(law, loop.calibration, TELEMETRY_HZ)
        settings.begin(board.hello, 0)
        for setting in settings.left:
            await board.demand(setting)
        answer = await board.ask(TimeRequest(0), BoardTime)
        loop.ahead_us = answer.t_received_us - round(asyncio.get_running_loop().time() * 1e6)
        yield loop
        board.send(SetTelemetry(0))
        board.send(Stop())


class _Loop:
    """References for a board with this calibration. `fault` is what ended the drive; `ahead_us` is by how much the
    board's clock is ahead."""

    def __init__(self, board: Conversation, calibration: BoardCalibration) -> None:
        self.calibration, self.limits_um = calibration, tuple(board.hello.w_limit_um)
        self.fault, self.ahead_us = "", 0
        self._board, self._seq = board, 0

    async def hold(self, mode: int, amplitude_um: float, seconds: float = HELD_S) -> HeldMode:
        """Hold one mode and return what it did after it settled; `fault` has what ended it."""
        board, modal_um = self._board, [0.0] * len(self.limits_um)
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

    def _refer(self, modal_um: tuple[float, ...]) -> None:
        now_us = self.ahead_us + round(asyncio.get_running_loop().time() * 1e6)
        safe = gate(Drive(0, (Knot(0, modal_um),)), self.limits_um)
        for _ in range(3 if self._seq == 0 else 1):  # a board trusts the third frame of a stream
            self._seq += 1
            self._board.send(ReferenceFrame(self._seq, (now_us + AHEAD_US) % WRAP_US, safe))

    def _held(self, mode: int, amplitude_um: float, samples: list[TelemetrySample]) -> HeldMode:
        one, drive_hz = self.calibration.modes[mode], self.calibration.drive_hz or self._board.hello.drive_hz
        strongest = int(np.argmax(np.abs(one.drive))) if one.drive else mode
        measured = np.array([sample.modes[mode].measured_um for sample in samples] or [0j])
        volts = np.array([sample.modes[strongest].voltage_v for sample in samples] or [0j])
        mean = complex(measured.mean())
        return HeldMode(
            amplitude_um,
            abs(mean),
            float(np.sqrt((np.abs(measured - mean) ** 2).mean())),
            complex(volts.mean()),
            max(voltage_v(one, drive_hz, amplitude_um), math.ulp(1.0)),
        )


STEP = bench_step(
    "loop",
    7,
    "close the loop at 0.1 and 1 um, and touch the driven plate",
    "Goggles on, hands off. Rest a finger on the plate when asked, where the first mode moves most.",
    PICTURE,
    _loop,
    back_to="wires",
)
