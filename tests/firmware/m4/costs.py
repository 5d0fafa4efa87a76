"""What the flashed program costs, chunk by chunk: its interrupts, its main loop, and what keeps interrupts out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

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

from .bench import Bench
from .chip import Chip
from .timing import INTERRUPT_CYCLES, Count, Flash, Meter

CHUNK_S: Final = 50e-6
DEADLINE_S: Final = 49e-6  # the DMA fetches a word one trigger before it is put out


def live_bench(board: Chip, control_hz: int, law: str = "deadbeat") -> Bench:
    bench = Bench(board, board.image(control_hz))
    bench.to_board += encode(SetController(law))
    bench.arm(1.5 + 0.2j, -0.7, 0.3)
    bench.to_board += device.encode(Keepalive(bench.seq))
    bench.run(1)
    assert bench.amplifiers
    return bench


@dataclass(frozen=True, slots=True)
class Costs:
    """Of the chunks' interrupt, of ticks that have one of their own, and of the main loop, for each chunk."""

    chunk: list[Count]
    tick: list[Count]
    main: list[Count]

    @property
    def load(self) -> float:
        """Cycles of the mean chunk."""
        interrupts = [count.cycles + INTERRUPT_CYCLES for count in self.chunk + self.tick]
        return (sum(interrupts) + sum(count.cycles for count in self.main)) / len(self.chunk)

    def share(self, board: Chip) -> float:
        """Of the processor."""
        return self.load / (CHUNK_S * board.core_hz)

    def longest(self) -> tuple[int, int]:
        """Cycles of the longest chunk and of the longest tick, 0 where it is within the chunk."""
        return max(c.cycles for c in self.chunk), max((c.cycles for c in self.tick), default=0)


def meter_of(bench: Bench) -> Meter:
    board = bench.board
    flash = Flash(board.wait_states, *board.flash_cache) if board.wait_states else None
    return Meter(bench.cpu, flash, bus_cycles=board.bus_cycles)


def costs(bench: Bench, chunks: int) -> Costs:
    meter = meter_of(bench)
    found = Costs([], [], [])
    for _ in range(chunks):
        bench.convert()
        found.chunk.append(meter.measure(lambda: bench.cpu.interrupt(bench.sampling.chunk.irq)))
        if bench.registers.tick_pending:
            found.tick.append(meter.measure(bench.compute_tick))
        found.main.append(meter.measure(bench.come_round))
    meter.remove()
    return found


def locked_costs(bench: Bench, lines: list[bytes], ms: float) -> list[Count]:
    """Of every section in which the main loop keeps the interrupts out, while these lines are taken and answered."""
    sections: list[Count] = []
    lock, unlock = bench.cpu.address("board_lock"), bench.cpu.address("board_unlock")
    meter = meter_of(bench)
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


def longest_lock(bench: Bench) -> Count:
    sections = locked_costs(bench, [long_reference(bench), *COMMANDS], ms=12)
    return max(sections, key=lambda count: count.cycles)
