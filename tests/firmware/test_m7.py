"""The STM32H743's image for eight modes, as far as emulation and counted cycles go: its registers make two chips of
DACs and three ADCs run at 320 kHz, a plate closes the circle, and all is through in time.

What is assumed and no manual says: how long the core waits for a word beyond its own memories (`m4.boards`), how long
a word takes from its request to the SPI's first clock (`stm32h743._START_S`). Nothing here is about silicon.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hapticd.board_protocol import BoardState, Keepalive, Sweep
from hapticd.board_values import BoardStatus, SweepPoint
from hapticd.design.resonance import fit_resonance
from hapticd.wire import device

from .m4.bench import Bench
from .m4.boards import H743, needs_compiler
from .m4.costs import CHUNK_S, DEADLINE_S, costs, live_bench, longest_lock
from .m4.cpu import SCRATCH, Cpu
from .m4.plate import Plate
from .m4.stm32h743 import Dac
from .m4.timing import INTERRUPT_CYCLES
from .test_m4_bit_exact import CONFIG, Twins, polyline
from .test_m4_pil import run_with_ticks_interrupted

pytestmark = [pytest.mark.long, needs_compiler]

DEADMAN_TRIP, MISSED_CHUNK, CRASH = 64, 66, 68
SUPPLY, AMPLIFIER_FAULT, EMERGENCY_STOP = 98, 99, 100
SOFTWARE_RESET = 1 << 24 | 1 << 22
HARD_FAULT, PVD = 3, 1
MODES, CHUNK = 8, 16
ASKED_UM = (1.5, -0.8j, 0.3, 0.6, -0.4, 0.5, 0.2 + 0.1j, -0.3)
# The DACs move 3.03 us after a sample's period began; a sensor is sampled at a quarter of it and 8.5 cycles of 24 MHz,
# those behind it 15 cycles later each; a word is held for a period.
LAG_S = [3.0260e-6 - (0.78125e-6 + (8.5 + 15 * (k % 3)) / 24e6) + 0.5 / 320e3 for k in range(MODES)]


@pytest.fixture
def bench() -> Bench:
    return Bench(H743)


def live(bench: Bench) -> Bench:
    bench.arm(*ASKED_UM)
    bench.hold(40)
    return bench


def at_mid_rail(bench: Bench) -> bool:
    """What the DACs put out where their pins are moved by hand, and what the streams gave them last."""
    return all(dac.level == [2048] * 4 for dac in bench.registers.dacs)  # type: ignore[attr-defined]


def test_the_registers_make_one_clock_of_320_kilohertz_for_both_directions(bench: Bench) -> None:
    """RM0433, 39.4: TIM2 and TIM3; 25: the ADCs' trigger."""
    assert bench.sampling.sample_hz == 320e3
    assert bench.sampling.samples == 2 * CHUNK
    assert bench.sampling.channels == (2, 6, 15, 2, 5, 10, 4, 6)
    assert bench.wires.core_hz() == H743.core_hz
    assert bench.wires.timer_hz("TIM5") * 2**32 == 1e6
    assert bench.wires.baud() == pytest.approx(921600, rel=0.01)
    assert bench.wires.watchdog_s() == pytest.approx(0.010, abs=0.0005)


def test_the_start_writes_these_registers_in_this_order(bench: Bench) -> None:
    """Addresses of memory are the linker's business; the levels that move the DACs by hand have a test of their own. To
    accept a change, write `text` to the file."""
    memory = ("M0AR", "MPU_RBAR")
    trace = [(name, value) for name, value in bench.registers.trace if not name.endswith(".BSRR")]
    text = "".join(f"{name} {'memory' if name.endswith(memory) else f'{value:#010x}'}\n" for name, value in trace)
    assert text == (Path(__file__).parent / "m4/stm32h743-start.txt").read_text()


