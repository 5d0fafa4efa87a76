"""The STM32F405's registers as RM0090 (rev 18) lays them out, written down apart from the firmware's own header.

Registers keep what is written to them; those with a life of their own are `Peripherals`' methods. An address that is
not in the tables raises: the firmware has no business there.
"""

from __future__ import annotations

from collections.abc import Callable

_GPIO = {"MODER": 0x00, "PUPDR": 0x0C, "ODR": 0x14, "BSRR": 0x18, "AFRL": 0x20, "AFRH": 0x24}
_TIMER = {"CR1": 0x00, "CR2": 0x04, "EGR": 0x14, "CNT": 0x24, "PSC": 0x28, "ARR": 0x2C}
_ADC = {"SR": 0x00, "CR1": 0x04, "CR2": 0x08, "SMPR2": 0x10, "SQR1": 0x2C, "SQR3": 0x34}
_STREAM = {"CR": 0x00, "NDTR": 0x04, "PAR": 0x08, "M0AR": 0x0C, "FCR": 0x14}
_RCC = {"CR": 0x00, "PLLCFGR": 0x04, "CFGR": 0x08, "APB1RSTR": 0x20, "APB2RSTR": 0x24, "AHB1ENR": 0x30}

BLOCKS: dict[str, tuple[int, dict[str, int]]] = {
    "TIM2": (0x40000000, _TIMER),
    "TIM5": (0x40000C00, _TIMER),
    "IWDG": (0x40003000, {"KR": 0x00, "PR": 0x04, "RLR": 0x08}),
    "DAC": (0x40007400, {"CR": 0x00, "DHR12LD": 0x24, "SR": 0x34}),
    "USART1": (0x40011000, {"SR": 0x00, "DR": 0x04, "BRR": 0x08, "CR1": 0x0C, "CR2": 0x10, "CR3": 0x14}),
    "ADC1": (0x40012000, _ADC),
    "ADC2": (0x40012100, _ADC),
    "ADC": (0x40012300, {"CCR": 0x04, "CDR": 0x08}),
    "GPIOA": (0x40020000, _GPIO),
    "GPIOB": (0x40020400, _GPIO),
    "RCC": (0x40023800, _RCC | {"APB1ENR": 0x40, "APB2ENR": 0x44, "CSR": 0x74}),
    "FLASH": (0x40023C00, {"ACR": 0x00}),
    "DMA1": (0x40026000, {"HIFCR": 0x0C, "HISR": 0x04}),
    "DMA2": (0x40026400, {"LISR": 0x00, "HISR": 0x04, "LIFCR": 0x08, "HIFCR": 0x0C}),
    **{
        f"DMA{unit}_S{i}": (0x40026000 + 0x400 * (unit - 1) + 0x10 + 0x18 * i, _STREAM)
        for unit in (1, 2)
        for i in range(8)
    },
    "NVIC": (0xE000E100, {"ISER1": 0x04, "ICPR1": 0x184, "IPR56": 0x338}),
    "SCB": (0xE000ED00, {"AIRCR": 0x0C, "CPACR": 0x88}),
    "DBGMCU": (0xE0042000, {"APB1_FZ": 0x08}),
}
ADDRESS = {f"{block}.{name}": base + at for block, (base, names) in BLOCKS.items() for name, at in names.items()}
NAME = {address: name for name, address in ADDRESS.items()}
_RESET = {"RCC.CR": 0x83, "RCC.PLLCFGR": 0x24003010, "RCC.AHB1ENR": 0x00100000, "GPIOA.MODER": 0xA8000000} | {
    "GPIOB.MODER": 0x280,
    "IWDG.RLR": 0xFFF,
    "GPIOA.PUPDR": 0x64000000,
    "TIM2.ARR": 0xFFFFFFFF,
    "TIM5.ARR": 0xFFFFFFFF,
}

POWER_ON = 0x0E000000  # RCC_CSR: pin, power and brown-out together
HALF, COMPLETE = 0x10, 0x20  # flags of stream 0, and of stream 4


