"""The flashed program on its board, with a plate on its converters and a host on its line, chunk by chunk.

The plate gets the memory that the DMA would read by the addresses in its registers, the host receives what the
DMA would send. That converters and clocks run as the chip's table says follows from the registers of the start, which a
test compares. A chunk's interrupt comes when its last sample is in memory, and takes no time.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hapticd.board_protocol import Keepalive, LogRequest
from hapticd.board_values import BoardLog, BoardMessage, BoardStatus
from hapticd.values import Knot, LimitReason, SafeDrive
from hapticd.wire import device

from .chip import Chip, Registers, Route
from .cpu import Cpu
from .image import Image
from .plate import Plate

AMPLIFIERS = 1 << 12  # PB12
MONOSTABLE_US = 2210  # HARDWARE.md's, from a rising edge of PB12 on
KEEPALIVE_MS = 20
TICK = 14 - 16  # PendSV, as an interrupt of the vector table
_BITS_PER_BYTE = 10
_SETTINGS = re.compile(r"(ADC|DAC|DMA|OPAMP|SPI|TIM).*\.(C(?!NT|DR)|M0AR|PAR|S[MQ])")


class Lanes(NamedTuple):
    """Of each mode the address of its first word, and the bytes from one to the next."""

    played: list[tuple[int, int]]
    sampled: list[tuple[int, int]]


class Bench:
    """A board that was just switched on and waits for its first chunk."""

    def __init__(
        self,
        board: Chip,
        image: Image | None = None,
        *,
        plate: Plate | None = None,
        registers: Registers | None = None,
    ) -> None:
        self.board = board
        self.plate = plate or Plate(mode_hz=Plate().mode_hz[: board.modes])
        self.registers = registers or board.registers()
        read, write = lambda *at: self.registers.read(*at), lambda *at: self.registers.write(*at)  # those of each boot
        self.cpu = Cpu(board, image or board.image(), read=read, write=write)
        self.to_board = bytearray()
        self.messages: list[BoardMessage] = []
        self.motion_um: list[npt.NDArray[np.complex128]] = []
        self.played: list[npt.NDArray[np.uint16]] = []
        self.hold_main = False
        self.seq = 0
        self.boot(self.registers)

    def boot(self, registers: Registers) -> None:
        """Runs from the reset vector to the first wait; the RAM keeps what it holds."""
        self.registers = registers
        self.registers.on_reset = self.cpu.stop
        self.cpu.load()
        assert self.cpu.run_to("board_wait")
        board = self.board
        self.chunk, self.chunk_us = board.chunk_samples, round(1e6 * board.chunk_samples / board.sample_hz)
        self.plate.sample_s = 1 / board.sample_hz
        self._delay_frac = tuple(board.delay_frac(k) for k in range(board.modes))
        self.chunk_interrupt = board.chunk(board.modes)
        self.begin()
        self.settings = self.converters()
        self._ring, self._ring_items = registers[f"{board.receives}.M0AR"], registers[f"{board.receives}.NDTR"]
        self._ring_at = 0
        self._sending = b""
        self._decoder = device.Decoder()

    def begin(self) -> None:
        """The firmware has started the converters: their buffers begin at the beginning."""
        self.lanes = Lanes(self._places(self.board.played), self._places(self.board.sampled))
        self.chunks = 0

    def _places(self, routes: Callable[[int], list[Route]]) -> list[tuple[int, int]]:
        found, p = [], self.registers
        for stream, register, size, items, modes in routes(self.board.modes):
            assert (p[f"{stream}.CR"] & 1, p[f"{stream}.NDTR"]) == (1, 2 * self.chunk * items)
            assert p[f"{stream}.PAR"] == self.board.addresses[register]
            stride = size * items
            found += [(p[f"{stream}.M0AR"] + stride // modes * k, stride) for k in range(modes)]
        return found

    def converters(self) -> dict[str, int]:
        """What sets them up, their clock and their streams."""
        line = (self.board.receives, self.board.sends[0])
        return {n: v for n, v in self.registers.values.items() if _SETTINGS.match(n) and not n.startswith(line)}

    @property
    def baud(self) -> float:
        return self.board.line_hz / self.registers[f"{self.board.line}.BRR"]

    @property
    def status(self) -> BoardStatus:
        """The last one that the host has received."""
        return [message for message in self.messages if isinstance(message, BoardStatus)][-1]

    def log(self) -> BoardLog:
        self.to_board += device.encode(LogRequest())
        self.run(5)
        return [message for message in self.messages if isinstance(message, BoardLog)][-1]

    @property
    def amplifiers(self) -> bool:
        """Whether the monostable lets them drive."""
        t_us = self.registers.t_pulse_us
        return t_us is not None and self.registers.now_us - t_us < MONOSTABLE_US

    @property
    def enable_line(self) -> bool:
        return bool(self.registers["GPIOB.ODR"] & AMPLIFIERS)

    @property
    def starved_us(self) -> int:
        """Time since the watchdog was fed."""
        assert self.registers.t_fed_us is not None
        return self.registers.now_us - self.registers.t_fed_us

    def reference(self, *knots: tuple[float, Sequence[complex]], has_pulse: bool = False) -> None:
        """The host's next frame: knots as (ms after its start, amplitudes), from now on.

        Amplitudes of modes that the board does not have are left out; modes without one rest.
        """
        self.seq += 1
        rest = (0j,) * self.board.modes
        line = tuple(Knot(round(ms * 1e6), (*w, *rest)[: self.board.modes]) for ms, w in knots)
        drive = SafeDrive(0, line, LimitReason.NONE)
        self.to_board += device.encode_reference(self.seq, drive, self.registers.now_us & 0xFFFFFFFF, has_pulse)

    def arm(self, *w_um: complex) -> None:
        """Three references, and the time of the ramp: live at full drive when this returns."""
        for _ in range(3):
            self.reference((0.0, w_um))
        self.run(25)

    def hold(self, ms: float) -> None:
        """Runs with the host's keep-alives."""
        while ms > 0:
            self.to_board += device.encode(Keepalive(self.seq))
            self.run(min(ms, KEEPALIVE_MS))
            ms -= KEEPALIVE_MS

    def run(self, ms: float) -> None:
        for _ in range(round(ms * 1000 / self.chunk_us)):
            self.convert()
            self.interrupt()
            self.come_round()

    def interrupt(self) -> None:
        """The chunk's, and the tick's where it asked for one of its own."""
        self.cpu.interrupt(self.chunk_interrupt.irq)
        self.compute_tick()

    def compute_tick(self) -> None:
        if self.registers.tick_pending:
            self.registers.tick_pending = False
            self.cpu.interrupt(TICK)

    def convert(self) -> None:
        """One chunk of the converters and of the line; its interrupt is pending then."""
        half, board = self.chunks % 2, self.board
        words = np.stack([self._lane(*place, half) >> board.played_shift for place in self.lanes.played], axis=1)
        sampled, motion_um = self.plate.advance(words, connected=self.amplifiers, delay_frac=self._delay_frac)
        for place, column in zip(self.lanes.sampled, sampled.T, strict=True):
            self._lane(*place, half)[:] = column
        self.motion_um.append(motion_um)
        self.played.append(words)
        self.chunks += 1
        self.registers.now_us += self.chunk_us
        _, flags, *bits = self.chunk_interrupt
        self.registers[flags] |= bits[half]
        left = self.chunk * (2 - (half == 0))
        for route in board.sampled(board.modes):
            self.registers[f"{route.stream}.NDTR"] = left * route.items
        for route in board.played(board.modes):  # one word ahead
            self.registers[f"{route.stream}.NDTR"] = left * route.items - 1
        self._move_line()

    def _lane(self, at: int, stride: int, half: int) -> npt.NDArray[np.uint16]:
        return self.cpu.words(at + stride * self.chunk * half, stride, self.chunk)

    def come_round(self, *, instructions: int | None = None) -> bool:
        """The main loop from its wait to its next, or a number of instructions towards it; False if not there yet."""
        if self.hold_main:
            return True
        if self.cpu.pc == self.cpu.address("board_wait"):
            self.cpu.return_now()
        return self.cpu.run_to("board_wait", instructions=instructions)

    def restarted(self) -> None:
        """The firmware has started the converters again."""
        assert self.converters() == self.settings
        self.begin()

    def _move_line(self) -> None:
        room, p = int(self.chunk_us * 1e-6 * self.baud / _BITS_PER_BYTE), self.registers
        # RM0090, 30.6.1: an overrun keeps the line from receiving; RM0440, 41.7.4: with OVRDIS it loses its byte alone.
        is_deaf = p.field(self.board.line_flags, 3, 1) and not p.field(f"{self.board.line}.CR3", 12, 1)
        for byte in b"" if is_deaf else self.to_board[:room]:
            self.cpu.write(self._ring + self._ring_at, bytes([byte]))
            self._ring_at = (self._ring_at + 1) % self._ring_items
        del self.to_board[:room]
        p[f"{self.board.receives}.NDTR"] = self._ring_items - self._ring_at
        self._send(room)

    def _send(self, room: int) -> None:
        """RM0090, 10.5.5, EN: a stream disables itself; RM0440, 12.6.3: a channel stays enabled, with nothing left."""
        p, (stream, flags, complete) = self.registers, self.board.sends
        items = p[f"{stream}.NDTR"]
        if not p[f"{stream}.CR"] & 1 or (items == 0 and not self._sending):
            return
        self._sending = self._sending or self.cpu.read(p[f"{stream}.M0AR"], items)
        self.messages += self._decoder.feed(self._sending[:room])
        self._sending = self._sending[room:]
        p[f"{stream}.NDTR"] = max(1, len(self._sending))
        if not self._sending:
            p[f"{stream}.NDTR"] = 0
            if f"{stream}.FCR" in p.values:
                p[f"{stream}.CR"] &= ~1
            p[flags] |= complete

    def amplitudes_um(self, ms: float) -> npt.NDArray[np.float64]:
        """|W| of each mode in truth, sample by sample over the last `ms`: (samples, modes)."""
        return np.abs(np.concatenate(self.motion_um[-round(ms * 1000 / self.chunk_us) :]))

    @property
    def at_mid_rail(self) -> bool:
        """Whether the last chunk played was silence."""
        return bool(np.all(self.played[-1] == 0x800))
