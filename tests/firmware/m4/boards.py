"""The boards whose images are under test, and what they cannot be asked for: their chips' memories and manuals."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from . import image, stm32f405, stm32g474, stm32h743
from .image import Image
from .peripherals import Peripherals
from .wiring import Wiring


@dataclass(frozen=True, slots=True)
class Board:
    """`load_max` is the share of the processor that the program may take; reset flags in the order of their causes:
    power-up, pin, software, watchdog, brown-out (None where the chip cannot tell it from power-up), low-power."""

    name: str
    modes: int
    identity_at: int
    reference_at: int  # the factory's calibration word of the internal reference
    registers: type[Peripherals]
    wires: type[Wiring]
    core_hz: float
    load_max: float
    reset_flags: tuple[int | None, ...]
    port: str  # of the circuits of amplifier fault and emergency stop
    fault_pin: int
    stop_pin: int
    interlock_irq: int
    wait_states: int  # of the flash, as they are counted; 0: they are left out
    core: str = "M4"
    memories: tuple[tuple[int, int], ...] = ((0x08000000, 1 << 20), (0x10000000, 64 << 10), (0x20000000, 128 << 10))
    peripherals: tuple[tuple[int, int], ...] = ()  # address and size, beyond those of all
    flash_cache: tuple[int, int] = (128, 8)  # lines and their bytes
    bus_cycles: tuple[int, int] = (
        0,
        0,
    )  # for each word read, and written, beyond the core's memories, as they are counted

    def image(self, control_hz: int = 2000, setup: str = "") -> Image:
        return image.build(self.name, self.modes, control_hz, setup, self.core.lower())

    def __str__(self) -> str:
        return self.name


_PIN = 1 << 26
_FLAGS = (_PIN, 1 << 28 | _PIN, 1 << 29 | _PIN)
F405 = Board(
    "stm32f405",
    2,
    0x1FFF7A10,
    0x1FFF7A2A,  # DS8626: read at 3.3 V
    stm32f405.Registers,
    stm32f405.Wires,
    168e6,
    0.25,
    (0x0E000000, *_FLAGS, 1 << 25 | _PIN, 1 << 31 | _PIN),
    "GPIOB",
    14,
    15,
    40,
    0,
)
G474 = Board(
    "stm32g474",
    4,
    0x1FFF7590,
    0x1FFF75AA,  # DS12288: read at 3.0 V
    stm32g474.Registers,
    stm32g474.Wires,
    170e6,
    0.51,
    (0x0C000000, *_FLAGS, None, 1 << 31 | _PIN),
    "GPIOC",
    6,
    7,
    23,
    4,
)
BOARDS = (F405, G474)
_H7_PIN = 1 << 22
H743 = Board(  # mostly of its own tests: no other has an M7, an SPI or 320 kHz
    "stm32h743",
    8,
    0x1FF1E800,
    0x1FF1E860,  # DS12110: read at 3.3 V, in 16 bits
    stm32h743.Registers,
    stm32h743.Wires,
    384e6,
    0.60,
    (1 << 23 | 1 << 21 | _H7_PIN, _H7_PIN, 1 << 24 | _H7_PIN, 1 << 26 | _H7_PIN, 1 << 21 | _H7_PIN, 1 << 30 | _H7_PIN),
    "GPIOC",
    6,
    7,
    23,
    40,
    "M7",
    ((0x00000000, 64 << 10), (0x08000000, 2 << 20), (0x20000000, 128 << 10), (0x30000000, 288 << 10)),
    ((0x52000000, 0x3000), (0x58000000, 0x30000), (0x5C000000, 0x2000)),
    (512, 32),  # the core's cache of instructions; it has none of data
    (40, 12),  # assumed: no manual says it
)
every_board = pytest.mark.parametrize("board", BOARDS, ids=str)
every_chip = pytest.mark.parametrize("board", [*BOARDS, H743], ids=str)
needs_compiler = pytest.mark.skipif(image.MISSING is not None, reason=str(image.MISSING))
