"""One emulated STM32: the tables that a chip's manual fills in, and how its registers live.

Registers keep what is written to them; those with a life of their own are `Registers`' methods. An address that is not
in the tables raises: the firmware has no business there. The tables are in `stm32f405`, `stm32g474` and `stm32h743`,
written down from the reference manuals (RM0090 rev 18, RM0440 rev 9, RM0433 rev 8; the last's addresses and bits by the
CMSIS header) apart from the firmware's own headers. Each block has its section, in this order where there are three.
Those of RM0440 were compared with a transcription of that revision, the others' chapters with what public code cites;
no copy of RM0090 and RM0433 was at hand.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

from . import image
from .image import Image

GPIO = "MODER _ OSPEEDR PUPDR IDR ODR BSRR @20 AFRL AFRH"
DAC = "CR @08 DHR12R1 @14 DHR12R2 @20 DHR12RD @34 SR @3C MCR"
ADC = "ISR _ CR CFGR CFGR2 SMPR1 SMPR2 PCSEL @30 SQR1 @40 DR"  # of the G4 and the H7
EXTI = "IMR _ RTSR @14 PR"
CRC, IWDG, WWDG = "DR _ CR", "KR PR RLR SR", "CR CFR"
TIMER = "CR1 CR2 SMCR DIER @14 EGR CCMR1 CCMR2 CCER CNT PSC ARR _ CCR1 _ CCR3"
_NVIC = "ISER0 ISER1 ISER2 ISER3 @180 ICPR0 ICPR1 ICPR2 ICPR3"
Blocks = Mapping[str, tuple[int, str]]
COMMON: Final[Blocks] = {
    "TIM2": (0x40000000, TIMER),  # 18.4; 30.5; 39.4
    "TIM5": (0x40000C00, TIMER),
    "WWDG": (0x40002C00, WWDG),  # 22.6; 36.5; 44
    "IWDG": (0x40003000, IWDG),  # 21.4; 35.4; 45
    "CRC": (0x40023000, CRC),  # 4.4; 16.4; 21
    "NVIC": (0xE000E100, _NVIC),  # PM0214, 4.3 (the M7's: PM0253, 4)
    "SCB": (  # 4.4; CPACR 4.6, MPU 4.2
        0xE000ED00,
        "@04 ICSR @0C AIRCR @14 CCR @20 SHPR3 @88 CPACR @94 MPU_CTRL MPU_RNR MPU_RBAR MPU_RASR @250 ICIALLU",
    ),
    "DBGMCU": (0xE0042000, "@08 APB1_FZ"),  # 38.16; 47.16; 60
}
_IPR: Final = 0xE000E400  # bytes
_RESET: Final = {
    "IWDG.RLR": 0xFFF,
    "TIM2.ARR": 0xFFFFFFFF,
    "TIM5.ARR": 0xFFFFFFFF,
    "CRC.DR": 0xFFFFFFFF,
    "GPIOA.PUPDR": 0x64000000,
    "GPIOB.PUPDR": 0x00000100,
    "WWDG.CR": 0x7F,
}
_UPDATE_READS: Final = 3  # of the watchdog's status until its slow clock has taken a new reload on

Effect = Callable[[int], None]  # of the value written


class Route(NamedTuple):
    """A DMA stream of the converters: the register at its other end, the bytes of an item in memory, items for each
    sample, and modes, where an item holds more than one's."""

    stream: str
    register: str
    size: int
    items: int = 1
    modes: int = 1


class Interrupt(NamedTuple):
    """The chunks': the bits of both halves of the buffer in a register of flags."""

    irq: int
    flags: str
    half: int
    complete: int


def dma_blocks(base: int, *, is_channels: bool = False) -> Blocks:
    """The streams of two DMA units: RM0090, 10.5; of channels RM0440, 12.6."""
    first, at, step, fields = (
        (1, 0x08, 0x14, "CR NDTR PAR M0AR") if is_channels else (0, 0x10, 0x18, "CR NDTR PAR M0AR _ FCR")
    )
    return {
        f"DMA{unit}_{'C' if is_channels else 'S'}{first + i}": (base + 0x400 * (unit - 1) + at + step * i, fields)
        for unit in (1, 2)
        for i in range(8)
    }


