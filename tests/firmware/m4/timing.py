"""Cycles of a piece of program, by the tables of the Cortex-M4's manual, on an M7 too, which has none.

ARM DDI 0439B, table 3-1 with its notes 3.3.2 and 3.3.3, and table 7-1: a load takes 2 cycles and 1 right after another
load or store, a store with an immediate offset 1, an address made by the instruction before one more, a floating-point
result needed by the next instruction one more, division and square root 14, an integer division its 12. A taken branch
refills the pipeline in 3 cycles, the slowest of 1 to 3. To enter and to leave an interrupt take 12 cycles each, and 17
more for the FPU's registers. Bus contention is left out, and so are wait states, but for those of a `Flash`.
"""

from __future__ import annotations

import re
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

from .chip import Chip
from .cpu import Cpu
from .image import Image, Instruction

INTERRUPT_CYCLES = 2 * (12 + 17)
_REFILL = 3
_DIVISION = 12
_FLOAT_SLOW = {"vdiv.f32": 14, "vsqrt.f32": 14, "vmla.f32": 3, "vmls.f32": 3, "vfma.f32": 3, "vfms.f32": 3}
_FLOAT_RESULT = re.compile(r"v(add|sub|mul|div|sqrt|cvt|neg|abs|mla|mls|fma|fms|nmul)\b")
_MULTIPLE = re.compile(r"(v?push|v?pop|v?ldm|v?stm)(ia|db)?(\.[nw])?")
_SINGLE = re.compile(r"v?(ldr|str)(b|h|sb|sh)?(eq|ne|cs|cc|mi|pl|hi|ls|ge|lt|gt|le)?(\.[nw])?")
_IMMEDIATE_STORE = re.compile(r"v?str\S* .*\[\w+(, #-?\d+)?\]")


def _registers(operands: str) -> int:
    """How many words a list such as {r4, r5, lr} or {s16-s19} names."""
    count = 0
    for part in re.sub(r".*\{|\}.*", "", operands).split(","):
        first, _, last = part.strip().partition("-")
        words = 2 if first.startswith("d") else 1
        count += words * (int(last[1:]) - int(first[1:]) + 1 if last else 1)
    return count


def _single(instruction: Instruction, before: Instruction | None) -> int:
    """A load or a store of one register, or of two."""
    text = f"{instruction.mnemonic} {instruction.operands}"
    if "strd" in text or "ldrd" in text or re.match(r"v(ldr|str)\S* d", text):
        return 3
    address = text[text.find("[") :]
    if before is not None and not _touches_memory(before) and re.search(rf"\b{_result(before)}\b", address):
        return 3
    follows = before is not None and _SINGLE.fullmatch(before.mnemonic)
    return 1 if follows or _IMMEDIATE_STORE.match(text) else 2


def _touches_memory(instruction: Instruction) -> bool:
    return bool(_SINGLE.fullmatch(instruction.mnemonic) or _MULTIPLE.fullmatch(instruction.mnemonic))


def _result(instruction: Instruction) -> str:
    return instruction.operands.partition(",")[0].strip() or "none"


@cache
def cycles(instruction: Instruction, before: Instruction | None = None) -> int:
    """Of an instruction that follows `before`, without the refill of a branch that is taken."""
    name = instruction.mnemonic
    waits = before is not None and _FLOAT_RESULT.match(before.mnemonic) is not None
    stall = 1 if waits and re.search(rf"\b{_result(before)}\b", instruction.operands) else 0
    if _MULTIPLE.fullmatch(name):
        return 1 + _registers(instruction.operands) + stall
    if name.startswith(("ldr", "str", "vldr", "vstr")):
        return _single(instruction, before) + stall
    if name.startswith(("sdiv", "udiv")):
        return _DIVISION
    if name.startswith(("tbb", "tbh")):
        return 2 + _REFILL
    slow = 2 if name in ("mla", "mls", "dsb", "isb", "msr", "mrs") else 1
    return _FLOAT_SLOW.get(name, slow) + stall


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
    spent, at, before = 0, address, None
    while at < address + size:
        instruction = image.instructions[at]
        spent += cycles(instruction, before)
        before = instruction
        at += instruction.size
    return spent, at
