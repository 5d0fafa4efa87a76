"""The flashed program in the loop: the registers it writes make the converters run, and a plate closes the circle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from hapticd.board_protocol import BoardState, HelloRequest, Keepalive, Sweep
from hapticd.board_values import BoardHello, BoardStatus, SweepPoint
from hapticd.design.resonance import fit_resonance
from hapticd.wire import device

from .m4.bench import TICK, Bench
from .m4.boards import BOARDS, G474, Board, every_chip, needs_compiler
from .m4.cpu import Cpu
from .m4.peripherals import Peripherals
from .m4.plate import Plate

pytestmark = [pytest.mark.long, needs_compiler]

SOFTWARE_RESET = 1 << 28 | 1 << 26
DEADMAN_TRIP, MISSED_CHUNK, CRASH = 64, 66, 68
DEADMAN_MS = 50
RAMP_MS = 10
HARD_FAULT = 3


@pytest.fixture(params=BOARDS, ids=str)
def board(request: pytest.FixtureRequest) -> Board:
    return request.param


@pytest.fixture
def bench(board: Board) -> Bench:
    return Bench(board)


def test_the_registers_make_one_clock_of_a_megahertz_for_both_directions(bench: Bench) -> None:
    """RM0090, 13.6 and 14.3.6; RM0440, 21.7.4 and 22.7.1: TIM2's trigger. The ADCs sample half a period after the DACs
    move."""
    assert bench.sampling.sample_hz == 1e6
    assert bench.sampling.samples == 100
    assert bench.sampling.delay_frac == 0.5
    assert bench.sampling.channels == (1, 2, 12, 5)[: bench.board.modes]
    assert bench.wires.core_hz() == bench.board.core_hz
    assert bench.wires.timer_hz("TIM5") * 2**32 == 1e6
    assert bench.wires.baud() == pytest.approx(921600, rel=0.01)


def test_the_converters_are_at_mid_rail_before_anything_else(bench: Bench) -> None:
    """RM0090, 14.3.4; RM0440, 22.4.5: without a trigger a word is put out a cycle after it was written."""
    names = [name for name, _ in bench.registers.trace]
    dacs = [name for name in ("DAC.CR", "DAC1.CR", "DAC2.CR", "DAC3.CR") if name in names]
    silent = bench.registers.trace[: max(names.index(name) for name in dacs)]
    before = {"SCB.CPACR", "RCC.AHB1ENR", "RCC.AHB2ENR", "RCC.APB1ENR", "RCC.APB1ENR1", "TIM2.CR1"}
    before |= {"RCC.APB2ENR"} if bench.board.modes > 3 else set()  # of the amplifiers that follow DAC3
    assert {name for name, _ in silent if not name.startswith(("GPIO", "DAC"))} <= before
    assert {value for name, value in silent if ".DHR" in name} <= {0x08000800, 0x800}
    assert not bench.amplifiers


@pytest.mark.parametrize("control_hz", [2000, 5000])
@pytest.mark.parametrize(("target_um", "settled_ms"), [(2.0, 4.0), (0.4, 1.2)])
def test_a_step_settles_and_stays(board: Board, control_hz: int, target_um: float, settled_ms: float) -> None:
    """Within 2 %, from the tick that took the frame on. The amplifiers' 150 V alone bound 2 um to 3.4 ms. A lag of the
    converters that the firmware did not know of would cost the small step milliseconds and percents of overshoot.
    """
    bench = Bench(board, board.image(control_hz))
    bench.arm()
    t_asked_us = bench.registers.now_us
    bench.reference((0.0, (target_um,)))
    bench.hold(40)
    applied = (m for m in bench.messages if isinstance(m, BoardStatus) and m.applied and m.seq == bench.seq)
    stepped_um, *still_um = bench.amplitudes_um(40)[next(applied).t_applied_us - t_asked_us :].T
    outside = np.flatnonzero(np.abs(stepped_um - target_um) > 0.02 * target_um)
    assert outside[-1] / 1000 <= settled_ms
    assert stepped_um.max() < 1.02 * target_um
    assert np.max(still_um) < 0.003  # what the learned coupling makes of the converters' noise
    assert np.sqrt(np.mean((stepped_um[-20000:] - target_um) ** 2)) < 0.002


@pytest.mark.parametrize("control_hz", [2000, 5000])
@pytest.mark.parametrize("modes", [2, 3, 5])
def test_the_board_of_four_modes_is_built_for_others_as_well(modes: int, control_hz: int) -> None:
    """RM0440, 21.4.4 and 25.5.6, and DS12288: the fifth mode's sensor is ADC5_IN2 at PA9, its drive DAC3_1 by way of
    OPAMP6 at PB11."""
    board = replace(G474, modes=modes)
    bench = Bench(board, board.image(control_hz))
    assert bench.sampling.channels == (1, 2, 12, 5, 2)[:modes]
    bench.arm(1.5, -0.8j, 0.3, 0.6, -0.4)
    bench.hold(40)
    assert bench.amplitudes_um(1) == pytest.approx(np.tile((1.5, 0.8, 0.3, 0.6, 0.4)[:modes], (1000, 1)), abs=0.02)


def run_with_ticks_interrupted(bench: Bench, chunks: int, rng: np.random.Generator, most: int = 2500) -> int:
    """Each tick is interrupted by its next chunk after some of `most` instructions. Returns how many were."""
    interrupted = 0
    for _ in range(chunks):
        bench.convert()
        bench.cpu.interrupt(bench.sampling.irq)
        if bench.registers.tick_pending:
            bench.registers.tick_pending = False
            bench.convert()
            next_chunk = partial(bench.cpu.interrupt, bench.sampling.irq)
            bench.cpu.interrupt(TICK, amid=next_chunk, instructions=int(rng.integers(1, most)))
            interrupted += 1
        bench.come_round()
    return interrupted


@pytest.mark.parametrize("modes", [4, 5])
def test_chunks_interrupt_a_tick_at_any_instruction_and_the_plate_goes_on_as_asked(modes: int) -> None:
    """PM0214, 4.4.3: PendSV, below the chunks. With four modes this is a voltage that comes a chunk after it is due."""
    bench = Bench(replace(G474, modes=modes))
    bench.arm(1.5, -0.8j, 0.3, 0.6, -0.4)
    interrupted = 0
    for _ in range(8):
        bench.to_board += device.encode(Keepalive(bench.seq))
        interrupted += run_with_ticks_interrupted(bench, 180, np.random.default_rng(3))
    assert interrupted >= 140
    assert bench.amplitudes_um(1) == pytest.approx(np.tile((1.5, 0.8, 0.3, 0.6, 0.4)[:modes], (1000, 1)), abs=0.02)
    assert not bench.log().entries


def test_samples_lost_amid_a_tick_void_it() -> None:
    """The outputs are silent at once; the core hears of it when the tick it was in is over."""
    bench = Bench(G474)
    bench.arm(2.0)
    while not bench.registers.tick_pending:
        bench.convert()
        bench.cpu.interrupt(bench.sampling.irq)
    bench.registers.tick_pending = False

    def lose_a_chunk() -> None:
        bench.convert()
        bench.convert()
        bench.cpu.interrupt(bench.sampling.irq)
        assert not bench.enable_line

    bench.cpu.interrupt(TICK, amid=lose_a_chunk, instructions=700)
    assert not bench.enable_line
    bench.restarted()
    bench.come_round()
    bench.hold(15)
    assert bench.at_mid_rail
    assert not bench.amplifiers
    assert bench.status.state is BoardState.QUIET
    assert [entry.code for entry in bench.log().entries] == [MISSED_CHUNK, DEADMAN_TRIP]


def test_a_tick_that_is_not_over_when_the_next_begins_is_a_lost_chunk() -> None:
    bench = Bench(G474)
    bench.arm(2.0)
    for _ in range(20):  # two ticks' chunks, and no tick comes to compute
        bench.convert()
        bench.cpu.interrupt(bench.sampling.irq)
    assert not bench.enable_line
    bench.cpu.interrupt(TICK)
    bench.restarted()
    bench.hold(15)
    assert bench.at_mid_rail
    assert [entry.code for entry in bench.log().entries] == [MISSED_CHUNK, DEADMAN_TRIP]


def test_a_sweep_finds_the_plate_and_the_lag_of_the_converters(bench: Bench) -> None:
    """Amplifiers and sensors add no phase here: what is left is a sample, 10.5 degrees at the drive."""
    bench.to_board += device.encode(Sweep(1, 29165.0, 29265.0, points=9, dwell_ms=40, voltage_v=15.0))
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
    assert found.loop_phase_rad == pytest.approx(-2 * np.pi * 29205.0 * 1.0e-6, abs=0.005)


def test_the_board_measures_what_the_plate_does(bench: Bench) -> None:
    asked_um = (1.5j, -0.8, 0.6 + 0.3j, -0.4)[: bench.board.modes]
    bench.arm(*asked_um)
    bench.hold(120)
    truth_um = bench.amplitudes_um(1).mean(axis=0)
    measured_um = bench.status.measured_um
    assert np.abs(measured_um) == pytest.approx(truth_um, abs=0.005)
    assert measured_um == pytest.approx(asked_um, abs=0.01)


@every_chip
def test_a_silent_host_ends_in_mid_rail_with_the_amplifiers_off(bench: Bench) -> None:
    bench.arm(2.0, 1.0)
    bench.to_board += device.encode(Keepalive(bench.seq))
    bench.run(DEADMAN_MS - 1)
    assert bench.amplifiers
    bench.run(RAMP_MS + 3)
    assert bench.at_mid_rail
    assert not bench.amplifiers
    bench.run(100)
    assert bench.status.deadman_trips == 1


def test_the_watchdog_is_fed_only_while_both_main_loop_and_tick_live(bench: Bench) -> None:
    """RM0090, 21.4; RM0440, 35.4."""
    bench.run(20)
    assert bench.starved_us <= 500
    bench.hold_main = True
    bench.run(20)
    assert bench.starved_us >= 19000
    assert not bench.registers.fed_early, "before its reload was taken on: it would wait for 512 ms"
    assert bench.wires.watchdog_s() == pytest.approx(0.010, abs=0.0005)


def test_a_program_that_hangs_repeats_its_last_samples_for_half_a_millisecond_at_most(bench: Bench) -> None:
    """RM0090, 22.6; RM0440, 36.5: the window watchdog is fed by the chunks' interrupt alone, whatever main loop and
    ticks do."""
    bench.arm(2.0)
    bench.hold_main = True
    bench.run(5)
    bench.convert()
    assert bench.registers.t_window_us is not None
    starved_s = 1e-6 * (bench.registers.now_us - bench.registers.t_window_us)
    assert starved_s == 1e-6 * bench.chunk_us, "a chunk that is not served does not feed it"
    assert 3 * 1e-6 * bench.chunk_us < bench.wires.window_watchdog_s() <= 0.5e-3
    bench.registers["DBGMCU.APB1_FZ"] = 1 << 11 | 1 << 12  # as a debugger leaves it that attaches
    bench.hold_main = False
    bench.come_round()
    bench.run(1)
    assert bench.registers["DBGMCU.APB1_FZ"] == 1, "both watchdogs count while the core is halted, TIM2 does not"


def underrun_the_dac(bench: Bench) -> None:
    bench.registers["DAC.SR" if bench.board.modes == 2 else "DAC2.SR"] |= 1 << 13


def overrun_the_adc(bench: Bench) -> None:
    name, bit = ("ADC1.SR", 5) if bench.board.modes == 2 else ("ADC2.ISR", 4)
    bench.registers[name] |= 1 << bit


def put_the_streams_out_of_step(bench: Bench) -> None:
    bench.registers[f"{bench.sampling.playing[-1]}.NDTR"] += 5


def fail_a_transfer(bench: Bench) -> None:
    half = bench.sampling.half
    bench.registers[bench.sampling.flags] |= half >> 1 if bench.board.modes == 2 else half << 1


@pytest.mark.parametrize(
    "mishap",
    [Bench.convert, underrun_the_dac, overrun_the_adc, put_the_streams_out_of_step, fail_a_transfer, None],
    ids=["chunk", "DAC", "ADC", "streams", "transfer", "transfer to a DAC"],
)
def test_lost_samples_end_in_silence_until_the_host_arms_anew(
    bench: Bench, mishap: Callable[[Bench], None] | None
) -> None:
    """A failed transfer to a DAC has an interrupt of its own, before the chunk's."""
    bench.arm(2.0)
    if mishap is None:
        bench.cpu.interrupt(max(bench.wires.interrupts() - {bench.sampling.irq, bench.board.interlock_irq}))
    else:
        bench.convert()
        mishap(bench)
        bench.interrupt()
    assert not bench.enable_line
    bench.restarted()
    bench.come_round()
    bench.hold(15)
    assert not bench.amplifiers
    assert bench.at_mid_rail
    assert bench.status.state is BoardState.QUIET
    assert [entry.code for entry in bench.log().entries] == [MISSED_CHUNK, DEADMAN_TRIP]
    bench.arm(2.0)
    bench.hold(20)
    assert bench.amplitudes_um(1)[:, 0] == pytest.approx(2.0, abs=0.04)


