"""What keeps a flashed board quiet when its chip, its supply or its amplifiers are not as they should be."""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable
from itertools import pairwise

import pytest

from hapticd import board_protocol as protocol
from hapticd.board_protocol import (
    BoardState,
    BoardTime,
    BoardVerdict,
    CommandResult,
    HelloRequest,
    SetBaud,
    TimeRequest,
)
from hapticd.board_values import BoardHello
from hapticd.wire import device
from hapticd.wire.commands import encode

from .m4 import image
from .m4.bench import Bench
from .m4.boards import F405, G474, every_board, needs_compiler
from .m4.chip import Chip, Registers

pytestmark = [pytest.mark.long, needs_compiler]

IMAGE, BROWN_OUT_OFF, SUPPLY, AMPLIFIER_FAULT, EMERGENCY_STOP, REFERENCE = range(96, 102)
DEADMAN_TRIP, MISSED_CHUNK, SLOW_CLOCK = 64, 66, 67
SYNC = 1 << 10
SUPPLY_INTERRUPT = 16 + 1
FLASH = 0x08000000


def logged(bench: Bench) -> list[int]:
    return [entry.code for entry in bench.log().entries]


def drive(bench: Bench) -> None:
    bench.arm(2.0)
    bench.hold(20)


def on_converters_of(board: Chip, supply_v: float) -> Registers:
    registers = board.registers()
    registers.supply_v = supply_v
    return registers


@every_board
@pytest.mark.parametrize(
    ("made", "reason"),
    [
        (lambda board: board.registers(crystal=False), SLOW_CLOCK),
        (lambda board: board.registers(**board.brown_out_off), BROWN_OUT_OFF),
        (lambda board: board.registers(**board.weak_supply), SUPPLY),
        (lambda board: on_converters_of(board, 3.0), REFERENCE),
        (lambda board: on_converters_of(board, 3.42), REFERENCE),
    ],
    ids=["crystal", "brown-out", "supply", "VDDA low", "VDDA high"],
)
def test_a_board_that_must_not_drive_says_why(board: Chip, made: Callable[[Chip], Registers], reason: int) -> None:
    """DS8626, DS12288, DS12110: the factory's word of the internal reference is a reading at 3.3, 3.0 and 3.3 V."""
    registers = made(board)
    bench = Bench(board, registers=registers)
    expect_no_drive(bench, reason)
    if reason == REFERENCE:
        shown_v = next(entry.value for entry in bench.log().entries if entry.code == REFERENCE)
        assert shown_v == pytest.approx(registers.supply_v, abs=0.005)
    if reason == SLOW_CLOCK:  # it runs from the internal oscillator, as fast
        mask, crystal = board.pll_from_crystal
        assert registers[board.pll_source] & mask != crystal
        assert registers["RCC.CFGR"] == Bench(board).registers["RCC.CFGR"]


@pytest.mark.parametrize("supply_v", [3.18, 3.42])
def test_converters_that_drift_while_they_drive_end_the_drive_until_a_reset(supply_v: float) -> None:
    """ADC5, which has no sensor with four modes, reads the internal reference; one that is off is not enough."""
    bench = Bench(G474)
    drive(bench)
    for off_ms, drives in ((0.4, True), (10, False)):
        bench.registers.supply_v = supply_v
        bench.run(off_ms)
        bench.registers.supply_v = 3.3
        bench.hold(10)
        assert bench.amplifiers is drives
    assert bench.at_mid_rail
    assert REFERENCE in logged(bench)
    drive(bench)
    assert not bench.amplifiers
    bench.boot(G474.registers())
    drive(bench)
    assert bench.amplifiers


def expect_no_drive(bench: Bench, reason: int) -> None:
    bench.to_board += device.encode(HelloRequest())
    bench.run(5)
    drive(bench)
    bench.hold(15)
    assert any(isinstance(message, BoardHello) for message in bench.messages)
    assert bench.status.state is BoardState.FAULT
    assert "config" in protocol.FAULTS[bench.status.fault_code]
    assert not bench.amplifiers
    assert bench.at_mid_rail
    assert logged(bench)[-1] == reason


@every_board
def test_one_changed_bit_of_the_program_is_found_at_the_next_start(board: Chip) -> None:
    bench = Bench(board)
    drive(bench)
    assert bench.amplifiers
    bench.cpu.damaged = FLASH + 0x1000  # in the sine table's copy
    bench.boot(board.registers())
    expect_no_drive(bench, IMAGE)


@every_board
def test_a_falling_supply_disables_the_amplifiers_and_is_in_the_log_afterwards(board: Chip) -> None:
    """On EXTI line 16: RM0090, 5.4; RM0440, 6.4.2; RM0433, 6.8."""
    bench = Bench(board)
    drive(bench)
    bench.cpu.fault(SUPPLY_INTERRUPT, at=bench.cpu.address("hd_tick"))
    assert not bench.enable_line
    assert bench.registers.is_silent
    assert bench.registers.reset_requested
    bench.boot(board.registers())
    assert logged(bench) == [SUPPLY]