def test_the_converters_are_at_mid_rail_before_any_clock_is_set_up() -> None:
    """By their pins alone, and two chips at once: neither an SPI nor the PLL has to work."""
    registers = H743.registers(pll=False)
    cpu = Cpu(H743, H743.image(), read=registers.read, write=registers.write)
    registers.on_reset = cpu.stop
    assert cpu.run_to("main")
    assert [dac.level for dac in registers.dacs] == [[2048] * 4] * 2
    assert {name for name, _ in registers.trace if name.startswith("RCC.")} == {
        "RCC.AHB2ENR",
        "RCC.AHB4ENR",
        "RCC.APB1LENR",
    }
    assert not cpu.run_to("board_wait"), "without any clock the board tries again"
    assert registers.reset_requested
    assert registers.reads < 100_000
    assert not registers["GPIOB.ODR"] & 1 << 12


def test_eight_modes_are_driven_as_asked_and_measured_as_they_move(bench: Bench) -> None:
    live(bench)
    assert bench.amplitudes_um(1) == pytest.approx(np.tile(np.abs(ASKED_UM), (320, 1)), abs=0.02)
    bench.reference((0.0, ASKED_UM))
    bench.hold(20)
    assert bench.status.measured_um == pytest.approx(ASKED_UM, abs=0.02)
    assert not bench.log().entries


@pytest.mark.parametrize("control_hz", [2000, 5000])
@pytest.mark.parametrize(("mode", "target_um", "settled_ms"), [(0, 2.0, 4.5), (5, 0.4, 2.0)])
def test_a_step_settles_and_stays(control_hz: int, mode: int, target_um: float, settled_ms: float) -> None:
    """Within 2 %; three chunks lie between a tick's samples and its voltage. Mode 5 is 100 Hz off the drive."""
    bench = Bench(H743, H743.image(control_hz))
    bench.arm()
    t_asked_us = bench.registers.now_us
    asked = [0.0] * MODES
    asked[mode] = target_um
    bench.reference((0.0, asked))
    bench.hold(40)
    applied = (m for m in bench.messages if isinstance(m, BoardStatus) and m.applied and m.seq == bench.seq)
    begin = round(0.32 * (next(applied).t_applied_us - t_asked_us))
    motion_um = np.abs(np.concatenate(bench.motion_um[-800:]))[begin:]
    stepped_um = motion_um[:, mode]
    outside = np.flatnonzero(np.abs(stepped_um - target_um) > 0.02 * target_um)
    assert outside[-1] / 320 <= settled_ms
    assert stepped_um.max() < 1.02 * target_um
    assert np.delete(motion_um, mode, axis=1).max() < 0.01
    assert np.sqrt(np.mean((stepped_um[-6400:] - target_um) ** 2)) < 0.003


@pytest.mark.parametrize("mode", [0, 4, 2])
def test_a_sweep_finds_the_plate_and_the_lag_of_a_modes_converters(mode: int) -> None:
    bench = Bench(H743)
    f_hz = Plate().mode_hz[mode]
    bench.to_board += device.encode(Sweep(mode, f_hz - 50.0, f_hz + 50.0, points=9, dwell_ms=40, voltage_v=15.0))
    bench.hold(390)
    points = [message for message in bench.messages if isinstance(message, SweepPoint)]
    assert [point.index for point in points] == list(range(9))
    assert not bench.amplifiers
    found = fit_resonance(
        np.array([point.frequency_hz for point in points]),
        np.array([point.measured_um[mode] / point.voltage_v for point in points]),
    )
    assert found.frequency_hz == pytest.approx(f_hz, abs=0.2)
    assert found.q_factor == pytest.approx(500.0, rel=0.01)
    assert found.loop_phase_rad == pytest.approx(-2 * np.pi * 29205.0 * LAG_S[mode], abs=0.006)