@pytest.mark.parametrize("moment", ["on_look", "on_clear"])
def test_a_chunk_filled_too_late_is_a_lost_one(bench: Bench, moment: str) -> None:
    """While the handler works the DMA goes on: when the other half is through, what was filled is being played. Its
    flag may come at any moment, and the interrupt that it latched ends with the restart: one chunk is lost, not two.
    """
    bench.arm(2.0)
    bench.convert()
    flags = bench.sampling.flags
    other = bench.registers[flags] ^ (bench.sampling.half | bench.sampling.complete)

    def other_half_is_through() -> None:
        setattr(bench.registers, moment, lambda: None)
        bench.registers[flags] |= other
        bench.registers.pending = True

    setattr(bench.registers, moment, other_half_is_through)
    bench.interrupt()
    assert not bench.enable_line
    if bench.registers.pending:
        bench.interrupt()
    bench.restarted()
    bench.come_round()
    assert [entry.code for entry in bench.log().entries] == [MISSED_CHUNK, DEADMAN_TRIP]


def test_a_chunk_may_interrupt_the_main_loop_anywhere_outside_the_lock(bench: Bench) -> None:
    """The same frames, with the interrupt at random places: the plate ends where it should, and no frame is lost."""
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
            bench.interrupt()
            if not done:
                bench.come_round()
    assert bench.status.bad_frames == 0
    assert bench.status.seq == 40
    assert bench.amplitudes_um(1)[:, 1] == pytest.approx(0.5, abs=0.02)


