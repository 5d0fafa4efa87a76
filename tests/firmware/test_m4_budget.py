"""What the program costs on its processor: instructions counted in the image, cycles by the manual's tables; and the
registers that its start writes, one by one.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from hapticd.board_values import SetController
from hapticd.wire.commands import encode

from .m4 import image
from .m4.bench import Bench
from .m4.boards import F405, G474, H743, Board, every_board, needs_compiler
from .m4.core import CoreBench
from .m4.costs import CHUNK_S, COMMANDS, DEADLINE_S, Costs, costs, live_bench, locked_costs, longest_lock
from .m4.timing import INTERRUPT_CYCLES, cycles

pytestmark = [pytest.mark.long, needs_compiler]


@every_board
@pytest.mark.parametrize("law", ["pi", "pi_ff", "deadbeat"])
@pytest.mark.parametrize("control_hz", [2000, 5000])
def test_the_whole_program_stays_within_its_share_of_the_processor(board: Board, control_hz: int, law: str) -> None:
    spent = costs(live_bench(board, control_hz, law), chunks=400)
    load = spent.share(board)
    plain, longest = min(spent.chunk, key=lambda c: c.cycles), max(spent.chunk, key=lambda c: c.cycles)
    tick = max(spent.tick, key=lambda c: c.cycles, default=None)
    print(f"{board}: {law} at {control_hz} Hz: {100 * load:.1f} %; chunk {plain}; longest {longest}; tick {tick}")
    assert load <= board.load_max


@every_board
def test_strokes_that_ask_for_all_the_voltage_stay_within_it_too(board: Board) -> None:
    """A hundred frames a second, each with knots to interpolate, and steps that the governor has to divide."""
    bench = live_bench(board, 5000)
    total = 0.0
    for i in range(20):
        knots = ((0.0, (1.5, -1.0, 0.5)), (4.0, (1.5 + 0.1 * (i % 5), 1.0, -0.5)), (5.0, (3.5 * (i % 2), 2.0j, 0.1)))
        bench.reference(*knots)
        total += costs(bench, chunks=200).share(board)
    print(f"{board}: strokes at 5000 Hz: {100 * total / 20:.2f} %")
    assert total / 20 <= board.load_max


def test_a_chunk_and_a_tick_stay_within_their_instructions() -> None:
    instructions = sorted(count.instructions for count in costs(live_bench(F405, 2000), chunks=40).chunk)
    assert instructions[0] <= 950, "19 per sample: 8 to listen, 9 to speak, 2 for the rest"
    assert instructions[-1] - instructions[0] <= 930 * F405.modes


@every_board
def test_the_lock_never_makes_a_chunk_of_a_live_board_late(board: Board) -> None:
    """The longest wait, then the longest interrupt, which is that of a dead-man's trip: the DMA has not come yet."""
    lock = longest_lock(live_bench(board, 2000))
    chunk, _ = costs(live_bench(board, 2000), chunks=1300).longest()
    print(f"{board}: longest lock {lock}, busiest interrupt {chunk + INTERRUPT_CYCLES} cycles")
    assert lock.cycles <= 0.075 * board.modes * CHUNK_S * board.core_hz
    assert lock.cycles + chunk + INTERRUPT_CYCLES <= 0.85 * DEADLINE_S * board.core_hz


@pytest.mark.parametrize(("modes", "late_chunks", "load_max"), [(2, 0, 0.27), (3, 0, 0.36), (4, 1, 0.46), (5, 2, 0.55)])
def test_chunks_and_ticks_of_the_stm32g474_are_through_in_time_with_the_wait_states_of_its_flash(
    modes: int, late_chunks: int, load_max: float
) -> None:
    """RM0440, 3.3.3: 4 wait states at 170 MHz, lines of 64 bits as delivered (DBANK). The path runs from the CCM."""
    board = replace(G474, modes=modes)
    bench = live_bench(board, 5000)
    lock = longest_lock(bench).cycles
    spent = costs(live_bench(board, 5000), chunks=1300)  # to a dead-man's trip and beyond
    chunk, tick = spent.longest()
    print(
        f"{modes} modes: load {100 * spent.share(board):.1f} %, longest chunk {chunk}, tick {tick}, lock {lock} cycles"
    )
    assert spent.share(board) <= load_max
    assert lock + chunk + INTERRUPT_CYCLES <= DEADLINE_S * board.core_hz
    if late_chunks:
        before = late_chunks * (chunk + INTERRUPT_CYCLES)  # the chunk that begins it, and those amid it
        assert tick + INTERRUPT_CYCLES + before <= late_chunks * CHUNK_S * board.core_hz