def test_each_sample_is_four_words_to_each_chip_and_the_last_moves_all_four(bench: Bench) -> None:
    """AD5624: so the modes move together, whatever the order of their words."""
    live(bench)
    played, lanes = bench.played[-1], bench.sampling.lanes
    for chip in (0, 4):
        words = struct.unpack(f"<{4 * CHUNK}I", bench.cpu.read(lanes[chip].played_at, 16 * CHUNK))
        dac = Dac()
        for i, word in enumerate(words):
            before = list(dac.level)
            dac.take(word)
            assert (dac.level == before) or i % 4 == 3
            assert i % 4 != 3 or dac.level == [w >> 4 & 0xFFF for w in words[i - 3 : i + 1]]
    assert np.ptp(played.astype(int), axis=0).min() > 16, "all eight are driven"


def test_a_program_that_hangs_and_a_debugger_that_halts_it_end_in_a_reset(bench: Bench) -> None:
    """RM0433, 44, 45 and 60 (DBGMCU): both watchdogs count on while the core is halted, TIM2 and TIM3 do not."""
    bench.arm(2.0)
    bench.hold_main = True
    bench.run(20)
    assert bench.starved_us >= 19000
    assert not bench.registers.fed_early
    assert 3 * 1e-6 * bench.chunk_us < bench.wires.window_watchdog_s() <= 0.5e-3
    bench.registers["DBGMCU.APB4FZ1"], bench.registers["DBGMCU.APB3FZ1"] = 1 << 18, 1 << 6  # as a debugger leaves them
    bench.hold_main = False
    bench.come_round()
    bench.run(1)
    freezes = [bench.registers[f"DBGMCU.{name}"] for name in ("APB1LFZ1", "APB3FZ1", "APB4FZ1")]
    assert freezes == [3, 0, 0]


def overrun_an_adc(bench: Bench) -> None:
    bench.registers["ADC3.ISR"] |= 1 << 4


def stall_an_spi(bench: Bench) -> None:
    bench.registers["SPI3.SR"] &= ~(1 << 1)


def put_the_streams_out_of_step(bench: Bench) -> None:
    bench.registers["DMA1_S1.NDTR"] -= 12


def fail_a_transfer(bench: Bench) -> None:
    bench.registers["DMA2.LISR"] |= 8 << 16


@pytest.mark.parametrize(
    "mishap", [Bench.convert, overrun_an_adc, stall_an_spi, put_the_streams_out_of_step, fail_a_transfer, None]
)
def test_lost_samples_end_in_silence_until_the_host_arms_anew(
    bench: Bench, mishap: Callable[[Bench], None] | None
) -> None:
    bench.arm(2.0)
    if mishap is None:
        bench.cpu.interrupt(12)  # a word to the second chip could not be moved
    else:
        bench.convert()
        mishap(bench)
        bench.interrupt()
    assert not bench.enable_line
    assert at_mid_rail(bench)
    bench.restarted()
    bench.come_round()
    bench.hold(15)
    assert bench.at_mid_rail
    assert bench.status.state is BoardState.QUIET
    assert [entry.code for entry in bench.log().entries] == [MISSED_CHUNK, DEADMAN_TRIP]
    bench.arm(2.0)
    bench.hold(20)
    assert bench.amplitudes_um(1)[:, 0] == pytest.approx(2.0, abs=0.04)


def test_chunks_interrupt_a_tick_at_any_instruction_and_the_plate_goes_on_as_asked(bench: Bench) -> None:
    bench.arm(*ASKED_UM)
    rng, interrupted = np.random.default_rng(3), 0
    for _ in range(8):
        bench.to_board += device.encode(Keepalive(bench.seq))
        interrupted += run_with_ticks_interrupted(bench, 150, rng, most=6000)
    assert interrupted >= 120
    assert bench.amplitudes_um(1) == pytest.approx(np.tile(np.abs(ASKED_UM), (320, 1)), abs=0.02)
    assert not bench.log().entries


