"""Instructions and cycles of a piece of program, by the table of the Cortex-M4's manual.

ARM DDI 0439B, table 3-1 (instructions) and 7-1 (FPU), each at its slowest: every load and store 2 cycles though
neighbours overlap, every taken branch refills the pipeline in 3, every division takes its 12, every floating-point
result is waited for by its successor. Interrupt entry 12 cycles and exit 12, and 17 words of lazily kept FPU registers.
Wait states and bus contention are left out; the flash accelerator hides the first as long as loops fit its cache.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

from .cpu import Cpu
from .image import Image, Instruction

CORE_HZ = 168e6
INTERRUPT_CYCLES = 12 + 12 + 17
_REFILL = 3
_DIVISION = 12
_FLOAT_SLOW = {"vdiv.f32": 14, "vsqrt.f32": 14, "vmla.f32": 3, "vmls.f32": 3, "vfma.f32": 3, "vfms.f32": 3}
_FLOAT_RESULT = ("vadd", "vsub", "vmul", "vdiv", "vsqrt", "vcvt", "vneg", "vabs", "vmla", "vmls", "vfma", "vfms", "vnmul")
_MULTIPLE = re.compile(r"(push|pop|v?ldmia|v?stmia|ldmdb|stmdb|ldm|stm|vpush|vpop)(\.[nw])?")


def _registers(operands: str) -> int:
    """How many a list such as {r4, r5, lr} or {s16-s19} names."""
    count = 0
    for part in re.sub(r".*\{|\}.*", "", operands).split(","):
        first, _, last = part.strip().partition("-")
        words = 2 if first.startswith("d") else 1
        count += words * (int(last[1:]) - int(first[1:]) + 1 if last else 1)
    return count


@cache
def cycles(instruction: Instruction) -> int:
    """Without the refill of a branch that is taken."""
    name, operands = instruction.mnemonic, instruction.operands
    if _MULTIPLE.fullmatch(name):
        return 1 + _registers(operands)
    if re.match(r"v?(ldr|str)", name):
        return 3 if re.match(r"(ldrd|strd|v(ldr|str).*d\d)", f"{name} {operands}") else 2
    if name.startswith(("sdiv", "udiv")):
        return _DIVISION
    if name in _FLOAT_SLOW or name.startswith(_FLOAT_RESULT):
        return _FLOAT_SLOW.get(name, 1) + 1
    if name in ("mla", "mls", "dsb", "isb", "msr", "mrs"):
        return 2
    if re.match(r"(tbb|tbh)", name):
        return 2 + _REFILL
    return 1


@dataclass(slots=True)
class Count:
    instructions: int = 0
    cycles: int = 0


class Meter:
    """Counts what the processor executes, between `start` and `stop`."""

    def __init__(self, cpu: Cpu) -> None:
        self._cpu = cpu
        self._blocks: dict[tuple[int, int], tuple[Count, int]] = {}
        self._count = Count()
        self._fallthrough = 0
        self._remove = cpu.on_block(self._enter)

    def start(self) -> None:
        self._count = Count()
        self._fallthrough = 0

    def stop(self) -> Count:
        return self._count

    def remove(self) -> None:
        self._remove()

    def _enter(self, address: int, size: int) -> None:
        key = (address, size)
        if key not in self._blocks:
            self._blocks[key] = _block(self._cpu.image, address, size)
        if self._fallthrough not in (0, address):
            self._count.cycles += _REFILL
        count, self._fallthrough = self._blocks[key]
        self._count.instructions += count.instructions
        self._count.cycles += count.cycles


def _block(image: Image, address: int, size: int) -> tuple[Count, int]:
    count, at = Count(), address
    while at < address + size:
        instruction = image.instructions[at]
        count.instructions += 1
        count.cycles += cycles(instruction)
        at += instruction.size
    return count, at
