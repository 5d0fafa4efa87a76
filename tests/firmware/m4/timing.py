"""Cycles of a piece of program, by the tables of the Cortex-M4's manual, on an M7 too, which has none.

ARM DDI 0439B, tables 3-1 and 7-1: a load takes 2 cycles, 1 right after a load or a store, a store 1, division and
square root 14, an integer division its 12. A taken branch refills the pipeline in 3 cycles, the slowest of 1 to 3. To
enter and to leave an interrupt take 12 cycles each, and 17 more for the FPU's registers. Left out: bus contention,
waits for an address or a floating-point result, and wait states but for a `Flash`'s.
"""

from __future__ import annotations

import re
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

from .chip import Chip
from .cpu import Cpu
from .image import Image, Instruction

INTERRUPT_CYCLES = 2 * (12 + 17)
_REFILL = 3
_ACCESS = re.compile(r"v?(ldr|str)(?!d)")
_CYCLES = {
    r"ldrd|strd|v(ldr|str).* d|v(ml|fm)[as]\.": 3,
    r"v?ldr|ml[as] |[di]sb|msr |mrs ": 2,
    r"vdiv|vsqrt": 14,
    r"[us]div": 12,
    r"tb[bh]": 2 + _REFILL,
}


def _registers(operands: str) -> int:
    """How many words a list such as {r4, r5, lr} or {s16-s19} names."""
    count = 0
    for part in re.sub(r".*\{|\}.*", "", operands).split(","):
        first, _, last = part.strip().partition("-")
        words = 2 if first.startswith("d") else 1
        count += words * (int(last[1:]) - int(first[1:]) + 1 if last else 1)
    return count


def _cycles(instruction: Instruction) -> int:
    """Without the refill of a branch that is taken."""
    text = f"{instruction.mnemonic} {instruction.operands}"
    if re.match(r"v?(push|pop|ldm|stm)", text):
        return 1 + _registers(instruction.operands)
    return next((most for pattern, most in _CYCLES.items() if re.match(pattern, text)), 1)


@dataclass(slots=True)
class Flash:
    """A flash with wait states behind its cache of instructions, read in lines of 64 bits, as with two banks.

    RM0440, 3 (flash, DBANK, ART accelerator): 1 KB of instructions; the longest unused line goes. Pessimistic: no
    credit for the prefetch, for the cache of data, for the half that a read shares with the instructions before it.
    """

    wait_states: int
    lines: int
    line_bytes: int
    _cached: OrderedDict[int, None] = field(default_factory=OrderedDict)

    def fetched(self, address: int, size: int) -> int:
        """The cycles that a block of instructions waits."""
        if self.wait_states == 0 or not 0x08000000 <= address < 0x10000000:
            return 0
        waited = 0
        for line in range(address // self.line_bytes, (address + size - 1) // self.line_bytes + 1):
            if line not in self._cached:
                waited += self.wait_states
            self._cached[line] = None
            self._cached.move_to_end(line)
            if len(self._cached) > self.lines:
                self._cached.popitem(last=False)
        return waited


class Meter:
    """`cycles` of what the processor has executed; `watch` calls back where a function begins. A word that is read or
    written beyond the core's memories takes the chip's `bus_cycles` more."""

    def __init__(self, cpu: Cpu, board: Chip) -> None:
        self.cycles = 0
        self.watch: dict[int, Callable[[], object]] = {}
        self._image, self._bus_cycles = cpu.image, board.bus_cycles
        self._flash = Flash(board.wait_states, *board.flash_cache)
        self._blocks: dict[tuple[int, int], tuple[int, int]] = {}
        self._fallthrough = 0
        self._removes = [cpu.on_block(self._enter)]
        if board.wait_states:
            self._removes.append(cpu.on_access(cpu.flash, self._wait_for_datum))
        if any(board.bus_cycles):
            self._removes.append(cpu.on_access(range(0x30000000, 0x60000000), self._wait_for_bus))

    def measure(self, action: Callable[[], object]) -> int:
        before, self._fallthrough = self.cycles, 0
        action()
        return self.cycles - before

    def remove(self) -> None:
        for remove in reversed(self._removes):
            remove()

    def _wait_for_datum(self, _is_write: bool) -> None:
        self.cycles += self._flash.wait_states

    def _wait_for_bus(self, is_write: bool) -> None:
        self.cycles += self._bus_cycles[is_write]

    def _enter(self, address: int, size: int) -> None:
        if address in self.watch:
            self.watch[address]()
        key = (address, size)
        if key not in self._blocks:
            self._blocks[key] = _block(self._image, address, size)
        if self._fallthrough not in (0, address):
            self.cycles += _REFILL
        spent, self._fallthrough = self._blocks[key]
        self.cycles += spent + self._flash.fetched(address, size)


def _block(image: Image, address: int, size: int) -> tuple[int, int]:
    """What a basic block costs, and what follows it if it ends without a branch."""
    spent, at, follows_access = 0, address, False
    while at < address + size:
        instruction = image.instructions[at]
        is_access = _ACCESS.match(instruction.mnemonic) is not None
        spent += 1 if is_access and follows_access else _cycles(instruction)
        follows_access = is_access
        at += instruction.size
    return spent, at