@pytest.mark.parametrize(("pin", "event"), [(6, AMPLIFIER_FAULT), (7, EMERGENCY_STOP)])
def test_a_circuit_that_opens_ends_the_drive_at_mid_rail(bench: Bench, pin: int, event: int) -> None:
    """PC6 and PC7 by EXTI lines 6 and 7 (RM0433, 12, SYSCFG_EXTICR2, and 20), IRQ 23; closed to ground."""
    assert bench.registers["SYSCFG.EXTICR2"] == 0x2200
    assert bench.registers["EXTI.RTSR"] & 0xC0 == bench.registers["EXTI.IMR"] & 0xC0 == 0xC0
    assert bench.registers["GPIOC.PUPDR"] >> 12 & 0xF == 5
    live(bench)
    bench.registers["GPIOC.IDR"] = 1 << pin
    bench.cpu.interrupt(23)
    assert not bench.enable_line
    assert at_mid_rail(bench)
    bench.restarted()
    bench.come_round()
    bench.arm(2.0)
    assert not bench.amplifiers, "as long as it is open"
    bench.registers["GPIOC.IDR"] = 0
    bench.arm(2.0)
    assert bench.amplifiers
    assert event in [entry.code for entry in bench.log().entries]


def test_a_supply_that_falls_silences_resets_and_is_in_the_log_afterwards(bench: Bench) -> None:
    """RM0433, 6.8, PWR_CR1: the detector at 2.85 V."""
    live(bench)
    assert bench.registers["PWR.CR1"] == 6 << 5 | 1 << 4, "2.85 V"
    bench.cpu.fault(16 + PVD, at=bench.cpu.address("hd_tick"))
    assert bench.registers.reset_requested
    assert not bench.enable_line
    assert at_mid_rail(bench)
    bench.boot(H743.registers(reset_flags=SOFTWARE_RESET))
    assert [entry.code for entry in bench.log().entries][-1] == SUPPLY


@pytest.mark.parametrize("function", ["hd_tick", "board_start"])
def test_a_fault_of_the_processor_silences_resets_and_is_in_the_log_afterwards(bench: Bench, function: str) -> None:
    """With its place: in the flash, or from 0x800000 on in the ITCM."""
    live(bench)
    at = bench.cpu.address(function)
    bench.cpu.fault(HARD_FAULT, at=at)
    assert bench.registers.reset_requested
    assert not bench.enable_line
    assert at_mid_rail(bench)
    bench.boot(H743.registers(reset_flags=SOFTWARE_RESET))
    found = bench.log()
    assert found.reset_cause == 3
    place = at - 0x08000000 if at >= 0x08000000 else 0x800000 + at
    assert (found.entries[-1].code, found.entries[-1].value) == (CRASH, place)


def test_without_the_st_links_clock_the_board_runs_from_the_internal_oscillator() -> None:
    registers = H743.registers(crystal=False)
    bench = Bench(H743, registers=registers)
    assert registers["RCC.PLLCKSELR"] & 3 == 0
    assert bench.wires.core_hz() == H743.core_hz
    assert registers.reads < 60_000, "the wait is bounded"
    assert registers["RCC.CR"] & 1 << 18 == 1 << 18, "the ST-LINK's clock is no crystal (UM2407)"


