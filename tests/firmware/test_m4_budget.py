"""What the program costs on its processor: instructions counted in the image, cycles by the manual's tables; and the
registers that its start writes, one by one.
"""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("unicorn", reason="unicorn is not installed")

from hapticd.board_values import (
    ControllerRequest,
    LogRequest,
    ModeModel,
    RawVoltage,
    SelectController,
    SetModel,
    SetTelemetry,
    Stop,
    Sweep,
)
from hapticd.wire import device
from hapticd.wire.commands import encode

from .m4 import image
from .m4.bench import HANDLER, Bench
from .m4.timing import CORE_HZ, INTERRUPT_CYCLES, Count, Meter, cycles

pytestmark = [pytest.mark.long, pytest.mark.skipif(image.MISSING is not None, reason=str(image.MISSING))]

CHUNK_CYCLES = 50e-6 * CORE_HZ
DEADLINE_CYCLES = 49e-6 * CORE_HZ  # the DMA fetches a word one trigger before it is put out
REGISTERS = Path(__file__).parent / "m4" / "start.txt"


def live_bench(control_hz: int, law: str = "deadbeat") -> Bench:
    bench = Bench(image.build(control_hz))
    bench.to_board += encode(SelectController(law))
    bench.arm(1.5 + 0.2j, -0.7)
    bench.to_board += device.encode_keepalive(bench.seq)
    bench.run(1)
    assert bench.amplifiers
    return bench


def chunk_costs(bench: Bench, chunks: int) -> tuple[list[Count], list[Count]]:
    """Of the interrupt and of the main loop, chunk by chunk."""
    meter = Meter(bench.cpu)
    interrupt, main = [], []
    for _ in range(chunks):
        bench.convert()
        interrupt.append(meter.measure(lambda: bench.cpu.interrupt(HANDLER)))
        main.append(meter.measure(bench.come_round))
    meter.remove()
    return interrupt, main


def mean_cycles(counts: list[Count]) -> float:
    return sum(count.cycles for count in counts) / len(counts)


@pytest.mark.parametrize("law", ["pi", "pi_ff", "deadbeat"])
@pytest.mark.parametrize("control_hz", [2000, 5000])
def test_the_whole_program_takes_a_quarter_of_the_processor_and_no_more(control_hz: int, law: str) -> None:
    interrupt, main = chunk_costs(live_bench(control_hz, law), chunks=400)
    load = (mean_cycles(interrupt) + INTERRUPT_CYCLES + mean_cycles(main)) / CHUNK_CYCLES
    plain, tick = min(interrupt, key=lambda c: c.cycles), max(interrupt, key=lambda c: c.cycles)
    name = f"{law} at {control_hz} Hz"
    print(f"{name}: {100 * load:.1f} %; chunk {plain}; with tick {tick}; main loop {mean_cycles(main):.0f}")
    assert load <= 0.25


def test_strokes_that_ask_for_all_the_voltage_fit_into_a_quarter_too() -> None:
    """A hundred frames a second, each with knots to interpolate, and steps that the governor has to divide."""
    bench = live_bench(5000)
    total = 0.0
    for i in range(20):
        bench.reference((0.0, (1.5, -1.0)), (4.0, (1.5 + 0.1 * (i % 5), 1.0)), (5.0, (3.5 * (i % 2), 2.0j)))
        interrupt, main = chunk_costs(bench, chunks=200)
        total += mean_cycles(interrupt) + INTERRUPT_CYCLES + mean_cycles(main)
    load = total / 20 / CHUNK_CYCLES
    print(f"strokes at 5000 Hz: {100 * load:.1f} %")
    assert load <= 0.25


def test_a_chunk_and_a_tick_stay_within_their_instructions() -> None:
    interrupt, _ = chunk_costs(live_bench(2000), chunks=40)
    instructions = sorted(count.instructions for count in interrupt)
    assert instructions[0] <= 1050, "21 per sample: 9 to listen, 10 to speak, 2 for the rest"
    assert instructions[-1] - instructions[0] <= 1500


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
    bench.reference(*[(4.0 * k, (9.0 + 0.02 * k, 7.5j)) for k in range(24)])
    line = bytes(bench.to_board)
    bench.to_board.clear()
    return line


COMMANDS = [
    encode(SelectController("pi_ff")),
    encode(SelectController("deadbeat")),
    encode(SetModel(1, ModeModel(180.0, 60.0, 5.0, 1 + 0j))),
    encode(Sweep(0, 29180.0, 29220.0, points=3, dwell_ms=1, voltage_v=10.0)),
    encode(RawVoltage(0, 10 + 5j, 20)),
    encode(Stop()),
    encode(SetTelemetry(2000)),
    encode(LogRequest()),
    encode(ControllerRequest()),
    device.encode_time_request(1),
    device.encode_clear_fault(),
    device.encode_hello_request(),
]


def busiest_cycles(bench: Bench, chunks: int) -> int:
    return max(count.cycles for count in chunk_costs(bench, chunks)[0]) + INTERRUPT_CYCLES


def test_the_lock_never_makes_a_chunk_of_a_live_board_late() -> None:
    """The longest wait, then the longest interrupt, which is that of a dead-man's trip: the DMA has not come yet."""
    bench = live_bench(2000)
    sections = locked_costs(bench, [long_reference(bench), *COMMANDS], ms=12)
    longest = max(sections, key=lambda count: count.cycles)
    busiest = busiest_cycles(live_bench(2000), chunks=1600)
    print(f"longest of {len(sections)} locks {longest}, busiest interrupt {busiest} cycles")
    assert longest.cycles <= 0.15 * CHUNK_CYCLES
    assert longest.cycles + busiest <= 0.85 * DEADLINE_CYCLES


def test_a_quiet_board_that_is_given_another_controller_or_model_waits_no_longer() -> None:
    sections = locked_costs(Bench(image.build()), COMMANDS, ms=12)
    longest = max(sections, key=lambda count: count.cycles)
    print(f"longest of {len(sections)} locks {longest}")
    assert longest.cycles <= 0.15 * CHUNK_CYCLES


def test_the_start_writes_these_registers_in_this_order() -> None:
    """Addresses of memory are the linker's business. To accept a change, write `text` to the file."""
    trace = Bench(image.build()).registers.trace
    text = "".join(f"{name} {'memory' if name.endswith('M0AR') else f'{value:#010x}'}\n" for name, value in trace)
    assert text == REGISTERS.read_text()


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
