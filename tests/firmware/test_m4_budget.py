"""What the program costs on its processor: instructions counted in the image, cycles by the manual's table."""

from __future__ import annotations

import pytest

pytest.importorskip("unicorn", reason="unicorn is not installed")

from hapticd.values import Knot, LimitReason, SafeDrive
from hapticd.wire import device

from .m4 import image
from .m4.bench import HANDLER, Bench
from .m4.timing import CORE_HZ, INTERRUPT_CYCLES, Count, Meter

pytestmark = pytest.mark.skipif(image.MISSING is not None, reason=str(image.MISSING))

CHUNK_US = 50
CHUNK_CYCLES = CHUNK_US * CORE_HZ / 1e6


def reference(seq: int, t_us: int, knots: int = 1) -> bytes:
    polyline = tuple(Knot(i * 4_000_000, (1.5 - 0.1 * i + 0.2j, -0.7 + 0.05j * i)) for i in range(knots))
    return device.encode_reference(seq, SafeDrive(0, polyline, LimitReason.NONE), t_us)


def live_bench(control_hz: int) -> Bench:
    bench = Bench(image.build(control_hz))
    for seq in (1, 2, 3):
        bench.to_board += reference(seq, bench.registers.now_us)
    bench.run(20)
    bench.to_board += device.encode_keepalive(3)
    bench.run(1)
    assert bench.amplifiers
    return bench


def interrupt_costs(bench: Bench, chunks: int) -> list[Count]:
    meter = Meter(bench.cpu)
    costs = []
    for _ in range(chunks):
        bench.convert()
        meter.start()
        bench.cpu.interrupt(HANDLER)
        costs.append(meter.stop())
        meter.start()
        bench.come_round()
    meter.remove()
    return costs


@pytest.mark.parametrize(("control_hz", "limit"), [(2000, 0.25), (5000, 0.35)])
def test_the_interrupt_takes_its_share_of_the_processor_and_no_more(control_hz: int, limit: float) -> None:
    costs = interrupt_costs(live_bench(control_hz), chunks=200)
    load = sum(count.cycles + INTERRUPT_CYCLES for count in costs) / len(costs) / CHUNK_CYCLES
    print(f"{control_hz} Hz: load {100 * load:.1f} %, {shown(costs)}")
    assert load <= limit


def shown(costs: list[Count]) -> str:
    plain, tick = min(costs, key=lambda c: c.cycles), max(costs, key=lambda c: c.cycles)
    return f"chunk {plain.instructions} instructions, {plain.cycles} cycles; with tick {tick.instructions}, {tick.cycles}"