@every_board
@pytest.mark.parametrize("interrupts", [True, False])
@pytest.mark.parametrize(("pin", "event"), [("fault_pin", AMPLIFIER_FAULT), ("stop_pin", EMERGENCY_STOP)])
def test_an_open_circuit_of_fault_or_stop_ends_the_drive_until_it_is_closed(
    board: Chip, pin: str, event: int, interrupts: bool
) -> None:
    """At once by its interrupt, within a tick without it."""
    bench, at = Bench(board), getattr(board, pin)
    registers = bench.registers
    drive(bench)
    assert bench.amplifiers
    registers[f"{board.port}.IDR"] |= 1 << at
    if interrupts:
        written = len(registers.trace)
        bench.cpu.interrupt(board.interlock_irq)
        silences = [name for name, value in registers.trace[written:] if ".DHR12RD" in name and value == 0x08000800]
        assert silences or all(dac.level == [2048] * 4 for dac in registers.dacs), "before the next chunk"
        assert not bench.enable_line
        bench.restarted()
        bench.come_round()
    else:
        bench.run(0.5)
        assert not bench.enable_line
    drive(bench)
    assert not bench.amplifiers
    assert bench.at_mid_rail
    assert bench.status.state is BoardState.QUIET
    assert logged(bench) == [event, MISSED_CHUNK, DEADMAN_TRIP]
    registers[f"{board.port}.IDR"] &= ~(1 << at)
    drive(bench)
    assert bench.amplifiers


@every_board
def test_a_circuit_that_opened_and_closed_at_once_was_a_disturbance(board: Chip) -> None:
    bench = Bench(board)
    drive(bench)
    bench.registers["EXTI.PR"] = 0
    bench.cpu.interrupt(board.interlock_irq)
    assert bench.registers["EXTI.PR"] == 1 << board.fault_pin | 1 << board.stop_pin
    bench.run(0.5)
    assert bench.amplifiers


@every_board
@pytest.mark.parametrize("is_pulsed", [True, False])
def test_the_amplifiers_are_enabled_by_pulses_or_a_level_and_only_while_ticks_come(
    board: Chip, is_pulsed: bool
) -> None:
    """Pulses for a monostable: the pin changes with every tick, so a program that hangs holds no level."""
    bench = Bench(board, None if is_pulsed else board.image(2000, "-DENABLE_BY_PULSES=false"))
    bench.arm()
    levels = [bench.enable_line for _ in range(20) if bench.run(0.5) is None]
    assert all((level != before) is is_pulsed for before, level in pairwise(levels))
    assert any(levels)
    bench.run(65)
    assert not any(bench.enable_line for _ in range(4) if bench.run(0.5) is None), "low without a drive"


@every_board
def test_a_deaf_line_listens_again(board: Chip) -> None:
    """A transfer error ends its stream (RM0440, 12.4.7; RM0090, 10.5.5, EN)."""
    bench = Bench(board)
    control = f"{board.receives}.CR"
    bench.registers[control] &= ~1
    bench.run(0.05)
    assert bench.registers[control] & 1


@every_board
def test_an_overrun_of_the_line_costs_what_is_on_it_and_no_more(board: Chip) -> None:
    """RM0090, 30.6.1: until SR and DR were read nothing is received; RM0440, 41.7.4: OVRDIS."""
    bench = Bench(board)
    bench.registers[board.line_flags] |= 1 << 3
    bench.run(0.5)  # a tick ends it
    bench.to_board += device.encode(TimeRequest(1))
    bench.run(3)
    assert [message for message in bench.messages if isinstance(message, BoardTime)]


@pytest.mark.parametrize("board", [F405, G474], ids=str)
@pytest.mark.parametrize("bypassed", [False, True])
def test_a_clock_in_place_of_the_crystal_bypasses_its_oscillator(board: Chip, bypassed: bool) -> None:
    """RM0090, 7.3.1; RM0440, 7.4.1: HSEBYP, before HSEON."""
    bench = Bench(board, board.image(2000, "-DCLOCK_AT_OSC_IN=true") if bypassed else None)
    controls = [value for name, value in bench.registers.trace if name == "RCC.CR"]
    started = next(value for value in controls if value & 1 << 16)
    assert bool(started & 1 << 18) is bypassed


def test_the_boards_events_have_sentences() -> None:
    header = (image.FIRMWARE / "board.h").read_text()
    codes = {int(code) for code in re.findall(r"HD_EVENT_\w+ = (\d+),", header)}
    assert codes == set(range(IMAGE, REFERENCE + 1)) == set(protocol.BOARD_EVENTS)


@every_board
def test_the_hello_has_the_checksum_of_the_flashed_image(board: Chip) -> None:
    bench = Bench(board)
    bench.to_board += device.encode(HelloRequest())
    bench.run(5)
    (hello,) = (message for message in bench.messages if isinstance(message, BoardHello))
    flash, built = bytearray(b"\xff" * (1 << 20)), board.image()
    for address, data in built.segments:
        flash[address - FLASH : address - FLASH + len(data)] = data
    assert hello.image_crc == zlib.crc32(flash[: built.symbols["image_crc"] - FLASH])
    assert (hello.baud_max, hello.has_sync) == (3_000_000, True)


@every_board
def test_the_line_takes_another_speed_once_the_answer_is_out(board: Chip) -> None:
    bench = Bench(board)
    assert bench.baud == pytest.approx(921600, rel=2e-3)
    bench.to_board += encode(SetBaud(3_000_000))
    bench.run(3)
    assert [message.verdict for message in bench.messages if isinstance(message, BoardVerdict)] == [CommandResult.DONE]
    assert bench.baud == pytest.approx(3e6, rel=1e-4)
    bench.to_board += device.encode(TimeRequest(1))
    bench.run(3)
    assert isinstance(bench.messages[-1], BoardTime)


@every_board
def test_pb10_is_high_for_5_ms_from_the_tick_of_a_marked_reference_on(board: Chip) -> None:
    bench = Bench(board)
    bench.arm(0.5)
    bench.reference((0.0, (1.0,)), has_pulse=True)
    levels = []
    for _ in range(40):
        bench.run(0.2)
        levels.append(bool(bench.registers["GPIOB.ODR"] & SYNC))
    assert bench.registers.field("GPIOB.MODER", 20, 2) == 1
    assert levels.count(True) == pytest.approx(25, abs=1)
    assert not levels[0]
    assert [a for a, b in pairwise(levels) if b and not a] == [False]