def test_without_its_crystal_the_board_runs_from_the_internal_oscillator(board: Board) -> None:
    registers = board.registers(crystal=False)
    bench = Bench(board, registers=registers)
    mask, crystal = registers.PLL_FROM_CRYSTAL
    assert registers["RCC.PLLCFGR"] & mask != crystal
    assert bench.wires.core_hz() == board.core_hz
    assert registers.reads < 60_000, "the wait is bounded"


def test_without_any_clock_the_board_tries_again_in_silence(board: Board) -> None:
    registers = board.registers(pll=False)
    cpu = Cpu(board, board.image(), read=registers.read, write=registers.write)
    registers.on_reset = cpu.stop
    assert not cpu.run_to("board_wait")
    assert registers.reset_requested
    assert registers.reads < 100_000
    assert not registers["GPIOB.ODR"]
    expect_mid_rail(registers)


def expect_mid_rail(registers: Peripherals) -> None:
    first = "DAC" if "DAC.CR" in registers.ADDRESS else "DAC1"
    assert (registers[f"{first}.CR"], registers[f"{first}.DHR12RD"]) == (0x00010001, 0x08000800)
    if first == "DAC1":
        assert (registers["DAC2.CR"], registers["DAC2.DHR12R1"]) == (1, 0x800)
        assert (registers["DAC3.CR"], registers["DAC3.DHR12RD"]) == (0x00010001, 0x08000800)


