"""A Cortex-M4 or M7 with the board's memories: calls functions of an image, and stops at a given address."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

from .chip import Chip
from .image import Image

unicorn = pytest.importorskip("unicorn", reason="unicorn is not installed")
arm = unicorn.arm_const

SCRATCH = 0x70000000  # memory that the board does not have, for the test's own arguments
RETURN = SCRATCH + 0xFFFF0  # a function that comes back there stops the emulator
_FLASH = 0x08000000
_PERIPHERALS = ((0x40000000, 0x80000), (0x48000000, 0x2000), (0x50000000, 0x4000), (0xE0000000, 0x100000))
_INSTRUCTIONS_MAX = 20_000_000  # a loop that never ends fails its test instead of hanging it

Read = Callable[[int, int], int]  # address, size in bytes -> value
Write = Callable[[int, int, int], None]  # address, size, value


class Cpu:
    """`read` and `write` answer the peripherals' addresses; without them every register is 0."""

    def __init__(self, board: Chip, image: Image, *, read: Read | None = None, write: Write | None = None) -> None:
        self.image = image
        self.damaged: int | None = None  # a byte of the flash that is not what was written
        self._uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self._uc.ctl_set_cpu_model(getattr(arm, f"UC_CPU_ARM_CORTEX_{board.core}"))
        self._memories = {base: bytearray(size) for base, size in (*board.memories, (SCRATCH, 1 << 20))}
        for base, memory in self._memories.items():
            pointer = ctypes.addressof(ctypes.c_char.from_buffer(memory))
            self._uc.mem_map_ptr(base, len(memory), unicorn.UC_PROT_ALL, pointer)
        self.flash = range(_FLASH, _FLASH + dict(board.memories)[_FLASH])
        self._uc.mem_map(board.identity_at & ~0xFFF, 0x1000)
        self._uc.mem_write(board.identity_at, bytes(range(1, 13)))
        self._uc.mem_write(board.reference_at, board.reference_word.to_bytes(2, "little"))
        for base, size in (*_PERIPHERALS, *board.peripherals):
            self._map_peripherals(base, size, read or (lambda *_: 0), write or (lambda *_: None))
        self.load()

    def _map_peripherals(self, base: int, size: int, read: Read, write: Write) -> None:
        self._uc.mmio_map(
            base,
            size,
            lambda _uc, offset, n, _: read(base + offset, n),
            None,
            lambda _uc, offset, n, value, _: write(base + offset, n, value),
            None,
        )

    def load(self) -> None:
        """Flashes the image and stands at its reset vector; the RAM stays as it is."""
        self._uc.mem_write(_FLASH, b"\xff" * len(self.flash))
        for address, data in self.image.segments:
            self._uc.mem_write(address, data)
        if self.damaged is not None:
            self.write(self.damaged, bytes([self.read(self.damaged, 1)[0] ^ 0x10]))
        stack, self.pc = struct.unpack("<II", self._uc.mem_read(_FLASH, 8))
        self._uc.reg_write(arm.UC_ARM_REG_SP, stack)
        self._uc.reg_write(arm.UC_ARM_REG_BASEPRI, 0)

    def address(self, symbol: str | int) -> int:
        """Of a function by name, or of the handler of an exception, by its number, as the vector table has it."""
        if isinstance(symbol, int):
            return int(struct.unpack("<I", self.read(_FLASH + 4 * symbol, 4))[0]) & ~1
        return self.image.symbols[symbol] & ~1

    def read(self, address: int, n: int) -> bytes:
        return bytes(self._uc.mem_read(address, n))

    def write(self, address: int, data: bytes) -> None:
        self._uc.mem_write(address, data)

    def words(self, address: int, stride: int, count: int) -> npt.NDArray[np.uint16]:
        """A view of every `stride` bytes' first halfword."""
        base = next(base for base, memory in self._memories.items() if base <= address < base + len(memory))
        return np.frombuffer(self._memories[base], "<u2")[(address - base) // 2 :: stride // 2][:count]

    def run_to(self, symbol: str, *, instructions: int | None = None) -> bool:
        """Goes on until the symbol comes next; False if `stop` or the end of `instructions` came first."""
        self._uc.emu_start(self.pc | 1, self.address(symbol), count=instructions or _INSTRUCTIONS_MAX)
        self.pc = self._uc.reg_read(arm.UC_ARM_REG_PC)
        return self.pc == self.address(symbol)

    def stop(self) -> None:
        """From within `read` or `write`: no instruction follows the one that asked."""
        self._uc.emu_stop()

    def return_now(self, value: int = 0) -> None:
        """Leaves the function that was about to be executed, with this result."""
        self._uc.reg_write(arm.UC_ARM_REG_R0, value)
        self.pc = self._uc.reg_read(arm.UC_ARM_REG_LR) & ~1

    def call(self, symbol: str | int, *arguments: int) -> int:
        """Calls a function with up to four integers or addresses; returns r0."""
        for register, value in zip(("R0", "R1", "R2", "R3"), arguments, strict=False):
            self._uc.reg_write(getattr(arm, f"UC_ARM_REG_{register}"), value & 0xFFFFFFFF)
        self._uc.reg_write(arm.UC_ARM_REG_LR, RETURN | 1)
        self._uc.emu_start(self.address(symbol) | 1, RETURN, count=_INSTRUCTIONS_MAX)
        if self._uc.reg_read(arm.UC_ARM_REG_PC) != RETURN:
            raise AssertionError(f"{symbol} did not return: pc is {self._uc.reg_read(arm.UC_ARM_REG_PC):#x}")
        return int(self._uc.reg_read(arm.UC_ARM_REG_R0))

    def interrupt(self, irq: int, *, amid: Callable[[], object] | None = None, instructions: int = 0) -> None:
        """Calls a handler as an interrupt would: whatever ran before goes on as if nothing had happened.

        `amid` interrupts the handler itself after so many instructions, or later, when it lets interrupts in again.
        """
        before = self._uc.context_save()
        try:
            if amid is None:
                self.call(16 + irq)
            else:
                self._begin(16 + irq)
                self._go_on(instructions)
                while self.masked and not self.returned:
                    self._go_on(1)
                amid()
                self._go_on(_INSTRUCTIONS_MAX)
        finally:
            self._uc.context_restore(before)

    def _begin(self, exception: int) -> None:
        self._uc.reg_write(arm.UC_ARM_REG_LR, RETURN | 1)
        self._uc.reg_write(arm.UC_ARM_REG_PC, self.address(exception) | 1)

    def _go_on(self, instructions: int) -> None:
        if not self.returned:
            self._uc.emu_start(self._uc.reg_read(arm.UC_ARM_REG_PC) | 1, RETURN, count=instructions)

    @property
    def returned(self) -> bool:
        return bool(self._uc.reg_read(arm.UC_ARM_REG_PC) == RETURN)

    def fault(self, exception: int, *, at: int) -> None:
        """Takes the exception as the hardware would for an instruction at `at`, until `stop` is called."""
        frame = struct.pack("<8I", 0, 0, 0, 0, 0, 0, at, 1 << 24)
        stack = self._uc.reg_read(arm.UC_ARM_REG_SP) - len(frame)
        self._uc.mem_write(stack, frame)
        self._uc.reg_write(arm.UC_ARM_REG_SP, stack)
        self._uc.emu_start(self.address(exception) | 1, RETURN, count=_INSTRUCTIONS_MAX)

    @property
    def masked(self) -> bool:
        """Whether the program holds interrupts off."""
        return bool(self._uc.reg_read(arm.UC_ARM_REG_BASEPRI))

    def on_access(self, addresses: range, callback: Callable[[bool], None]) -> Callable[[], None]:
        """`callback` is called at every access to data there, True for a write; the result removes it."""
        hook = self._uc.hook_add(
            unicorn.UC_HOOK_MEM_READ | unicorn.UC_HOOK_MEM_WRITE,
            lambda _uc, access, _address, _size, _value, _: callback(access == unicorn.UC_MEM_WRITE),
            begin=addresses.start,
            end=addresses.stop - 1,
        )
        return lambda: self._uc.hook_del(hook)

    def on_block(self, callback: Callable[[int, int], None]) -> Callable[[], None]:
        """`callback` gets address and size of every basic block from now on; the result removes it."""
        hook = self._uc.hook_add(unicorn.UC_HOOK_BLOCK, lambda _uc, address, size, _: callback(address, size))
        self._uc.ctl_flush_tb()  # what was translated before would not call it

        def remove() -> None:
            self._uc.hook_del(hook)
            self._uc.ctl_flush_tb()

        return remove
