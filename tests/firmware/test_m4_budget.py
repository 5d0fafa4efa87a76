"""What the program costs on its processor: instructions counted in the image, cycles by the manual's tables; and the
registers that its start writes, one by one.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.board_protocol import (
    ClearFault,
    ControllerRequest,
    HelloRequest,
    Keepalive,
    LogRequest,
    RawVoltage,
    SetTelemetry,
    Stop,
    Sweep,
    TimeRequest,
)
from hapticd.board_values import ModeModel, SetController, SetModel
from hapticd.wire import device
from hapticd.wire.commands import encode

from .m4 import image
from .m4.bench import Bench
from .m4.boards import F405, G474, Board, every_board, needs_compiler
from .m4.core import CoreBench
from .m4.timing import INTERRUPT_CYCLES, Count, Meter, cycles

pytestmark = [pytest.mark.long, needs_compiler]

CHUNK_S = 50e-6
DEADLINE_S = 49e-6  # the DMA fetches a word one trigger before it is put out


def live_bench(board: Board, control_hz: int, law: str = "deadbeat") -> Bench:
    bench = Bench(board, board.image(control_hz))
    bench.to_board += encode(SetController(law))
    bench.arm(1.5 + 0.2j, -0.7, 0.3)
    bench.to_board += device.encode(Keepalive(bench.seq))
    bench.run(1)
    assert bench.amplifiers
    return bench


def chunk_costs(bench: Bench, chunks: int) -> tuple[list[Count], list[Count]]:
    """Of the interrupt and of the main loop, chunk by chunk."""
    meter = Meter(bench.cpu)
    interrupt, main = [], []
    for _ in range(chunks):
        bench.convert()
        interrupt.append(meter.measure(bench.interrupt))
        main.append(meter.measure(bench.come_round))
    meter.remove()
    return interrupt, main


def mean_cycles(counts: list[Count]) -> float:
    return sum(count.cycles for count in counts) / len(counts)


def share(bench: Bench, interrupt: list[Count], main: list[Count]) -> float:
    """Of the processor."""
    spent = mean_cycles(interrupt) + INTERRUPT_CYCLES + mean_cycles(main)
    return spent / (CHUNK_S * bench.board.core_hz)


@every_board
@pytest.mark.parametrize("law", ["pi", "pi_ff", "deadbeat"])
@pytest.mark.parametrize("control_hz", [2000, 5000])
def test_the_whole_program_stays_within_its_share_of_the_processor(board: Board, control_hz: int, law: str) -> None:
    bench = live_bench(board, control_hz, law)
    interrupt, main = chunk_costs(bench, chunks=400)
    load = share(bench, interrupt, main)
    plain, tick = min(interrupt, key=lambda c: c.cycles), max(interrupt, key=lambda c: c.cycles)
    name = f"{board}: {law} at {control_hz} Hz"
    print(f"{name}: {100 * load:.1f} %; chunk {plain}; with tick {tick}; main loop {mean_cycles(main):.0f}")
    assert load <= board.load_max


@every_board
def test_strokes_that_ask_for_all_the_voltage_stay_within_it_too(board: Board) -> None:
    """A hundred frames a second, each with knots to interpolate, and steps that the governor has to divide."""
    bench = live_bench(board, 5000)
    total = 0.0
    for i in range(20):
        knots = ((0.0, (1.5, -1.0, 0.5)), (4.0, (1.5 + 0.1 * (i % 5), 1.0, -0.5)), (5.0, (3.5 * (i % 2), 2.0j, 0.1)))
        bench.reference(*knots)
        total += share(bench, *chunk_costs(bench, chunks=200))
    print(f"{board}: strokes at 5000 Hz: {100 * total / 20:.2f} %")
    assert total / 20 <= board.load_max


@every_board
def test_a_chunk_and_a_tick_stay_within_their_instructions(board: Board) -> None:
    interrupt, _ = chunk_costs(live_bench(board, 2000), chunks=40)
    instructions = sorted(count.instructions for count in interrupt)
    if board is F405:
        assert instructions[0] <= 1050, "21 per sample: 9 to listen, 10 to speak, 2 for the rest"
    assert instructions[-1] - instructions[0] <= 825 * board.modes


def locked_costs(bench: Bench, lines: list[bytes], ms: float) -> list[Count]:
    """Of every section in which the main loop keeps the interrupt out, while these lines are taken and answered."""
    sections: list[Count] = []
    lock, unlock = bench.cpu.address("board_lock"), bench.cpu.address("board_unlock")
    meter = Meter(bench.cpu)
    meter.watch(lock, meter.start)
    meter.watch(unlock, lambda: sections.append(meter.stop()))
    for line in lines:
        bench.to_board += line
        bench.run(ms)
    meter.remove()
    return sections


def long_reference(bench: Bench) -> bytes:
    bench.reference(*[(4.0 * k, (9.0 + 0.02 * k, 7.5j, -8.0)) for k in range(24)])
    line = bytes(bench.to_board)
    bench.to_board.clear()
    return line


COMMANDS = [
    encode(SetController("pi_ff")),
    encode(SetController("deadbeat")),
    encode(SetModel(1, ModeModel(180.0, 60.0, 5.0, 1 + 0j))),
    encode(Sweep(0, 29180.0, 29220.0, points=3, dwell_ms=1, voltage_v=10.0)),
    encode(RawVoltage(0, 10 + 5j, 20)),
    encode(Stop()),
    encode(SetTelemetry(2000)),
    encode(LogRequest()),
    encode(ControllerRequest()),
    device.encode(TimeRequest(1)),
    device.encode(ClearFault()),
    device.encode(HelloRequest()),
]


@every_board
def test_the_lock_never_makes_a_chunk_of_a_live_board_late(board: Board) -> None:
    """The longest wait, then the longest interrupt, which is that of a dead-man's trip: the DMA has not come yet."""
    bench = live_bench(board, 2000)
    sections = locked_costs(bench, [long_reference(bench), *COMMANDS], ms=12)
    longest = max(sections, key=lambda count: count.cycles)
    interrupt, _ = chunk_costs(live_bench(board, 2000), chunks=1300)
    busiest = max(count.cycles for count in interrupt) + INTERRUPT_CYCLES
    print(f"{board}: longest of {len(sections)} locks {longest}, busiest interrupt {busiest} cycles")
    assert longest.cycles <= 0.075 * board.modes * CHUNK_S * board.core_hz
    assert longest.cycles + busiest <= 0.85 * DEADLINE_S * board.core_hz


