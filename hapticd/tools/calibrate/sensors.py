"""The sensors of a bare rig at rest: hum and noise in the board's ticks."""

from __future__ import annotations

import asyncio

import numpy as np

from ...board_protocol import SetTelemetry
from ...board_values import TelemetrySample
from ...design.commissioning import rest
from ...design.commissioning.findings import Judgement
from ...errors import DeviceError
from ...values import ComplexArray, FloatArray
from .bench import WRAP_US, BareRig, Bench, bench_step

REST_S = 2.0
LINE_BYTES_S = 60_000  # of telemetry: two thirds of a line of 921600 baud
PICTURE = """\
   plate  |~~~~~~  no drive, no finger on it

   sensor k --coax--> front end --> ADC k
                                    noise? hum?
"""


async def _ticks(board: BareRig) -> tuple[FloatArray, ComplexArray]:
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


async def _rest(bench: Bench) -> Judgement:
    async with bench.board() as board:
        design = await board.design()
        t_us, measured_um = await _ticks(board)
    return rest.judge_rest(rest.at_rest(t_us, measured_um, design), design, len(t_us))


STEP = bench_step(
    "sensors",
    2,
    "measure noise and hum of the sensors at rest",
    "Take everything off the plate and keep still for two seconds.",
    PICTURE,
    _rest,
    back_to="sensors",
)
