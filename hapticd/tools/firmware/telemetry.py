"""`hapticd firmware telemetry`: stream of control ticks as CSV."""

from __future__ import annotations

import argparse
import asyncio
import sys

from ...board_protocol import SetTelemetry
from ...board_values import TelemetrySample
from . import text
from .conversation import Conversation

FIRST_WITHIN_S = 2.0  # at the slowest rate


async def run(board: Conversation, options: argparse.Namespace) -> None:
    """Stream for --seconds; then print the number of samples received and dropped."""
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
        cells = columns(t_s, sample)
        if samples == 0:
            print(",".join(cells))
        print(",".join(cells.values()))
        samples, dropped = samples + 1, sample.dropped
    await board.demand(SetTelemetry(0))
    damaged = board.damaged_frames
    print(f"{samples} samples, {dropped} dropped by the board, {damaged} frames damaged", file=sys.stderr)


def columns(t_s: float, sample: TelemetrySample) -> dict[str, str]:
    """Return the cells of one line of the table, by their columns' names."""
    cells = {"t_s": f"{t_s:.6f}", "t_board_us": str(sample.t_board_us), "state": sample.state.name}
    cells |= {name: str(int(getattr(sample, name))) for name in ("saturated", "limited", "dropped")}
    for k, mode in enumerate(sample.modes):
        for name, value in text.plain(mode).items():
            parts = dict(zip(("_d", "_q"), value, strict=True)) if isinstance(value, list) else {"": value}
            cells |= {f"mode{k}_{name}{axis}": f"{part:.7g}" for axis, part in parts.items()}
    return cells