def test_without_samples_the_main_loop_stays_awake_to_say_so(board: Board) -> None:
    """No chunk will ever wake it: an amplifier gain that makes no sense must not leave a board that does not answer."""
    registers = board.registers()
    cpu = Cpu(board, board.image(), read=registers.read, write=registers.write)
    assert cpu.run_to("hd_carrier_init")
    cpu.return_now(False)
    assert cpu.run_to("board_wait")
    assert registers.t_fed_us is None
    reads = registers.reads
    assert not cpu.run_to("main", instructions=1000)
    assert registers.reads > reads + 10, "it looks at the line, round after round"


def crash_place(address: int) -> int:
    """In the flash, or from 0x800000 on in the core-coupled memory: exact in a float32."""
    return address - 0x08000000 if address < 0x10000000 else 0x800000 + address - 0x10000000


def test_a_fault_of_the_processor_silences_resets_and_is_in_the_log_afterwards(bench: Bench) -> None:
    bench.arm(2.0)
    bench.cpu.fault(HARD_FAULT, at=bench.cpu.address("hd_tick"))
    assert bench.registers.reset_requested
    assert not bench.enable_line
    expect_mid_rail(bench.registers)
    assert not bench.registers["TIM2.CR1"] & 1
    bench.boot(bench.board.registers(reset_flags=SOFTWARE_RESET))
    found = bench.log()
    assert found.reset_cause == 3
    assert (found.entries[-1].code, found.entries[-1].value) == (CRASH, crash_place(bench.cpu.address("hd_tick")))


@every_chip
def test_every_boot_has_another_identity_and_knows_its_cause(bench: Bench) -> None:
    """RM0090, 7.3.21; RM0440, 7.4.28: the flags of RCC_CSR."""
    identities, causes = set(), []
    known = {cause: flags for cause, flags in enumerate(bench.board.reset_flags, start=1) if flags is not None}
    for flags in known.values():
        bench.boot(bench.board.registers(reset_flags=flags))
        bench.to_board += device.encode(HelloRequest())
        causes.append(bench.log().reset_cause)
        identities.add([message for message in bench.messages if isinstance(message, BoardHello)][-1].boot_id)
    assert len(identities) == len(known)
    assert causes == list(known)


def test_a_plate_that_resonates_elsewhere_is_still_driven_as_asked(board: Board) -> None:
    bench = Bench(board, plate=Plate(mode_hz=(29200.0, 29210.0, 29203.0, 29258.0)[: board.modes], quality=350.0))
    bench.arm(1.0, 1.0, 1.0, 1.0)
    bench.hold(60)
    assert bench.amplitudes_um(1) == pytest.approx(1.0, abs=0.02)
