"""The flashed program on its board, with a plate on its converters and a host on its line, chunk by chunk.

Nothing of the firmware's own is looked at: addresses, rates and routes come from the registers that it wrote, the plate
gets what the memory holds that the DMA would read, the host hears what the DMA would send.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from . import wiring
from .cpu import Cpu
from .image import Image
from .peripherals import COMPLETE, HALF, POWER_ON, Peripherals
from .plate import SAMPLE_S, Plate

AMPLIFIERS = 1 << 12  # PB12
HANDLER = "DMA2_Stream0_IRQHandler"
_BITS_PER_BYTE = 10


class Bench:
    """A board that was just switched on and waits for its first chunk, with the crystal that it was built for."""

    def __init__(self, image: Image, plate: Plate | None = None) -> None:
        self.plate = Plate() if plate is None else plate
        self.registers = Peripherals()
        self.cpu = Cpu(image, read=self._read, write=self._write)
        self.to_board = bytearray()
        self.from_board = bytearray()
        self.motion_um: list[npt.NDArray[np.complex128]] = []
        self.played: list[npt.NDArray[np.uint16]] = []
        self.interrupted: Callable[[Callable[[], None]], None] = lambda deliver: deliver()
        self.hold_main = False
        self.chunks = 0
        self._sending: bytes = b""
        self.boot(POWER_ON)

    def boot(self, reset_flags: int) -> None:
        """Runs from the reset vector to the first wait; peripherals begin anew, the RAM keeps what it holds."""
        now_us = self.registers.now_us
        self.registers = Peripherals(reset_flags=reset_flags)
        self.registers.now_us = now_us
        self.registers.on_reset = self.cpu.stop
        self._sending = b""
        self.cpu.load()
        assert self.cpu.run_to("board_wait")
        self.sampling = wiring.sampling(self.registers)
        self._streams = wiring.streams(self.registers)
        self.chunk_words = self.sampling.words // 2
        self.chunks = 0
        self._ring_at = 0

    def _read(self, address: int, size: int) -> int:
        return self.registers.read(address, size)

    def _write(self, address: int, size: int, value: int) -> None:
        self.registers.write(address, size, value)

    @property
    def amplifiers(self) -> bool:
        return bool(self.registers["GPIOB.ODR"] & AMPLIFIERS)

    @property
    def chunk_us(self) -> int:
        return round(1e6 * self.chunk_words / self.sampling.sample_hz)

    def run(self, ms: float) -> None:
        for _ in range(round(ms * 1000 / self.chunk_us)):
            self.convert()
            self.interrupted(lambda: self.cpu.interrupt(HANDLER))
            self.come_round()

    def convert(self) -> None:
        """One chunk of the converters and of the line; the interrupt is pending at its end."""
        half = self.chunks % 2
        at = 4 * self.chunk_words * half
        data = self.cpu.read(self.sampling.played_at + at, 4 * self.chunk_words)
        words = np.frombuffer(data, dtype="<u2").reshape(-1, 2)
        sampled, motion_um = self.plate.advance(words, connected=self.amplifiers)
        self.cpu.write(self.sampling.sampled_at + at, sampled.astype("<u2").tobytes())
        self.motion_um.append(motion_um)
        self.played.append(words)
        self.registers.now_us += self.chunk_us
        self.chunks += 1
        self.registers["DMA2.LISR"] |= (HALF, COMPLETE)[half]
        left = self.sampling.words - (self.chunk_words, 0)[half] if half == 0 else self.sampling.words
        self.registers["DMA1_S5.NDTR"] = self.registers["DMA2_S0.NDTR"] = left
        self._move_line()

    def come_round(self) -> None:
        """The main loop, from its wait to its next."""
        if not self.hold_main:
            self.cpu.return_now()
            assert self.cpu.run_to("board_wait") or self.registers.reset_requested

    def _move_line(self) -> None:
        room = max(1, int(self.chunk_us * 1e-6 * wiring.baud(self.registers) / _BITS_PER_BYTE))
        self._receive(bytes(self.to_board[:room]))
        del self.to_board[:room]
        self._send(room)

    def _receive(self, data: bytes) -> None:
        ring = self._streams["USART1_RX"]
        for byte in data:
            self.cpu.write(ring.memory + self._ring_at, bytes([byte]))
            self._ring_at = (self._ring_at + 1) % ring.items
        self.registers["DMA2_S2.NDTR"] = ring.items - self._ring_at

    def _send(self, room: int) -> None:
        stream = wiring.streams(self.registers).get("USART1_TX")
        if stream is None:
            return
        assert stream.to_peripheral and not stream.circular and stream.item_size == 1
        self._sending = self._sending or self.cpu.read(stream.memory, stream.items)
        self.from_board += self._sending[:room]
        self._sending = self._sending[room:]
        self.registers["DMA2_S7.NDTR"] = max(1, len(self._sending))
        if not self._sending:
            self.registers["DMA2_S7.CR"] &= ~1
            self.registers["DMA2.HISR"] |= 1 << 27

    @property
    def starved_us(self) -> int:
        """Time since the watchdog was fed."""
        assert self.registers.t_fed_us is not None
        return self.registers.now_us - self.registers.t_fed_us


def amplitudes_um(motion_um: npt.NDArray[np.complex128]) -> npt.NDArray[np.float64]:
    """|W| of each mode (n, 2), peak to peak as everywhere, from the motion's two quadratures."""
    return np.abs(motion_um)


def word(data: bytes) -> int:
    return int(struct.unpack("<I", data)[0])


__all__ = ["SAMPLE_S", "Bench", "amplitudes_um", "word"]
