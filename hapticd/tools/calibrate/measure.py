"""Measurements of the commissioning, by the board's own tools."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator
from dataclasses import replace

import numpy as np

from ... import board_protocol as protocol
from ...board_protocol import BoardState, BoardTime, LogRequest, RawVoltage, SetTelemetry, Stop, Sweep, TimeRequest
from ...board_values import BoardLog, BoardStatus, TelemetrySample
from ...design.commissioning.findings import PlateDesign
from ...design.wiring import AmplifierSweep
from ...errors import DeviceError
from ...values import ComplexArray, FloatArray
from ..firmware.conversation import Conversation
from ..firmware.sweep import measured_again

ASKED_V = 1.0  # of the first voltage on a new amplifier
REST_S = 2.0
LINE_BYTES_S = 60_000  # of telemetry: two thirds of a line of 921600 baud
TRIES = 4
STEP_HZ, DWELL_MS = 15.0, 40  # of a short sweep: half of it settles, 4 time constants at Q 500
BESIDE_HZ = 120.0  # to either side of the outermost mode: good plates lie 40 Hz off
SEARCH_STEP_HZ, SEARCH_DWELL_MS = 20.0, 20
VOLTS_FRAC = 0.1
EXTENDED_MS = 400
EXTEND_EVERY_S = 0.15
STATUS_WITHIN_S = 0.5
SILENCE_S = 0.2  # far beyond the dead-man's 50 ms, and within the voltage's own time
TOOL_STOPPED = 65  # of the board's log
WRAP_US = 1 << 32


async def at_rest(board: Conversation) -> tuple[FloatArray, ComplexArray]:
    """Return unwrapped times in us (T,) and measured amplitudes (T, M) of ticks over REST_S."""
    size, samples, loop = 16 + 32 * board.hello.modes, list[TelemetrySample](), asyncio.get_running_loop()
    await board.demand(SetTelemetry(min(500, LINE_BYTES_S // size)))
    end_s = loop.time() + REST_S
    while (sample := await board.wait_for(TelemetrySample, end_s - loop.time())) is not None:
        samples.append(sample)
    await board.demand(SetTelemetry(0))
    if len(samples) < 2:
        raise DeviceError("The board sends no telemetry: use a faster --baud, or another cable.")
    t_us = np.unwrap(np.array([sample.t_board_us for sample in samples], np.float64), period=WRAP_US)
    return t_us, np.array([[mode.measured_um for mode in sample.modes] for sample in samples])


def short_plan(design: PlateDesign, volts: float) -> Sweep:
    """Return a sweep over all modes that the design expects, of amplifier 0."""
    low_hz, high_hz = min(design.frequency_hz) - BESIDE_HZ, max(design.frequency_hz) + BESIDE_HZ
    points = max(math.ceil((high_hz - low_hz) / STEP_HZ) + 1, 2 * design.modes + 3)
    return Sweep(0, low_hz, high_hz, points, DWELL_MS, volts)


def search_plan(design: PlateDesign) -> Sweep:
    """Return a sweep over all that the board can sweep."""
    reach_hz = protocol.SWEEP_OFFSET_MAX_HZ
    low_hz, high_hz = design.drive_hz - reach_hz, design.drive_hz + reach_hz
    points = math.ceil((high_hz - low_hz) / SEARCH_STEP_HZ) + 1
    return Sweep(0, low_hz, high_hz, points, SEARCH_DWELL_MS, VOLTS_FRAC * design.v_limit_v)


async def swept(board: Conversation, plan: Sweep) -> list[AmplifierSweep]:
    """Return the responses to each amplifier in turn. Raises DeviceError."""
    return [
        AmplifierSweep.of(amplifier, await measured_again(board, replace(plan, mode=amplifier), TRIES))
        for amplifier in range(board.hello.modes)
    ]


@contextlib.asynccontextmanager
async def raw(board: Conversation, amplifier: int, volts: float) -> AsyncIterator[None]:
    """Context in which an amplifier has a voltage, until it ends by itself, a dead-man or a stop."""

    async def extend() -> None:
        while True:
            await asyncio.sleep(EXTEND_EVERY_S)
            board.send(RawVoltage(amplifier, complex(volts), EXTENDED_MS))

    with board.driving():
        await board.demand(RawVoltage(amplifier, complex(volts), EXTENDED_MS))
        extending = asyncio.get_running_loop().create_task(extend())
        try:
            yield
        finally:
            extending.cancel()
            board.send(Stop())


async def status(board: Conversation) -> BoardStatus:
    """Return the next status. Raises DeviceError."""
    found = await board.wait_for(BoardStatus, STATUS_WITHIN_S)
    if found is None:
        raise DeviceError("The board sends no status: reset it, and try again.")
    return found


async def drives(board: Conversation) -> bool:
    """Return whether the board accepts a hundredth of a volt and keeps it."""
    await quiet(board)
    with board.driving():
        await board.demand(RawVoltage(0, 0.01 + 0j, EXTENDED_MS))
        states = [(await status(board)).state for _ in range(3)]
        board.send(Stop())
    return states[-1] is BoardState.TOOL


async def quiet(board: Conversation) -> None:
    """Wait until a tool has ramped down. What the board sent before, while a person typed, is dropped."""
    await board.ask(TimeRequest(0), BoardTime)
    for _ in range(10):
        if (await status(board)).state is not BoardState.TOOL:
            return


async def stops_in_silence(board: Conversation, volts: float) -> bool:
    """Return whether a voltage ends, and is logged, if no keep-alive follows it."""
    before, _ = await events(board)
    await board.demand(RawVoltage(0, complex(volts), EXTENDED_MS))
    await asyncio.sleep(SILENCE_S)
    after, codes = await events(board)
    return after > before and TOOL_STOPPED in codes


async def events(board: Conversation) -> tuple[int, tuple[int, ...]]:
    """Return how many events the board has ever logged, and the codes of the newest, oldest first."""
    log = await board.ask(LogRequest(), BoardLog)
    return log.events, tuple(entry.code for entry in log.entries if entry.boot_id == board.hello.boot_id)