class Peripherals:
    """`registers` by name, `trace` of all writes in order; `now_us` is set by whoever lets time pass."""

    def __init__(self, *, crystal: bool = True, pll: bool = True, reset_flags: int = POWER_ON) -> None:
        self.registers = dict.fromkeys(ADDRESS, 0) | _RESET | {"RCC.CSR": reset_flags}
        self.trace: list[tuple[str, int]] = []
        self.reads = 0
        self.now_us = 0
        self.t_fed_us: int | None = None  # None while the watchdog is not started
        self.reset_requested = False
        self.on_reset: Callable[[], None] = lambda: None
        self.on_look: Callable[[], None] = lambda: None  # what happens right after the ADC's flags were read
        self.on_clear: Callable[[], None] = lambda: None  # and right after they were cleared
        self.pending = False  # the chunk's interrupt, latched while its handler works
        self._crystal = crystal
        self._pll = pll
        self._effects: dict[str, Callable[[int], None]] = {
            "RCC.CR": self._clock_control,
            "RCC.CFGR": self._clock_switch,
            "RCC.CSR": self._reset_flags,
            "RCC.APB1RSTR": lambda value: self._reset_blocks(value, {0: ["TIM2"], 29: ["DAC"]}),
            "RCC.APB2RSTR": lambda value: self._reset_blocks(value, {8: ["ADC1", "ADC2", "ADC"]}),
            "IWDG.KR": self._watchdog_key,
            "SCB.AIRCR": self._system_reset,
            "NVIC.ICPR1": self._forget_interrupt,
            "DMA2.LIFCR": lambda value: self._clear("DMA2.LISR", value),
            "DMA2.HIFCR": lambda value: self._clear("DMA2.HISR", value),
            "DMA1.HIFCR": lambda value: self._clear("DMA1.HISR", value),
            "GPIOA.BSRR": lambda value: self._pins("GPIOA.ODR", value),
            "GPIOB.BSRR": lambda value: self._pins("GPIOB.ODR", value),
        }

    def __getitem__(self, name: str) -> int:
        return self.registers[name]

    def __setitem__(self, name: str, value: int) -> None:
        self.registers[name] = value

    def read(self, address: int, size: int) -> int:
        self.reads += 1
        name = NAME[address]
        assert size == (1 if name == "NVIC.IPR56" else 4), f"{name} was read as {size} bytes"
        if name == "TIM5.CNT" and self.registers["TIM5.CR1"] & 1:
            return self.now_us & 0xFFFFFFFF
        value = self.registers[name]
        if name == "DMA2.LISR":
            self.on_look()
        return value

    def write(self, address: int, size: int, value: int) -> None:
        name = NAME[address]
        assert size == (1 if name == "NVIC.IPR56" else 4), f"{name} was written as {size} bytes"
        self.trace.append((name, value))
        self._effects.get(name, lambda v: self.registers.__setitem__(name, v))(value)

    def _clock_control(self, value: int) -> None:
        ready = (1 << 1) | (1 << 17 if value & 1 << 16 and self._crystal else 0)
        source_runs = self._crystal or not self.registers["RCC.PLLCFGR"] & 1 << 22
        ready |= 1 << 25 if value & 1 << 24 and self._pll and source_runs else 0
        self.registers["RCC.CR"] = value & ~(1 << 1 | 1 << 17 | 1 << 25) | ready

    def _clock_switch(self, value: int) -> None:
        self.registers["RCC.CFGR"] = value & ~0xC | (value & 3) << 2

    def _reset_flags(self, value: int) -> None:
        self.registers["RCC.CSR"] = 0 if value & 1 << 24 else value

    def _reset_blocks(self, value: int, blocks: dict[int, list[str]]) -> None:
        for bit, names in blocks.items():
            for block in names if value & 1 << bit else []:
                for register in BLOCKS[block][1]:
                    name = f"{block}.{register}"
                    self.registers[name] = _RESET.get(name, 0)

    def _watchdog_key(self, value: int) -> None:
        if value == 0xCCCC or (value == 0xAAAA and self.t_fed_us is not None):
            self.t_fed_us = self.now_us

    def _system_reset(self, value: int) -> None:
        assert value == 0x05FA0004
        self.reset_requested = True
        self.on_reset()

    def _clear(self, flags: str, value: int) -> None:
        self.registers[flags] &= ~value
        if flags == "DMA2.LISR":
            self.on_clear()

    def _forget_interrupt(self, value: int) -> None:
        assert value == 1 << (56 - 32)
        self.pending = False

    def _pins(self, output: str, value: int) -> None:
        self.registers[output] = self.registers[output] & ~(value >> 16) | value & 0xFFFF