def _layout(text: str) -> dict[str, int]:
    """A block's registers, word after word: `_` is none of the firmware's, `@20` goes on at that offset."""
    found, at = {}, 0
    for name in text.split():
        if name.startswith("@"):
            at = int(name[1:], 16)
        else:
            found[name] = at
            at += 4
    found.pop("_", None)
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Chip:
    """A board's chip and what its image may take of it.

    `reset_flags` in the order of their causes: power-up, pin, software, watchdog, brown-out (None where the chip cannot
    tell it from power-up), low-power. `silent` is what registers hold at mid-rail.
    """

    name: str
    modes: int
    blocks: Blocks
    reset: Mapping[str, int]
    silent: Callable[[int], Mapping[str, int]]
    sampled: Callable[[int], list[Route]]
    played: Callable[[int], list[Route]]
    chunk: Callable[[int], Interrupt]
    sample_hz: float = 1e6
    chunk_samples: int = 50
    moved_s: float = 0.0  # in a period of the samples, when the DACs move
    sampled_s: Callable[[int], float] = lambda _: 0.5e-6  # and when a mode's sensor is
    played_shift: int = 0
    resets: Mapping[tuple[str, int], tuple[str, ...]]  # a bit of a reset register -> blocks
    reference_channel: int
    effects: Callable[[Registers], dict[str, Effect]] = lambda _: {}
    identity_at: int
    reference_at: int  # the factory's calibration word of the internal reference
    reference_word: int  # what it read
    reference_v: float  # VDDA meanwhile
    core_hz: float
    line_hz: float  # at a divider of 1
    window_hz: float  # of the window watchdog
    load_max: float  # the share of the processor that the program may take
    reset_flags: tuple[int | None, ...]
    power_on_flags: int
    reset_register: str = "RCC.CSR"
    forget_reset_flags: int
    hsi_ready: int
    switch_bits: int = 2
    pll_source: str = "RCC.PLLCFGR"
    pll_from_crystal: tuple[int, int]  # mask and value in it
    line: str
    line_flags: str
    receives: str  # a stream
    sends: tuple[str, str, int]  # a stream, and its flag at the end
    window_prescaler: tuple[int, int]
    port: str  # of the circuits of amplifier fault and emergency stop
    fault_pin: int
    stop_pin: int
    interlock_irq: int
    brown_out_off: Mapping[str, int]  # option bytes as the chip is delivered
    weak_supply: Mapping[str, int]
    wait_states: int = 0  # of the flash, as they are counted; 0: they are left out
    core: str = "M4"
    memories: tuple[tuple[int, int], ...] = ((0x08000000, 1 << 20), (0x10000000, 64 << 10), (0x20000000, 128 << 10))
    peripherals: tuple[tuple[int, int], ...] = ()  # address and size, beyond those of all
    flash_cache: tuple[int, int] = (128, 8)  # lines and their bytes
    bus_cycles: tuple[int, int] = (0, 0)  # as counted for a word read, and written, beyond the core's memories
    addresses: dict[str, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        blocks = COMMON | self.blocks
        found = {f"{name}.{r}": base + at for name, (base, text) in blocks.items() for r, at in _layout(text).items()}
        object.__setattr__(self, "addresses", found | {f"NVIC.IPR{i}": _IPR + i for i in range(102)})

    def delay_frac(self, mode: int) -> float:
        """Of a period: from the move of the DACs to a mode's sample."""
        return (self.sampled_s(mode) - self.moved_s) * self.sample_hz % 1.0

    def image(self, control_hz: int = 2000, setup: str = "") -> Image:
        return image.build(self.name, self.modes, control_hz, setup, self.core.lower())

    def registers(self, **state: Any) -> Registers:
        return Registers(self, **state)

    def __str__(self) -> str:
        return self.name


_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


class Registers:
    """`values` by name, `trace` of all writes in order; `now_us` is set by whoever lets time pass."""

    def __init__(
        self, chip: Chip, *, crystal: bool = True, pll: bool = True, reset_flags: int | None = None, **also: int
    ) -> None:
        flags = chip.power_on_flags if reset_flags is None else reset_flags
        self.chip, self.chunk_flags = chip, chip.chunk(chip.modes).flags
        self.names = {address: name for name, address in chip.addresses.items()}
        self.values = dict.fromkeys(chip.addresses, 0) | _RESET | chip.reset | {chip.reset_register: flags} | also
        self.trace: list[tuple[str, int]] = []
        self.reads = 0
        self.now_us = 0
        self.t_fed_us: int | None = None  # None while the watchdog is not started
        self.t_window_us: int | None = None  # the same of the window watchdog
        self.t_pulse_us: int | None = None  # the last rising edge of PB12
        self.supply_v = 3.3  # VDDA
        self.fed_early = False  # before its reload was taken on
        self.reset_requested = False
        self.on_reset: Callable[[], None] = lambda: None
        self.on_look: Callable[[], None] = lambda: None  # what happens right after the ADC's flags were read
        self.on_clear: Callable[[], None] = lambda: None  # and right after they were cleared
        self.pending = False  # the chunk's interrupt, latched while its handler works
        self.tick_pending = False  # PendSV
        self.dacs: tuple[Any, ...] = ()  # chips of DACs beyond the board
        self._crystal, self._pll = crystal, pll
        self._updating = 0
        self._read_last = ""
        self._summed: list[int] = []  # words of which CRC.DR has the sum
        self._effects = self._own_effects() | chip.effects(self)

    def _own_effects(self) -> dict[str, Effect]:
        names = self.chip.addresses
        own: dict[str, Effect] = {
            "RCC.CR": self._clock_control,
            "RCC.CFGR": self._clock_switch,
            self.chip.reset_register: self._forget_reset_flags,
            "IWDG.KR": self._watchdog_key,
            "IWDG.RLR": self._watchdog_reload,
            "WWDG.CR": self._window_watchdog,
            "SCB.AIRCR": self._system_reset,
            "SCB.ICSR": self._pend_tick,
            "CRC.CR": lambda _: self._summed.clear(),
            "CRC.DR": self._summed.append,
        }
        for name in names:
            block, register = name.split(".")
            if register == "BSRR":
                own[name] = lambda value, block=block: self.move_pins(block, value)  # type: ignore[misc]
            elif block == "NVIC" and register.startswith("ISER"):
                own[name] = lambda value, name=name: self.values.__setitem__(name, self[name] | value)  # type: ignore[misc]
            elif block == "NVIC" and register.startswith("ICPR"):
                own[name] = self._forget_interrupt
            elif register in ("LIFCR", "HIFCR", "IFCR"):
                flags = f"{block}.{register.replace('FC', 'S')}"
                own[name] = lambda value, flags=flags: self._clear(flags, value)  # type: ignore[misc]
            elif f"{block}.PCSEL" in names and register in ("CR", "ISR"):
                act = self._adc_control if register == "CR" else self._adc_flags
                own[name] = lambda value, act=act, block=block: act(block, value)  # type: ignore[misc]
        for name in {register for register, _ in self.chip.resets}:
            own[name] = lambda value, name=name: self._reset_blocks(name, value)  # type: ignore[misc]
        return own

    def __getitem__(self, name: str) -> int:
        return self.values[name]

    def __setitem__(self, name: str, value: int) -> None:
        self.values[name] = value

    def field(self, name: str, at: int, width: int) -> int:
        return self.values[name] >> at & ((1 << width) - 1)

    @property
    def is_silent(self) -> bool:
        """Whether the registers, and what hangs on pins that were moved by hand, are at mid-rail without a trigger."""
        levels = [level for dac in self.dacs for level in dac.level]
        silent = self.chip.silent(self.chip.modes)
        return silent.items() <= self.values.items() and levels == [2048] * len(levels)

    def read(self, address: int, size: int) -> int:
        self.reads += 1
        name = self.names[address]
        assert size == (1 if name.startswith("NVIC.IPR") else 4), f"{name} was read as {size} bytes"
        if name == "TIM5.CNT" and self["TIM5.CR1"] & 1:
            return self.now_us & 0xFFFFFFFF
        if name == "IWDG.SR":
            self._updating = max(0, self._updating - 1)
            return 3 if self._updating else 0
        value = self._crc() if name == "CRC.DR" else self.values[name]
        if name == self.chunk_flags:
            self.on_look()
        self._was_read(name)
        return value

    def _was_read(self, name: str) -> None:
        """A read of the data that follows one of the flags ends EOC, or the line's overrun (RM0090, 30.6.1)."""
        block, _, register = name.partition(".")
        if register == "DR" and block != "CRC":
            flags = f"{block}.SR" if f"{block}.SR" in self.values else f"{block}.ISR"
            if self._read_last == flags:
                self.values[flags] &= ~(8 if block.startswith("USART") else self.end_of_conversion(block))
        self._read_last = name

    def end_of_conversion(self, adc: str) -> int:
        return 2 if f"{adc}.SR" in self.values else 4

    def write(self, address: int, size: int, value: int) -> None:
        name = self.names[address]
        assert size == (1 if name.startswith("NVIC.IPR") else 4), f"{name} was written as {size} bytes"
        if name != "CRC.DR":
            self.trace.append((name, value))
        self._effects.get(name, lambda v: self.values.__setitem__(name, v))(value)

    def _clock_control(self, value: int) -> None:
        chip = self.chip
        mask, crystal = chip.pll_from_crystal
        ready = chip.hsi_ready | (1 << 17 if value & 1 << 16 and self._crystal else 0)
        source_runs = self._crystal or self[chip.pll_source] & mask != crystal
        ready |= 1 << 25 if value & 1 << 24 and self._pll and source_runs else 0
        self["RCC.CR"] = value & ~(chip.hsi_ready | 1 << 17 | 1 << 25) | ready

    def _clock_switch(self, value: int) -> None:
        """What SW asks for SWS shows, right above it."""
        width = self.chip.switch_bits
        mask = (1 << width) - 1
        self["RCC.CFGR"] = value & ~(mask << width) | (value & mask) << width

    def _forget_reset_flags(self, value: int) -> None:
        self[self.chip.reset_register] = 0 if value & self.chip.forget_reset_flags else value

    def _reset_blocks(self, register: str, value: int) -> None:
        for (name, bit), blocks in self.chip.resets.items():
            if name == register and value & 1 << bit:
                for one in self.chip.addresses:
                    if one.partition(".")[0] in blocks:
                        self.values[one] = (_RESET | self.chip.reset).get(one, 0)

    def _clear(self, flags: str, value: int) -> None:
        self.values[flags] &= ~value
        if flags == self.chunk_flags:
            self.on_clear()

    def _watchdog_key(self, value: int) -> None:
        if value == 0xCCCC or (value == 0xAAAA and self.t_fed_us is not None):
            self.t_fed_us = self.now_us
            self.fed_early |= value == 0xAAAA and self._updating > 0

    def _watchdog_reload(self, value: int) -> None:
        self["IWDG.RLR"] = value
        self._updating = _UPDATE_READS

    def _adc_flags(self, name: str, value: int) -> None:
        self.values[f"{name}.ISR"] &= ~value

    def _adc_control(self, name: str, value: int) -> None:
        """Of the ADCs of the G4 and the H7: calibrated and ready at once."""
        if value & 1 and not self[f"{name}.CR"] & 1:
            self.values[f"{name}.ISR"] |= 1
        self[f"{name}.CR"] = value & ~(1 << 31)
        if value & 4 and self.field(f"{name}.SQR1", 6, 5) == self.chip.reference_channel:
            self.convert_reference(name)
            self.values[f"{name}.CR"] &= ~4

    def convert_reference(self, name: str) -> None:
        """Once, by software."""
        self[f"{name}.DR"] = round(self.chip.reference_word * self.chip.reference_v / self.supply_v)
        self.values[f"{name}.{'SR' if f'{name}.SR' in self.values else 'ISR'}"] |= self.end_of_conversion(name)

    def _window_watchdog(self, value: int) -> None:
        self["WWDG.CR"] = value
        self.t_window_us = self.now_us if value & 0x80 else None

    def _system_reset(self, value: int) -> None:
        assert value == 0x05FA0004
        self.reset_requested = True
        self.on_reset()

    def _pend_tick(self, value: int) -> None:
        assert value == 1 << 28, "PENDSVSET alone (PM0214, 4.4.3)"
        self.tick_pending = True

    def _crc(self) -> int:
        """RM0090, 4: the polynomial of Ethernet, the highest bit first; zlib's has the lowest first."""
        value = zlib.crc32(np.array(self._summed, ">u4").tobytes().translate(_REVERSED)) ^ 0xFFFFFFFF
        return int(f"{value:032b}"[::-1], 2)

    def _forget_interrupt(self, _: int) -> None:
        self.pending = False

    def move_pins(self, port: str, value: int) -> None:
        output = f"{port}.ODR"
        if port == "GPIOB" and value & ~self[output] & 1 << 12:
            self.t_pulse_us = self.now_us
        self[output] = self[output] & ~(value >> 16) | value & 0xFFFF
