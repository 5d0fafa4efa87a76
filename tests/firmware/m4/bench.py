"""The flashed program on its board, with a plate on its converters and a host on its line, chunk by chunk.

Nothing of the firmware's own is looked at: addresses, rates and routes come from the registers that it wrote, the plate
gets what the memory holds that the DMA would read, the host hears what the DMA would send. A chunk's interrupt comes
when its last sample is in memory, and takes no time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from hapticd.board_protocol import Keepalive, LogRequest
from hapticd.board_values import BoardLog, BoardMessage, BoardStatus
from hapticd.values import Knot, LimitReason, SafeDrive
from hapticd.wire import device

from .chip import Chip, Registers
from .cpu import Cpu
from .image import Image
from .plate import Plate
from .wiring import Wiring

AMPLIFIERS = 1 << 12  # PB12
MONOSTABLE_US = 2210  # HARDWARE.md's, from a rising edge of PB12 on
KEEPALIVE_MS = 20
TICK = 14 - 16  # PendSV, as an interrupt of the vector table
_BITS_PER_BYTE = 10


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
        self.wires = Wiring(registers)
        self.sampling = self.wires.sampling()
        self.ring = self.wires.streams()["RX"]
        self.chunk = self.sampling.samples // 2
        self.plate.sample_s = 1 / self.sampling.sample_hz
        self.chunk_us = round(1e6 * self.chunk / self.sampling.sample_hz)
        self.chunks = 0
        self._ring_at = 0
        self._sending = b""
        self._decoder = device.Decoder()

    @property
    def status(self) -> BoardStatus:
        """The last one that the host has heard."""
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
        self.cpu.interrupt(self.sampling.chunk.irq)
        self.compute_tick()

    def compute_tick(self) -> None:
        if self.registers.tick_pending:
            self.registers.tick_pending = False
            self.cpu.interrupt(TICK)

    def convert(self) -> None:
        """One chunk of the converters and of the line; its interrupt is pending then."""
        half = self.chunks % 2
        lanes = self.sampling.lanes
        words = np.stack(
            [self._lane(lane.played_at, lane.played_stride, half) >> lane.played_shift for lane in lanes], axis=1
        )
        delays = [lane.delay_frac for lane in lanes]
        sampled, motion_um = self.plate.advance(words, connected=self.amplifiers, delay_frac=delays)
        for lane, column in zip(lanes, sampled.T, strict=True):
            self._fill_lane(lane.sampled_at, lane.sampled_stride, half, column)
        self.motion_um.append(motion_um)
        self.played.append(words)
        self.chunks += 1
        self.registers.now_us += self.chunk_us
        chunk = self.sampling.chunk
        self.registers[chunk.flags] |= (chunk.half, chunk.complete)[half]
        left, items = self.chunk if half == 0 else self.sampling.samples, self.sampling.items
        for name in self.sampling.sampling:
            self.registers[f"{name}.NDTR"] = left * items[name]
        for name in self.sampling.playing:  # one word ahead
            self.registers[f"{name}.NDTR"] = left * items[name] - 1
        self._move_line()

    def _lane(self, at: int, stride: int, half: int) -> npt.NDArray[np.uint16]:
        data = self.cpu.read(at + stride * self.chunk * half, stride * (self.chunk - 1) + 2)
        return np.frombuffer(data, dtype="<u2")[:: stride // 2]

    def _fill_lane(self, at: int, stride: int, half: int, samples: npt.NDArray[np.uint16]) -> None:
        begin = at + stride * self.chunk * half
        data = np.frombuffer(self.cpu.read(begin, stride * (self.chunk - 1) + 2), dtype="<u2").copy()
        data[:: stride // 2] = samples
        self.cpu.write(begin, data.astype("<u2").tobytes())

    def come_round(self, *, instructions: int | None = None) -> bool:
        """The main loop from its wait to its next, or a number of instructions towards it; False if not there yet."""
        if self.hold_main:
            return True
        if self.cpu.pc == self.cpu.address("board_wait"):
            self.cpu.return_now()
        return self.cpu.run_to("board_wait", instructions=instructions)

    def restarted(self) -> None:
        """The firmware has started the converters anew: their buffers begin at the beginning."""
        self.sampling = self.wires.sampling()
        self.chunks = 0

    def _move_line(self) -> None:
        room = int(self.chunk_us * 1e-6 * self.wires.baud() / _BITS_PER_BYTE)
        for byte in b"" if self.wires.deaf() else self.to_board[:room]:
            self.cpu.write(self.ring.memory + self._ring_at, bytes([byte]))
            self._ring_at = (self._ring_at + 1) % self.ring.items
        del self.to_board[:room]
        self.registers[f"{self.ring.name}.NDTR"] = self.ring.items - self._ring_at
        self._send(room)

    def _send(self, room: int) -> None:
        stream = self.wires.streams().get("TX")
        if stream is None or (stream.items == 0 and not self._sending):
            return
        assert (stream.to_peripheral, stream.circular, stream.memory_size) == (True, False, 1)
        self._sending = self._sending or self.cpu.read(stream.memory, stream.items)
        self.messages += self._decoder.feed(self._sending[:room])
        self._sending = self._sending[room:]
        self.registers[f"{stream.name}.NDTR"] = max(1, len(self._sending))
        if not self._sending:
            self.wires.finish_sending()

    def amplitudes_um(self, ms: float) -> npt.NDArray[np.float64]:
        """|W| of each mode in truth, sample by sample over the last `ms`: (samples, modes)."""
        return np.abs(np.concatenate(self.motion_um[-round(ms * 1000 / self.chunk_us) :]))

    @property
    def at_mid_rail(self) -> bool:
        """Whether the last chunk played was silence."""
        return bool(np.all(self.played[-1] == 0x800))
