"""What the program costs on its processor: instructions counted in the image, cycles by the manual's tables.

The H743's by the M4's table at the M7's clock, of which no table is published: an upper bound where the M7 does two
instructions at a time, not where it waits for its longer pipeline.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from .m4 import image
from .m4.bench import Bench
from .m4.boards import F405, G474, H743, every_board, needs_compiler
from .m4.chip import Chip
from .m4.costs import CHUNK_S, COMMANDS, DEADLINE_S, costs, live_bench, locked_costs, longest_lock
from .m4.timing import INTERRUPT_CYCLES, cycles

pytestmark = [pytest.mark.long, needs_compiler]


@every_board
@pytest.mark.parametrize("law", ["pi", "pi_ff", "deadbeat"])
@pytest.mark.parametrize("control_hz", [2000, 5000])
def test_the_whole_program_stays_within_its_share_of_the_processor(board: Chip, control_hz: int, law: str) -> None:
    share = costs(live_bench(board, control_hz, law), chunks=400).share(board)
    print(f"{board}: {law} at {control_hz} Hz: {100 * share:.1f} %")
    assert share <= board.load_max


@every_board
def test_strokes_that_ask_for_all_the_voltage_stay_within_it_too(board: Chip) -> None:
    """A hundred frames a second, each with knots to interpolate, and steps that the governor has to divide."""
    bench = live_bench(board, 5000)
    total = 0.0
    for i in range(20):
        knots = ((0.0, (1.5, -1.0, 0.5)), (4.0, (1.5 + 0.1 * (i % 5), 1.0, -0.5)), (5.0, (3.5 * (i % 2), 2.0j, 0.1)))
        bench.reference(*knots)
        total += costs(bench, chunks=200).share(board)
    assert total / 20 <= board.load_max


def test_a_chunk_and_a_tick_stay_within_their_instructions() -> None:
    instructions = sorted(count.instructions for count in costs(live_bench(F405, 2000), chunks=40).chunk)
    assert instructions[0] <= 950, "19 per sample: 8 to listen, 9 to speak, 2 for the rest"
    assert instructions[-1] - instructions[0] <= 930 * F405.modes


@pytest.mark.parametrize(
    ("board", "late_chunks", "load_max"),
    [
        (F405, 0, 0.25),
        *((replace(G474, modes=modes), late, most) for modes, late, most in ((2, 0, 0.27), (3, 0, 0.36), (4, 1, 0.46))),
        (replace(G474, modes=5), 2, 0.55),
        (H743, 2, 0.6),
        (replace(H743, bus_cycles=(40, 40)), 2, 0.75),
    ],
)
def test_chunks_ticks_and_locks_are_through_in_time(board: Chip, late_chunks: int, load_max: float) -> None:
    """The longest wait, then the longest interrupt, which is that of a dead-man's trip: the DMA has not come yet.
    A tick that has its own interrupt is through so many chunks later, though those come amid it. RM0440, 3.3.3: 4 wait
    states at 170 MHz, lines of 64 bits as delivered (DBANK); the path runs from the core-coupled memory."""
    lock = longest_lock(live_bench(board, 5000)).cycles
    spent = costs(live_bench(board, 5000), chunks=1300)  # to a dead-man's trip and beyond
    (chunk, tick), chunk_cycles = spent.longest(), CHUNK_S * board.core_hz
    print(
        f"{board.modes} modes: {100 * spent.share(board):.1f} %, longest chunk {chunk}, tick {tick}, lock {lock} cycles"
    )
    assert spent.share(board) <= load_max
    assert lock <= 0.075 * board.modes * chunk_cycles
    assert lock + chunk + INTERRUPT_CYCLES <= (1.0 if board.modes > 2 else 0.85) * DEADLINE_S * board.core_hz
    before = late_chunks * (chunk + INTERRUPT_CYCLES)  # the chunk that begins it, and those amid it
    assert late_chunks == 0 or tick + INTERRUPT_CYCLES + before <= late_chunks * chunk_cycles


@pytest.mark.parametrize("board", [G474, H743], ids=str)
def test_nothing_of_a_chunk_or_a_tick_is_read_from_the_flash(board: Chip) -> None:
    """Neither instructions nor constants: what waits for them would be counted as cycles, and more than one mode's."""
    for law in ("deadbeat", "pi_ff"):
        with_waits = costs(live_bench(board, 5000, law), chunks=40)
        plain = costs(live_bench(replace(board, wait_states=0), 5000, law), chunks=40)
        assert [c.cycles for c in with_waits.chunk] == [c.cycles for c in plain.chunk]
        assert [c.cycles for c in with_waits.tick] == [c.cycles for c in plain.tick]
        assert sum(c.cycles for c in with_waits.main) > sum(c.cycles for c in plain.main)


@every_board
def test_a_quiet_board_that_is_given_another_controller_or_model_waits_no_longer(board: Chip) -> None:
    sections = locked_costs(Bench(board), COMMANDS, ms=12)
    longest = max(sections, key=lambda count: count.cycles)
    print(f"{board}: longest of {len(sections)} locks {longest}")
    assert longest.cycles <= 0.075 * board.modes * CHUNK_S * board.core_hz


@pytest.mark.parametrize(
    ("assembly", "expected"),
    [
        ("add.w r0, r1, r2", 1),
        ("ldr r0, [r1, #4]", 2),
        ("ldr r0, [r1, #4]; ldr r2, [r1, #8]", 3),
        ("adds r1, #4; ldr r0, [r1, #4]", 4),
        ("str r0, [r1, #4]", 1),
        ("stmdb sp!, {r4, r5, r6, lr}", 5),
        ("vmul.f32 s0, s1, s2; vadd.f32 s3, s0, s4", 3),
        ("vmul.f32 s0, s1, s2; vadd.f32 s3, s5, s4", 2),
        ("vdiv.f32 s0, s1, s2", 14),
        ("vpush {s16-s19}", 5),
        ("smlad r0, r1, r2, r3", 1),
        ("udiv r0, r1, r2", 12),
    ],
)
def test_the_timing_model_reads_the_manuals_tables(assembly: str, expected: int) -> None:
    spent, before = 0, None
    for line in assembly.split("; "):
        mnemonic, _, operands = line.partition(" ")
        instruction = image.Instruction(mnemonic, operands, 4)
        spent += cycles(instruction, before)
        before = instruction
    assert spent == expected
