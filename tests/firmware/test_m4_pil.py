"""The flashed program in the loop: the registers it writes make the converters run, and a plate closes the circle."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("unicorn", reason="unicorn is not installed")

from hapticd.board_values import BoardHello, BoardLog, BoardState, BoardStatus, Sweep, SweepPoint
from hapticd.design.resonance import fit_resonance
from hapticd.wire import device, protocol

from .m4 import image, wiring
from .m4.bench import HANDLER, Bench
from .m4.cpu import Cpu
from .m4.peripherals import COMPLETE, HALF, Peripherals
from .m4.plate import Plate

pytestmark = [pytest.mark.long, pytest.mark.skipif(image.MISSING is not None, reason=str(image.MISSING))]

SOFTWARE_RESET = 1 << 28 | 1 << 26
WATCHDOG_RESET = 1 << 29 | 1 << 26
DEADMAN_TRIP, MISSED_CHUNK, SLOW_CLOCK, CRASH = 64, 66, 67, 68
DEADMAN_MS = 50
RAMP_MS = 10


@pytest.fixture
def bench() -> Bench:
    return Bench(image.build())


def last_status(bench: Bench) -> BoardStatus:
    return [message for message in bench.messages if isinstance(message, BoardStatus)][-1]


def log(bench: Bench) -> BoardLog:
    bench.to_board += device.encode_log_request()
    bench.run(5)
    return [message for message in bench.messages if isinstance(message, BoardLog)][-1]


def test_the_registers_make_one_clock_of_a_megahertz_for_both_directions(bench: Bench) -> None:
    assert bench.sampling.sample_hz == 1e6
    assert bench.sampling.words == 100
    assert bench.sampling.channels == (1, 2)
    assert wiring.core_hz(bench.registers) == 168e6
    assert wiring.timer_hz(bench.registers, "TIM5") * 2**32 == 1e6
    assert wiring.baud(bench.registers) == pytest.approx(921600, rel=0.01)


def test_the_converters_are_at_mid_rail_before_anything_else(bench: Bench) -> None:
    names = [name for name, _ in bench.registers.trace]
    silent_at = names.index("DAC.CR")
    clocks = ["SCB.CPACR", "RCC.AHB1ENR", "RCC.APB1ENR"]
    assert names[:silent_at] == [*clocks, "GPIOB.BSRR", "GPIOB.MODER", "TIM2.CR1", "DAC.DHR12LD"]
    assert dict(bench.registers.trace[:silent_at])["DAC.DHR12LD"] == 0x80008000
    assert not bench.amplifiers


@pytest.mark.parametrize("control_hz", [2000, 5000])
@pytest.mark.parametrize(("target_um", "settled_ms"), [(2.0, 4.0), (0.4, 1.2)])
def test_a_step_settles_and_stays(control_hz: int, target_um: float, settled_ms: float) -> None:
    """Within 2 %, from the tick that took the frame on. The amplifiers' 150 V alone bound 2 um to 3.4 ms. A lag of the
    converters that the firmware did not know of, 16 degrees, would cost the small step 4 ms and 9 % of overshoot.
    """
    bench = Bench(image.build(control_hz))
    bench.arm(0j, 0j)
    t_asked_us = bench.registers.now_us
    bench.reference((0.0, (target_um, 0.0)))
    bench.hold(40)
    applied = (m for m in bench.messages if isinstance(m, BoardStatus) and m.applied and m.seq == bench.seq)
    stepped_um, still_um = bench.amplitudes_um(40)[next(applied).t_applied_us - t_asked_us :].T
    outside = np.flatnonzero(np.abs(stepped_um - target_um) > 0.02 * target_um)
    assert outside[-1] / 1000 <= settled_ms
    assert stepped_um.max() < 1.02 * target_um
    assert still_um.max() < 0.002
    assert np.sqrt(np.mean((stepped_um[-20000:] - target_um) ** 2)) < 0.002


def test_a_sweep_finds_the_plate_and_the_lag_of_the_converters(bench: Bench) -> None:
    """Amplifiers and sensors add no phase here: what is left is a sample and a half, 15.8 degrees at the drive."""
    bench.to_board += device.encode_sweep(Sweep(1, 29165.0, 29265.0, points=9, dwell_ms=40, voltage_v=15.0))
    bench.hold(390)
    points = [message for message in bench.messages if isinstance(message, SweepPoint)]
    assert [point.index for point in points] == list(range(9))
    assert not bench.amplifiers
    assert bench.at_mid_rail
    found = fit_resonance(
        np.array([point.frequency_hz for point in points]),
        np.array([point.measured_um[1] / point.voltage_v for point in points]),
    )
    assert found.frequency_hz == pytest.approx(29215.0, abs=0.1)
    assert found.q_factor == pytest.approx(500.0, rel=0.005)
    assert found.loop_phase_rad == pytest.approx(-2 * np.pi * 29205.0 * 1.5e-6, abs=0.005)


def test_the_board_measures_what_the_plate_does(bench: Bench) -> None:
    bench.arm(1.5j, -0.8)
    bench.hold(120)
    truth_um = bench.amplitudes_um(1).mean(axis=0)
    measured_um = last_status(bench).measured_um
    assert np.abs(measured_um) == pytest.approx(truth_um, abs=0.005)
    assert measured_um == pytest.approx((1.5j, -0.8), abs=0.01)


def test_a_silent_host_ends_in_mid_rail_with_the_amplifiers_off(bench: Bench) -> None:
    bench.arm(2.0, 1.0)
    bench.to_board += device.encode_keepalive(bench.seq)
    bench.run(DEADMAN_MS - 1)
    assert bench.amplifiers
    bench.run(RAMP_MS + 3)
    assert bench.at_mid_rail
    assert not bench.amplifiers
    bench.run(100)
    assert last_status(bench).deadman_trips == 1


def test_the_watchdog_is_fed_only_while_both_main_loop_and_tick_live(bench: Bench) -> None:
    bench.run(20)
    assert bench.starved_us <= 500
    bench.hold_main = True
    bench.run(20)
    assert bench.starved_us >= 19000
    assert wiring.watchdog_s(bench.registers) == pytest.approx(0.010, abs=0.0005)


def lose_a_chunk(bench: Bench) -> None:
    bench.convert()
    bench.convert()


def underrun_the_dac(bench: Bench) -> None:
    bench.convert()
    bench.registers["DAC.SR"] |= 1 << 13


def overrun_the_adc(bench: Bench) -> None:
    bench.convert()
    bench.registers["ADC1.SR"] |= 1 << 5


def put_the_streams_out_of_step(bench: Bench) -> None:
    bench.convert()
    bench.registers["DMA1_S5.NDTR"] += 5


def fail_a_transfer(bench: Bench) -> None:
    bench.convert()
    bench.registers["DMA2.LISR"] |= 1 << 3


@pytest.mark.parametrize(
    "mishap", [lose_a_chunk, underrun_the_dac, overrun_the_adc, put_the_streams_out_of_step, fail_a_transfer]
)
def test_lost_samples_end_in_silence_until_the_host_arms_anew(bench: Bench, mishap: object) -> None:
    bench.arm(2.0, 0.0)
    mishap(bench)  # type: ignore[operator]
    bench.cpu.interrupt(HANDLER)
    assert not bench.amplifiers
    bench.restarted()
    bench.come_round()
    bench.hold(15)
    assert not bench.amplifiers
    assert bench.at_mid_rail
    assert last_status(bench).state is BoardState.QUIET
    assert [entry.code for entry in log(bench).entries] == [MISSED_CHUNK, DEADMAN_TRIP]
    bench.arm(2.0, 0.0)
    bench.hold(20)
    assert bench.amplitudes_um(1)[:, 0] == pytest.approx(2.0, abs=0.04)


@pytest.mark.parametrize("moment", ["on_look", "on_clear"])
def test_a_chunk_filled_too_late_is_a_lost_one(bench: Bench, moment: str) -> None:
    """While the handler works the DMA goes on: when the other half is through, what was filled is being played. Its
    flag may come at any moment, and the interrupt that it latched ends with the restart: one chunk is lost, not two.
    """
    bench.arm(2.0, 0.0)
    bench.convert()
    other = bench.registers["DMA2.LISR"] ^ (HALF | COMPLETE)

    def other_half_is_through() -> None:
        setattr(bench.registers, moment, lambda: None)
        bench.registers["DMA2.LISR"] |= other
        bench.registers.pending = True

    setattr(bench.registers, moment, other_half_is_through)
    bench.cpu.interrupt(HANDLER)
    assert not bench.amplifiers
    if bench.registers.pending:
        bench.cpu.interrupt(HANDLER)
    bench.restarted()
    bench.come_round()
    assert [entry.code for entry in log(bench).entries] == [MISSED_CHUNK, DEADMAN_TRIP]


def test_a_chunk_may_interrupt_the_main_loop_anywhere_outside_the_lock() -> None:
    """The same frames, with the interrupt at random places: the plate ends where it should, and no frame is lost."""
    bench = Bench(image.build())
    rng = np.random.default_rng(5)
    inside = 0
    for i in range(40):
        bench.reference(*[(4.0 * k, (1.0 + 0.02 * k, 0.5j)) for k in range(1 + i % 24)])
        for _ in range(200):
            bench.convert()
            done = bench.come_round(instructions=int(rng.integers(1, 3000)))
            while bench.cpu.masked:
                inside += 1
                done = bench.come_round(instructions=1)
            bench.cpu.interrupt(HANDLER)
            if not done:
                bench.come_round()
    assert last_status(bench).bad_frames == 0
    assert last_status(bench).seq == 40
    assert bench.amplitudes_um(1)[:, 1] == pytest.approx(0.5, abs=0.02)


def test_a_dead_crystal_leaves_a_board_that_talks_and_never_drives() -> None:
    registers = Peripherals(crystal=False)
    bench = Bench(image.build(), registers=registers)
    assert not registers["RCC.PLLCFGR"] >> 22 & 1
    assert wiring.core_hz(registers) == 168e6
    assert registers.reads < 50_000, "the wait is bounded"
    bench.to_board += device.encode_hello_request()
    bench.run(5)
    bench.arm(2.0, 0.0)
    bench.hold(120)
    assert isinstance(bench.messages[0], BoardHello)
    assert last_status(bench).state is BoardState.FAULT
    assert "config" in protocol.FAULTS[last_status(bench).fault_code]
    assert not bench.amplifiers
    assert bench.at_mid_rail
    assert log(bench).entries[-1].code == SLOW_CLOCK


def test_without_any_clock_the_board_tries_again_in_silence() -> None:
    registers = Peripherals(pll=False)
    cpu = Cpu(image.build(), read=registers.read, write=registers.write)
    registers.on_reset = cpu.stop
    assert not cpu.run_to("board_wait")
    assert registers.reset_requested
    assert registers.reads < 100_000
    assert not registers["GPIOB.ODR"]
    assert registers["DAC.DHR12LD"] == 0x80008000
    assert registers["DAC.CR"] == 0x00010001


def test_without_samples_the_main_loop_stays_awake_to_say_so() -> None:
    """No chunk will ever wake it: an amplifier gain that makes no sense must not leave a board that does not answer."""
    registers = Peripherals()
    cpu = Cpu(image.build(), read=registers.read, write=registers.write)
    assert cpu.run_to("hd_carrier_init")
    cpu.return_now(False)
    assert cpu.run_to("board_wait")
    assert registers.t_fed_us is None
    reads = registers.reads
    assert not cpu.run_to("main", instructions=1000)
    assert registers.reads > reads + 10, "it looks at the line, round after round"


def test_a_fault_of_the_processor_silences_resets_and_is_in_the_log_afterwards(bench: Bench) -> None:
    bench.arm(2.0, 0.0)
    bench.cpu.fault("crash_handler", at=bench.cpu.address("hd_tick"))
    assert bench.registers.reset_requested
    assert not bench.amplifiers
    assert bench.registers["DAC.CR"] == 0x00010001
    assert not bench.registers["TIM2.CR1"] & 1
    bench.boot(Peripherals(reset_flags=SOFTWARE_RESET))
    found = log(bench)
    assert found.reset_cause == 3
    assert (found.entries[-1].code, found.entries[-1].value) == (CRASH, bench.cpu.address("hd_tick") - 0x08000000)


def test_every_boot_has_another_identity_and_knows_its_cause(bench: Bench) -> None:
    identities, causes = set(), []
    for flags in (0x0E000000, WATCHDOG_RESET, SOFTWARE_RESET, 1 << 26, 1 << 25 | 1 << 26, 1 << 31 | 1 << 26):
        bench.boot(Peripherals(reset_flags=flags))
        bench.to_board += device.encode_hello_request()
        causes.append(log(bench).reset_cause)
        identities.add([message for message in bench.messages if isinstance(message, BoardHello)][-1].boot_id)
    assert len(identities) == 6
    assert causes == [1, 4, 3, 2, 5, 6]


def test_a_plate_that_resonates_elsewhere_is_still_driven_as_asked() -> None:
    bench = Bench(image.build(), plate=Plate(mode_hz=(29200.0, 29210.0), quality=350.0))
    bench.arm(1.0, 1.0)
    bench.hold(60)
    assert bench.amplitudes_um(1) == pytest.approx(1.0, abs=0.02)