def test_ticks_of_eight_modes_are_the_hosts_to_the_bit() -> None:
    """On an M7 with its FPU for double precision too, which nothing here uses."""
    twins, now_us = Twins(H743, "hd_init", CONFIG, 10_000), 10_000
    rng = np.random.default_rng(11)
    for i in range(300):
        if i % 25 == 0:
            twins.receive(polyline(rng, i // 25 + 1, now_us, MODES), now_us)
        twins.tick(now_us, rng.normal(0, 0.5, 2 * MODES))
        now_us += 500


def test_the_way_through_the_samples_is_the_cores_to_the_bit() -> None:
    """`framed_listen` and `framed_speak` against `hd_carrier_listen` and `hd_carrier_speak` of the same image: the
    state of the carrier, and the levels."""
    cpu = Cpu(H743, H743.image(), **dict(zip(("read", "write"), _registers(), strict=True)))
    assert cpu.run_to("main")
    converters, core, own, samples, out = (SCRATCH + 0x8000 * i for i in range(1, 6))
    cpu.write(converters, struct.pack("<18f", 29205.0, 5000.0, *[0.01] * 8, *[0.003] * 8))
    for carrier in (core, own):
        assert cpu.call("hd_carrier_init", carrier, converters) & 0xFF
    rng, levels = np.random.default_rng(4), set()
    for i in range(40):
        if i % 4 == 0:
            cpu.write(samples, rng.normal(0, 12, 16).astype("<f4").tobytes())
            for carrier in (core, own):
                cpu.call("hd_carrier_drive", carrier, samples)
        words = rng.integers(0, 4096, (CHUNK, 8)).astype("<u2")
        cpu.write(samples, words.tobytes())
        ready = cpu.call("hd_carrier_listen", core, samples) & 0xFF
        cpu.write(
            samples,
            b"".join(np.ascontiguousarray(words[:, at]).tobytes() for at in (slice(3), slice(3, 6), slice(6, 8))),
        )
        assert cpu.call("framed_listen", own, samples) & 0xFF == ready == (i % 4 == 3)
        cpu.call("hd_carrier_speak", core, out)
        asked = np.frombuffer(cpu.read(out, 16 * CHUNK), "<u2").reshape(CHUNK, 8)
        cpu.write(samples, struct.pack("<II", out, out + 16 * CHUNK))
        cpu.call("framed_speak", own, samples)
        spoken = np.frombuffer(cpu.read(out, 32 * CHUNK), "<u4").reshape(2, CHUNK, 4)
        assert np.array_equal(np.hstack([*spoken]) & 0xFFFF, asked << 4)
        assert np.array_equal(spoken[0] >> 16, np.tile([0, 1, 2, 0x13], (CHUNK, 1)))
        assert cpu.read(core, 400) == cpu.read(own, 400)
        levels.update(asked.ravel().tolist())
    assert len(levels) > 500


def _registers() -> tuple[Callable[[int, int], int], Callable[[int, int, int], None]]:
    registers = H743.registers()
    return registers.read, registers.write


@pytest.mark.parametrize("law", ["deadbeat", "pi_ff"])
@pytest.mark.parametrize("control_hz", [2000, 5000])
def test_the_whole_program_stays_within_its_share_of_the_processor(control_hz: int, law: str) -> None:
    """By the M4's table at the M7's clock, of which no table is published: an upper bound where the M7 does two
    instructions at a time, not where it waits for its longer pipeline."""
    shares = {}
    for waits in ((0, 0), H743.bus_cycles, (40, 40)):
        board = replace(H743, bus_cycles=waits)
        shares[waits] = costs(live_bench(board, control_hz, law), chunks=200).share(board)
    print(f"{law} at {control_hz} Hz: " + ", ".join(f"{waits}: {100 * share:.1f} %" for waits, share in shares.items()))
    assert shares[H743.bus_cycles] <= H743.load_max
    assert shares[0, 0] <= 0.35


@pytest.mark.parametrize("waits", [H743.bus_cycles, (40, 40)])
def test_chunks_and_ticks_are_through_in_time(waits: tuple[int, int]) -> None:
    """Three chunks after its samples a tick's voltage is put out: it has two for itself, less the chunks amid it."""
    board = replace(H743, bus_cycles=waits)
    lock = longest_lock(live_bench(board, 5000)).cycles
    chunk, tick = costs(live_bench(board, 5000), chunks=1300).longest()
    print(f"{waits}: longest chunk {chunk}, tick {tick}, lock {lock} cycles")
    assert lock + chunk + INTERRUPT_CYCLES <= 0.9 * DEADLINE_S * board.core_hz
    assert tick + INTERRUPT_CYCLES + 2 * (chunk + INTERRUPT_CYCLES) <= 0.95 * 2 * CHUNK_S * board.core_hz