@pytest.mark.parametrize("board", [G474, H743], ids=str)
def test_nothing_of_a_chunk_or_a_tick_is_read_from_the_flash(board: Board) -> None:
    """Neither instructions nor constants: what waits for them would be counted as cycles, and more than one mode's."""
    for law in ("deadbeat", "pi_ff"):
        with_waits = costs(live_bench(board, 5000, law), chunks=40)
        plain = costs(live_bench(replace(board, wait_states=0), 5000, law), chunks=40)
        assert [c.cycles for c in with_waits.chunk] == [c.cycles for c in plain.chunk]
        assert [c.cycles for c in with_waits.tick] == [c.cycles for c in plain.tick]
        assert sum(c.cycles for c in with_waits.main) > sum(c.cycles for c in plain.main)


@every_board
def test_a_quiet_board_that_is_given_another_controller_or_model_waits_no_longer(board: Board) -> None:
    sections = locked_costs(Bench(board), COMMANDS, ms=12)
    longest = max(sections, key=lambda count: count.cycles)
    print(f"{board}: longest of {len(sections)} locks {longest}")
    assert longest.cycles <= 0.075 * board.modes * CHUNK_S * board.core_hz


MODE_HZ = (29195.0, 29215.0, 29205.0, 29255.0, 29155.0, 29105.0, 29305.0, 29375.0)
HELD_UM = (1.5 + 0.2j, -0.7, 0.3, 0.9, -1.1, 0.4, -0.5, 0.2)


def live_core(modes: int) -> CoreBench:
    """As `live_bench` at 5 kHz, without the board."""
    bench = CoreBench(MODE_HZ[:modes], 5000)
    for _ in range(3):
        bench.hold(HELD_UM[:modes])
    for _ in range(300):
        bench.chunk()
    assert np.abs(bench.measured_um() - HELD_UM[:modes]).max() <= 0.005
    bench.hold(HELD_UM[:modes])
    return bench


def core_costs(modes: int) -> Costs:
    bench = live_core(modes)
    spent = Costs([], [], [])
    for _ in range(400):
        chunk, tick = bench.chunk()
        spent.chunk.append(chunk)
        if tick is not None:
            spent.tick.append(tick)
    return spent


@cache
def beside_the_core() -> tuple[float, int]:
    """What the image for four modes has more: cycles of the mean chunk, and of the longest."""
    image, core = costs(live_bench(G474, 5000), chunks=400), core_costs(4)
    return image.load - core.load, image.longest()[0] - core.longest()[0]


def test_six_modes_would_be_through_in_time_too_had_the_chip_the_converters_and_the_memory() -> None:
    """Without wait states: their path is longer than the 32 KB of the core-coupled memory."""
    spent, (more, more_of_chunk) = core_costs(6), beside_the_core()
    load = (spent.load + more) / (CHUNK_S * G474.core_hz)
    chunk, tick = spent.longest()
    chunk += more_of_chunk
    lock = live_core(6).obeyed(encode(SetController("pi_ff"))).cycles
    print(f"6 modes at 5000 Hz: {100 * load:.1f} %; chunk {chunk}, tick {tick}, lock {lock} cycles")
    assert load <= 0.65
    assert lock + chunk + INTERRUPT_CYCLES <= DEADLINE_S * G474.core_hz
    assert tick + INTERRUPT_CYCLES + 2 * (chunk + INTERRUPT_CYCLES) <= 2 * CHUNK_S * G474.core_hz


@every_board
def test_the_start_writes_these_registers_in_this_order(board: Board) -> None:
    """Sections: at the models' blocks. Addresses of memory are the linker's business. To accept a change, write `text`
    to the file."""
    trace = Bench(board).registers.trace
    memory = ("M0AR", "MPU_RBAR")
    text = "".join(f"{name} {'memory' if name.endswith(memory) else f'{value:#010x}'}\n" for name, value in trace)
    assert text == (Path(__file__).parent / "m4" / f"{board}-start.txt").read_text()


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
