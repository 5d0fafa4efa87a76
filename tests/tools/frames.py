"""Frames of a bench with known delays, as `hapticd latency` measures them."""

from __future__ import annotations

from machine_bench import SLIPPERY, STICKY, Bench

from hapticd.tools.latency import Measured, gather


def measured_frames(milliseconds: int = 1000) -> Measured:
    """A driven bench whose board acknowledges each millisecond; the link takes no time, reports come every 11.25 ms."""
    bench = Bench(SLIPPERY, STICKY).driven()
    for _ in range(milliseconds):
        bench.machine.pipeline.resend()
        bench.run(1)
        bench.board.status()
    return gather(bench.machine, list(bench.machine.session.ledger))
