"""The boards whose images are under test, and what they cannot be asked for: their chips' memories and manuals."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from . import image, stm32f405, stm32g474
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

    def image(self, control_hz: int = 2000, setup: str = "") -> Image:
        return image.build(self.name, self.modes, control_hz, setup)

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
    0.50,
    (0x0C000000, *_FLAGS, None, 1 << 31 | _PIN),
    "GPIOC",
    6,
    7,
    23,
    4,
)
BOARDS = (F405, G474)
every_board = pytest.mark.parametrize("board", BOARDS, ids=str)
needs_compiler = pytest.mark.skipif(image.MISSING is not None, reason=str(image.MISSING))
