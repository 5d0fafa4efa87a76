"""`hapticd firmware telemetry`: stream of control ticks as CSV, or as one JSON map per line."""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
from typing import get_type_hints

from ...board_protocol import SetTelemetry
from ...board_values import ModeSample, TelemetrySample
from . import text
from .conversation import Conversation

FIRST_WITHIN_S = 2.0  # at the slowest rate
KINDS = get_type_hints(ModeSample)  # phasors and figures


async def run(board: Conversation, options: argparse.Namespace) -> None:
    """Stream for --seconds; then print the number of samples received and dropped."""
    if not options.json:
        print(header(board.hello.modes))
    loop = asyncio.get_running_loop()
    samples, dropped, t_first_us = 0, 0, None
    await board.demand(SetTelemetry(options.rate))
    end_s = loop.time() + options.seconds
    while (left_s := end_s - loop.time()) > 0.0:
        sample = await board.wait_for(TelemetrySample, max(left_s, FIRST_WITHIN_S if samples == 0 else 0.0))
        if sample is None:
            break
        t_first_us = sample.t_board_us if t_first_us is None else t_first_us
        t_s = ((sample.t_board_us - t_first_us) & 0xFFFFFFFF) / 1e6
        samples, dropped = samples + 1, sample.dropped
        print(json.dumps({"t_s": t_s} | text.plain(sample)) if options.json else row(t_s, sample))
    await board.demand(SetTelemetry(0))
    damaged = board.damaged_frames
    print(f"{samples} samples, {dropped} dropped by the board, {damaged} frames damaged", file=sys.stderr)


def header(modes: int) -> str:
    """Return the names of the columns."""
    names = ["t_s", "t_board_us", "state", "saturated", "limited", "dropped"]
    for k in range(modes):
        for name, kind in KINDS.items():
            names += [f"mode{k}_{name}_{axis}" for axis in "dq"] if kind is complex else [f"mode{k}_{name}"]
    return ",".join(names)


def row(t_s: float, sample: TelemetrySample) -> str:
    """Return one line of the table."""
    cells = [f"{t_s:.6f}", str(sample.t_board_us), sample.state.name, str(int(sample.saturated))]
    cells += [str(int(sample.limited)), str(sample.dropped)]
    for mode in sample.modes:
        cells += _cells(mode)
    return ",".join(cells)


def _cells(mode: ModeSample) -> list[str]:
    values = [getattr(mode, name) for name in KINDS]
    return [f"{part:.7g}" for w in values for part in ((w.real, w.imag) if isinstance(w, complex) else (w,))]