@every_board
def test_a_quiet_board_that_is_given_another_controller_or_model_waits_no_longer(board: Board) -> None:
    sections = locked_costs(Bench(board), COMMANDS, ms=12)
    longest = max(sections, key=lambda count: count.cycles)
    print(f"{board}: longest of {len(sections)} locks {longest}")
    assert longest.cycles <= 0.075 * board.modes * CHUNK_S * board.core_hz


MODE_HZ = (29195.0, 29215.0, 29205.0, 29255.0, 29155.0, 29105.0, 29305.0, 29375.0)
HELD_UM = (1.5 + 0.2j, -0.7, 0.3, 0.9, -1.1, 0.4, -0.5, 0.2)


def figures(counts: list[Count], beside_cycles: float = 0.0) -> npt.NDArray[np.float64]:
    """Instructions and cycles of a chunk, and of the longest; cycles of the mean, with what is added to it."""
    plain, longest = min(counts, key=lambda c: c.cycles), max(counts, key=lambda c: c.cycles)
    every = mean_cycles(counts) + beside_cycles
    return np.array([plain.instructions, plain.cycles, longest.instructions, longest.cycles, every])


def live_core(modes: int, control_hz: int) -> CoreBench:
    """As `live_bench`, without the board."""
    bench = CoreBench(MODE_HZ[:modes], control_hz)
    for _ in range(3):
        bench.hold(HELD_UM[:modes])
    for _ in range(300):
        bench.chunk()
    assert np.abs(bench.measured_um() - HELD_UM[:modes]).max() <= 0.005
    bench.hold(HELD_UM[:modes])
    return bench


def core_figures(modes: int, control_hz: int, chunks: int = 100) -> npt.NDArray[np.float64]:
    bench = live_core(modes, control_hz)
    return figures([bench.chunk() for _ in range(chunks)])


@cache
def beside_the_core(control_hz: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """What the STM32G474's images have more: with three modes, and for each further one."""
    more = []
    for modes in (2, 3):
        interrupt, main = chunk_costs(live_bench(replace(G474, modes=modes), control_hz), chunks=100)
        more.append(figures(interrupt, INTERRUPT_CYCLES + mean_cycles(main)) - core_figures(modes, control_hz))
    return more[1], more[1] - more[0]


@pytest.mark.parametrize(("modes", "load_max"), [(4, 0.45), (5, 0.55), (6, 0.70), (8, 0.95)])
def test_of_four_to_eight_modes_the_stm32g474_would_have_the_load_but_only_four_in_time(
    modes: int, load_max: float
) -> None:
    """A chunk with a tick has to be done before the next one is over, whatever the control rate."""
    for control_hz in (2000, 5000):
        with_three, per_mode = beside_the_core(control_hz)
        board = with_three + (modes - 3) * per_mode
        whole = core_figures(modes, control_hz) + board
        load = whole[-1] / (CHUNK_S * G474.core_hz)
        print(f"{modes} modes at {control_hz} Hz: {100 * load:.1f} %; chunk; with tick: {np.rint(whole[:-1])}")
        assert load <= load_max
    lock = live_core(modes, 2000).obeyed(encode(SetController("pi_ff"))).cycles
    trip = core_figures(modes, 2000, chunks=1600)[3] + board[3]
    room = DEADLINE_S * G474.core_hz - INTERRUPT_CYCLES
    print(f"of {room:.0f} cycles: tick {whole[3]:.0f}, dead-man's trip {trip:.0f}, either after a lock of {lock}")
    assert (trip <= room) == (whole[3] + lock <= room) == (modes == 4)


@every_board
def test_the_start_writes_these_registers_in_this_order(board: Board) -> None:
    """Addresses of memory are the linker's business. To accept a change, write `text` to the file."""
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
