"""The flashed program in the loop: the registers it writes make the converters run, and a plate closes the circle.

What is assumed of the STM32H743 and no manual says: how long the core waits for a word beyond its own memories
(`Chip.bus_cycles`), how long a word takes from its request to the SPI's first clock (`Chip.moved_s`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from hapticd.board_protocol import BoardState, HelloRequest, Keepalive, Sweep
from hapticd.board_values import BoardHello, BoardStatus, SweepPoint
from hapticd.design.resonance import fit_resonance
from hapticd.wire import device

from .m4.bench import AMPLIFIERS, TICK, Bench
from .m4.boards import BOARDS, F405, G474, H743, needs_compiler
from .m4.chip import Chip
from .m4.cpu import Cpu
from .m4.plate import DRIVE_HZ, Plate
from .m4.stm32g474 import requests

pytestmark = [pytest.mark.long, needs_compiler]

DEADMAN_TRIP, MISSED_CHUNK, CRASH = 64, 66, 68
DEADMAN_MS, RAMP_MS = 50, 10
WATCHDOG_HZ = 32e3
HARD_FAULT, SOFTWARE = 3, 2  # an exception; the place of a reset's cause
ASKED_UM = (1.5, -0.8j, 0.3, 0.6, -0.4, 0.5, 0.2 + 0.1j, -0.3)


@pytest.fixture(params=BOARDS, ids=str)
def board(request: pytest.FixtureRequest) -> Chip:
    return request.param


@pytest.fixture
def bench(board: Chip) -> Bench:
    return Bench(board)


def held(bench: Bench, *w_um: complex) -> None:
    """What the plate does in the last millisecond."""
    found_um = bench.amplitudes_um(1)
    assert found_um == pytest.approx(np.tile(np.abs(w_um[: bench.board.modes]), (len(found_um), 1)), abs=0.02)


def expect_lost_samples(bench: Bench) -> None:
    """Silence at once, and until the host arms the board again."""
    assert not bench.enable_line
    bench.restarted()
    bench.come_round()
    bench.hold(15)
    assert bench.at_mid_rail
    assert not bench.amplifiers
    assert bench.status.state is BoardState.QUIET
    assert [entry.code for entry in bench.log().entries] == [MISSED_CHUNK, DEADMAN_TRIP]


def test_the_start_writes_these_registers_in_this_order(bench: Bench) -> None:
    """The files were compared with the manuals field by field (clocks, pins, triggers, streams, interrupts, watchdogs,
    supply detector), and so has to be a change, before `text` is written to the file. Addresses of memory are the
    linker's business, levels that move the H743's DACs by hand have a test of their own."""
    by_hand = ".BSRR" if bench.board is H743 else "none"
    trace = [(name, value) for name, value in bench.registers.trace if not name.endswith(by_hand)]
    memory = ("M0AR", "MPU_RBAR")
    text = "".join(f"{name} {'memory' if name.endswith(memory) else f'{value:#010x}'}\n" for name, value in trace)
    assert text == (Path(__file__).parent / f"m4/{bench.board}-start.txt").read_text()
    assert len(bench.registers.names) == len(bench.board.addresses), "no two registers share an address"


def test_the_converters_are_at_mid_rail_before_any_clock_is_set_up_and_without_one(board: Chip) -> None:
    """The H743's by their pins alone, two chips at once: neither an SPI nor the PLL has to work."""
    registers = board.registers(pll=False)
    cpu = Cpu(board, board.image(), read=registers.read, write=registers.write)
    registers.on_reset = cpu.stop
    assert cpu.run_to("main")
    assert registers.is_silent
    assert all("ENR" in name for name, _ in registers.trace if name.startswith("RCC."))
    assert {value for name, value in registers.trace if ".DHR" in name} <= {0x08000800, 0x800}
    assert not cpu.run_to("board_wait"), "without any clock the board tries again"
    assert registers.reset_requested
    assert registers.reads < 100_000
    assert registers.is_silent
    assert not registers["GPIOB.ODR"] & AMPLIFIERS


