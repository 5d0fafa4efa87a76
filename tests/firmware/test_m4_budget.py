"""What the program costs on its processor: instructions of the image, cycles by the manual's tables.

The H743's by the M4's table at the M7's clock, of which no table is published: an upper bound where the M7 does two
instructions at a time, not where it waits for its longer pipeline.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hapticd.board_protocol import ControllerRequest, Keepalive, LogRequest, SetBaud, SetTelemetry, TimeRequest
from hapticd.board_values import BoardCommand, SetController
from hapticd.wire import device
from hapticd.wire.commands import encode

from .m4.bench import Bench
from .m4.boards import F405, G474, H743, needs_compiler
from .m4.chip import Chip
from .m4.timing import INTERRUPT_CYCLES, Meter
from .test_golden import SCRIPT

pytestmark = [pytest.mark.long, needs_compiler]

COMMANDS = [step for step in SCRIPT if not isinstance(step, (int, np.ndarray, SetBaud))]
TAKEN_LIVE = (ControllerRequest, LogRequest, SetController, SetTelemetry, TimeRequest)
CHUNK_S = 50e-6
DEADLINE_S = 49e-6  # the DMA fetches a word one trigger before it is put out


def live_bench(board: Chip, law: str = "deadbeat") -> Bench:
    bench = Bench(board, board.image(5000))  # the fastest rate, which costs most
    bench.to_board += encode(SetController(law))
    bench.arm(1.5 + 0.2j, -0.7, 0.3)
    bench.to_board += device.encode(Keepalive(bench.seq))
    bench.run(1)
    assert bench.amplifiers
    return bench


def costs(bench: Bench, chunks: int) -> tuple[list[int], list[int], float]:
    """Cycles of the chunks' interrupt and of ticks that have one of their own, and the share of the processor."""
    meter, chunk, tick, main = Meter(bench.cpu, bench.board), [], [], 0
    for _ in range(chunks):
        bench.convert()
        chunk.append(meter.measure(lambda: bench.cpu.interrupt(bench.chunk_interrupt.irq)) + INTERRUPT_CYCLES)
        if bench.registers.tick_pending:
            tick.append(meter.measure(bench.compute_tick) + INTERRUPT_CYCLES)
        main += meter.measure(bench.come_round)
    meter.remove()
    return chunk, tick, (sum(chunk) + sum(tick) + main) / (chunks * CHUNK_S * bench.board.core_hz)


def longest_lock(bench: Bench, commands: list[BoardCommand]) -> int:
    """Cycles of the longest section in which the main loop keeps interrupts out, at a long reference and commands."""
    meter, sections = Meter(bench.cpu, bench.board), [0]
    meter.watch[bench.cpu.address("board_lock")] = lambda: sections.append(-meter.cycles)
    meter.watch[bench.cpu.address("board_unlock")] = lambda: sections.append(sections.pop() + meter.cycles)
    bench.reference(*[(4.0 * k, (9.0 + 0.02 * k, 7.5j, -8.0)) for k in range(24)])
    for line in (b"", *map(encode, commands)):
        bench.to_board += line
        while bench.to_board:
            bench.run(0.5)
        bench.run(0.5)
    meter.remove()
    return max(sections)


@pytest.mark.parametrize("law", ["pi", "pi_ff", "deadbeat"])
@pytest.mark.parametrize("board", [F405, G474, H743], ids=str)
def test_strokes_that_ask_for_all_the_voltage_leave_the_processor_its_share(board: Chip, law: str) -> None:
    """A hundred frames a second, each with knots to interpolate, and steps that the governor has to divide."""
    bench, shares = live_bench(board, law), []
    for i in range(2):
        bench.reference((0.0, (1.5, -1.0, 0.5)), (4.0, (1.5 + 0.1 * i, 1.0, -0.5)), (5.0, (3.5 * i, 2.0j, 0.1)))
        shares.append(costs(bench, chunks=200)[2])
    print(f"{board}: {law}: {100 * np.mean(shares):.1f} %")
    assert np.mean(shares) <= board.load_max


@pytest.mark.parametrize(
    ("board", "late_chunks", "load_max"),
    [
        (F405, 0, 0.25),
        *((replace(G474, modes=modes), late, most) for modes, late, most in ((3, 0, 0.36), (4, 1, 0.46))),
        (replace(G474, modes=5), 2, 0.55),
        (replace(H743, bus_cycles=(40, 40)), 2, 0.75),  # the slowest that its buses may be
    ],
)
def test_chunks_ticks_and_locks_are_through_in_time(board: Chip, late_chunks: int, load_max: float) -> None:
    """The longest wait, then the longest interrupt, which is that of a dead-man's trip: the DMA has not come yet.
    A tick that has its own interrupt is through so many chunks later, though those come amid it. Nothing of either is
    read from the flash, where wait states are counted: without them they take as long."""
    taken_live = [command for command in COMMANDS if isinstance(command, TAKEN_LIVE)]
    lock, quiet_lock = longest_lock(live_bench(board), taken_live), longest_lock(Bench(board), COMMANDS)
    bench = live_bench(board)
    chunks, ticks, share = costs(bench, chunks=200)
    bench.run(34)
    assert bench.amplifiers
    trip_chunks, trip_ticks, _ = costs(bench, chunks=400)  # to a dead-man's trip and beyond
    assert not bench.amplifiers
    chunk, tick, chunk_cycles = max(chunks + trip_chunks), max(ticks + trip_ticks, default=0), CHUNK_S * board.core_hz
    print(f"{board.modes} modes: {share:.3f}, longest chunk {chunk}, tick {tick}, lock {lock}, quiet {quiet_lock}")
    assert share <= load_max
    assert max(lock, quiet_lock) <= 0.09 * board.modes * chunk_cycles
    assert lock + chunk <= (1.0 if board.modes > 2 else 0.85) * DEADLINE_S * board.core_hz
    assert late_chunks == 0 or tick + late_chunks * chunk <= late_chunks * chunk_cycles  # with those that come amid it
    plain_chunks, plain_ticks, _ = costs(live_bench(replace(board, wait_states=0)), chunks=40)
    assert (plain_chunks, plain_ticks) == (chunks[:40], ticks[: len(plain_ticks)])