@pytest.mark.parametrize(
    ("control_hz", "target_um", "most_ms", "most_h743_ms"), [(2000, 0.4, 1.2, 2.0), (5000, 2.0, 4.0, 4.5)]
)
def test_a_step_settles_and_stays(
    board: Chip, control_hz: int, target_um: float, most_ms: float, most_h743_ms: float
) -> None:
    """Within 2 %, from the tick that took the frame on. The amplifiers' 150 V alone bound 2 um to 3.4 ms. A lag of the
    converters that the firmware did not know of would cost the small step milliseconds and percents of overshoot. Three
    chunks lie between a tick's samples and its voltage on the H743, whose mode 5 is 100 Hz off the drive."""
    mode = 5 if board is H743 and target_um < 1 else 0
    bench = Bench(board, board.image(control_hz))
    bench.arm()
    t_asked_us = bench.registers.now_us
    bench.reference((0.0, [target_um * (k == mode) for k in range(board.modes)]))
    bench.hold(40)
    applied = (m for m in bench.messages if isinstance(m, BoardStatus) and m.applied and m.seq == bench.seq)
    per_ms = round(board.sample_hz / 1000)
    motion_um = bench.amplitudes_um(40)[per_ms * (next(applied).t_applied_us - t_asked_us) // 1000 :]
    stepped_um = motion_um[:, mode]
    outside = np.flatnonzero(np.abs(stepped_um - target_um) > 0.02 * target_um)
    assert outside[-1] / per_ms <= (most_h743_ms if board is H743 else most_ms)
    assert stepped_um.max() < 1.02 * target_um
    still_um = 0.01 if board is H743 else 0.003  # what the learned coupling makes of the converters' noise
    assert np.delete(motion_um, mode, axis=1).max() < still_um
    assert np.sqrt(np.mean((stepped_um[-20 * per_ms :] - target_um) ** 2)) < 0.003


@pytest.mark.parametrize(("modes", "control_hz"), [(2, 2000), (3, 5000), (5, 5000)])
def test_the_board_of_four_modes_is_built_for_others_as_well(modes: int, control_hz: int) -> None:
    board = replace(G474, modes=modes)
    bench = Bench(board, board.image(control_hz))
    assert requests(modes).items() <= bench.registers.values.items()
    bench.arm(*ASKED_UM)
    bench.hold(40)
    held(bench, *ASKED_UM)


@pytest.mark.parametrize("board", [G474, replace(G474, modes=5), H743])
def test_chunks_interrupt_a_tick_at_any_instruction_and_the_plate_goes_on_as_asked(board: Chip) -> None:
    """PM0214, 4.4.3: PendSV, below the chunks. With four modes this is a voltage that comes a chunk after it is due."""
    bench, rng, interrupted = Bench(board), np.random.default_rng(3), 0
    bench.arm(*ASKED_UM)
    for chunk in range(1400):
        if chunk % 175 == 0:
            bench.to_board += device.encode(Keepalive(bench.seq))
        bench.convert()
        bench.cpu.interrupt(bench.chunk_interrupt.irq)
        if bench.registers.tick_pending:
            bench.registers.tick_pending = False
            bench.convert()
            next_chunk = partial(bench.cpu.interrupt, bench.chunk_interrupt.irq)
            bench.cpu.interrupt(TICK, amid=next_chunk, instructions=int(rng.integers(1, 600 * board.modes)))
            interrupted += 1
        bench.come_round()
    assert interrupted >= 140
    held(bench, *ASKED_UM)
    assert not bench.log().entries


def test_samples_lost_amid_a_tick_void_it() -> None:
    """The outputs are silent at once; the core learns of it when the tick it was in is over."""
    bench = Bench(G474)
    bench.arm(2.0)
    while not bench.registers.tick_pending:
        bench.convert()
        bench.cpu.interrupt(bench.chunk_interrupt.irq)
    bench.registers.tick_pending = False

    def lose_a_chunk() -> None:
        bench.convert()
        bench.convert()
        bench.cpu.interrupt(bench.chunk_interrupt.irq)
        assert not bench.enable_line

    bench.cpu.interrupt(TICK, amid=lose_a_chunk, instructions=700)
    expect_lost_samples(bench)


def test_a_tick_that_is_not_over_when_the_next_begins_is_a_lost_chunk() -> None:
    bench = Bench(G474)
    bench.arm(2.0)
    for _ in range(20):  # two ticks' chunks, and no tick comes to compute
        bench.convert()
        bench.cpu.interrupt(bench.chunk_interrupt.irq)
    assert not bench.enable_line
    bench.cpu.interrupt(TICK)
    expect_lost_samples(bench)


@pytest.mark.parametrize(("board", "mode"), [(F405, 1), (G474, 1), (H743, 0), (H743, 4), (H743, 2)], ids=str)
def test_a_sweep_finds_the_plate_and_the_lag_of_the_converters(bench: Bench, mode: int) -> None:
    """Amplifiers and sensors add no phase here: what is left is from what a sensor saw to the middle of the word that
    answers it."""
    f_hz = Plate().mode_hz[mode]
    bench.to_board += device.encode(Sweep(mode, f_hz - 50.0, f_hz + 50.0, points=6, dwell_ms=40, voltage_v=15.0))
    bench.hold(270)
    points = [message for message in bench.messages if isinstance(message, SweepPoint)]
    assert [point.index for point in points] == list(range(6))
    assert not bench.amplifiers
    assert bench.at_mid_rail
    response = np.array([point.measured_um[mode] / point.voltage_v for point in points])
    lag_s = (0.5 + (-bench.board.delay_frac(mode)) % 1.0) / bench.board.sample_hz
    found = fit_resonance(np.array([point.frequency_hz for point in points]), response)
    assert found.frequency_hz == pytest.approx(f_hz, abs=0.2)
    assert found.q_factor == pytest.approx(500.0, rel=0.01)
    assert found.loop_phase_rad == pytest.approx(-2 * np.pi * DRIVE_HZ * lag_s, abs=0.006)


def test_all_modes_are_driven_as_asked_and_measured_as_they_move(bench: Bench) -> None:
    bench.arm(*ASKED_UM)
    bench.hold(120)
    held(bench, *ASKED_UM)
    assert bench.status.measured_um == pytest.approx(ASKED_UM[: bench.board.modes], abs=0.02)
    assert not bench.log().entries


def test_a_silent_host_ends_in_mid_rail_with_the_amplifiers_off(bench: Bench) -> None:
    bench.arm(2.0, 1.0)
    bench.to_board += device.encode(Keepalive(bench.seq))
    bench.run(DEADMAN_MS - 1)
    assert bench.amplifiers
    bench.run(RAMP_MS + 3)
    assert bench.at_mid_rail
    assert not bench.amplifiers
    bench.run(DEADMAN_MS + RAMP_MS + 3)
    assert bench.status.deadman_trips == 1


def test_a_program_that_hangs_is_reset_within_half_a_millisecond(bench: Bench) -> None:
    """RM0090, 21.4, 22.6; RM0440, 35.4, 36.5; RM0433, 44, 45, 60: the window watchdog is fed by the chunks' interrupt
    alone, the other while both main loop and tick live."""
    bench.arm(2.0)
    bench.run(20)
    assert bench.starved_us <= 500
    bench.hold_main = True
    bench.run(20)
    p = bench.registers
    assert bench.starved_us >= 19000
    assert not bench.registers.fed_early, "before its reload was taken on: it would wait for 512 ms"
    assert (p["IWDG.RLR"] + 1) * (4 << p["IWDG.PR"]) / WATCHDOG_HZ == pytest.approx(0.010, abs=0.0005)
    bench.convert()
    assert bench.registers.t_window_us == bench.registers.now_us - bench.chunk_us, "a chunk not served does not feed it"
    assert p.field("WWDG.CFR", 0, 7) == 0x7F, "nothing resets the chip that feeds it early"
    divider = 4096 << p.field("WWDG.CFR", *bench.board.window_prescaler)
    assert 3e-6 * bench.chunk_us < divider * (p.field("WWDG.CR", 0, 6) + 1) / bench.board.window_hz <= 0.5e-3
    bench.hold_main = False
    bench.come_round()
    debug = {name: value for name, value in p.values.items() if name.startswith("DBGMCU")}
    assert set(debug.values()) <= {0, 1, 3}, "a halted core stops TIM2 and TIM3, and no watchdog"
    p.values |= dict.fromkeys(debug, 0xFFFFF)  # as a debugger leaves them that attaches
    bench.run(1)
    assert debug.items() <= p.values.items()


# What is written to a register in mid-drive: bits that are set, or (negative) cleared.
MISHAPS = {
    F405: {"DAC": ("DAC.SR", 1 << 13), "ADC": ("ADC1.SR", 1 << 5), "transfer": ("DMA2.LISR", 8)},
    G474: {"DAC": ("DAC2.SR", 1 << 13), "ADC": ("ADC2.ISR", 1 << 4), "transfer": ("DMA1.ISR", 8 << 12)},
    H743: {"DAC": ("SPI3.SR", ~(1 << 1)), "ADC": ("ADC3.ISR", 1 << 4), "transfer": ("DMA2.LISR", 8 << 16)},
}


@pytest.mark.parametrize("mishap", ["DAC", "ADC", "transfer", "chunk", "streams", "transfer to a DAC"])
def test_lost_samples_end_in_silence_until_the_host_arms_anew(bench: Bench, mishap: str) -> None:
    """A failed transfer to a DAC has an interrupt of its own, before the chunk's."""
    registers = bench.registers
    bench.arm(2.0)
    if mishap == "transfer to a DAC":
        bench.cpu.interrupt({F405: 16, G474: 59, H743: 12}[bench.board])
    else:
        bench.convert()
        if mishap == "chunk":
            bench.convert()
        elif mishap == "streams":
            registers[f"{bench.board.played(bench.board.modes)[-1].stream}.NDTR"] += -12 if bench.board is H743 else 5
        else:
            name, bits = MISHAPS[bench.board][mishap]
            registers[name] = registers[name] | bits if bits > 0 else registers[name] & bits
        bench.interrupt()
    assert registers.is_silent or bench.board is not H743
    expect_lost_samples(bench)
    bench.arm(2.0)
    bench.hold(20)
    held(bench, 2.0, *[0.0] * 7)


def test_a_swarm_of_lost_samples_is_one_entry_that_counts_them(bench: Bench) -> None:
    for _ in range(3):
        bench.convert()
        bench.convert()
        bench.interrupt()
        bench.restarted()
        bench.come_round()
    assert [(entry.code, entry.value) for entry in bench.log().entries] == [(MISSED_CHUNK, 3.0)]


@pytest.mark.parametrize("moment", ["on_look", "on_clear"])
def test_a_chunk_filled_too_late_is_a_lost_one(bench: Bench, moment: str) -> None:
    """While the handler works the DMA goes on: when the other half is through, what was filled is being played. Its
    flag may come at any moment, and the interrupt that it latched ends with the restart: one chunk is lost, not two.
    """
    bench.arm(2.0)
    bench.convert()
    chunk = bench.chunk_interrupt
    other = bench.registers[chunk.flags] & (chunk.half | chunk.complete) ^ (chunk.half | chunk.complete)

    def other_half_is_through() -> None:
        setattr(bench.registers, moment, lambda: None)
        bench.registers[chunk.flags] |= other
        bench.registers.pending = True

    setattr(bench.registers, moment, other_half_is_through)
    bench.interrupt()
    assert not bench.enable_line
    if bench.registers.pending:
        bench.interrupt()
    expect_lost_samples(bench)


@pytest.mark.parametrize("board", [F405, G474], ids=str)  # the H743's frames are longer than the line is fast
def test_a_chunk_may_interrupt_the_main_loop_anywhere_outside_the_lock(bench: Bench) -> None:
    """The same frames, with the interrupt at random places: the plate ends where it should, and no frame is lost."""
    rng = np.random.default_rng(5)
    for i in range(28):
        bench.reference(*[(4.0 * k, (1.0 + 0.02 * k, 0.5j)) for k in range(1 + i % 24)])
        for _ in range(200):
            bench.convert()
            done = bench.come_round(instructions=int(rng.integers(1, 3000)))
            while bench.cpu.masked:
                done = bench.come_round(instructions=1)
            bench.interrupt()
            if not done:
                bench.come_round()
    assert bench.status.bad_frames == 0
    assert bench.status.seq == 28
    assert bench.amplitudes_um(1)[:, 1] == pytest.approx(0.5, abs=0.02)


def test_without_samples_the_main_loop_stays_awake_to_say_so(board: Chip) -> None:
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


@pytest.mark.parametrize("function", ["hd_tick", "board_start"])
def test_a_fault_of_the_processor_silences_resets_and_is_in_the_log_afterwards(bench: Bench, function: str) -> None:
    """With its place: in the flash, or from 0x800000 on in the memory of the path; exact in a float32."""
    bench.arm(2.0)
    at, path = bench.cpu.address(function), bench.cpu.image.symbols["path_memory"]
    bench.cpu.fault(HARD_FAULT, at=at)
    assert bench.registers.reset_requested
    assert not bench.enable_line
    assert bench.registers.is_silent
    assert not bench.registers["TIM2.CR1"] & 1
    bench.boot(bench.board.registers(reset_flags=bench.board.reset_flags[SOFTWARE]))
    found = bench.log()
    assert found.reset_cause == 1 + SOFTWARE
    place = at - 0x08000000 if 0 <= at - 0x08000000 < 1 << 21 else 0x800000 + at - path
    assert (found.entries[-1].code, found.entries[-1].value) == (CRASH, place)


def test_every_boot_has_another_identity_and_reports_its_cause(bench: Bench) -> None:
    """RM0090, 7.3.21; RM0440, 7.4.28; RM0433, 8.7.39: the flags of RCC_CSR or RCC_RSR."""
    identities, causes = set(), []
    known = {cause: flags for cause, flags in enumerate(bench.board.reset_flags, start=1) if flags is not None}
    for flags in known.values():
        bench.boot(bench.board.registers(reset_flags=flags))
        bench.to_board += device.encode(HelloRequest())
        causes.append(bench.log().reset_cause)
        identities.add([message for message in bench.messages if isinstance(message, BoardHello)][-1].boot_id)
    assert len(identities) == len(known)
    assert causes == list(known)
