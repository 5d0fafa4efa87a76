"""The registers of an STM32: what is the same on every chip here, and how they live.

Registers keep what is written to them; those with a life of their own are `Peripherals`' methods. An address that is
not in the tables raises: the firmware has no business there. The chips' tables are in `stm32f405`, `stm32g474` and
`stm32h743`, written down from the reference manuals (RM0090 rev 18, RM0440 rev 9, RM0433 rev 8; the last's addresses
and bits by the CMSIS header) apart from the firmware's own headers. Each block has its section, in this order where
there are three. Those of RM0440 were compared with a transcription of that revision, the others' chapters with what
public code cites; no copy of RM0090 and RM0433 was at hand.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

GPIO = {
    "MODER": 0x00,
    "OSPEEDR": 0x08,
    "PUPDR": 0x0C,
    "IDR": 0x10,
    "ODR": 0x14,
    "BSRR": 0x18,
    "AFRL": 0x20,
    "AFRH": 0x24,
}
DAC = {"CR": 0x00, "DHR12R1": 0x08, "DHR12R2": 0x14, "DHR12RD": 0x20, "SR": 0x34, "MCR": 0x3C}
EXTI = {"IMR": 0x00, "RTSR": 0x08, "PR": 0x14}
_TIMER = {"CR1": 0x00, "CR2": 0x04, "EGR": 0x14, "CCMR1": 0x18, "CNT": 0x24, "PSC": 0x28, "ARR": 0x2C, "CCR1": 0x34}
_NVIC = {f"{name}{i}": at + 4 * i for name, at in (("ISER", 0), ("ICPR", 0x180)) for i in range(4)}
_MPU = {"MPU_CTRL": 0x94, "MPU_RNR": 0x98, "MPU_RBAR": 0x9C, "MPU_RASR": 0xA0}

COMMON: dict[str, tuple[int, dict[str, int]]] = {
    "TIM2": (0x40000000, _TIMER),  # 18.4; 30.5; 39.4
    "TIM5": (0x40000C00, _TIMER),
    "WWDG": (0x40002C00, {"CR": 0x00, "CFR": 0x04}),  # 22.6; 36.5; 44
    "IWDG": (0x40003000, {"KR": 0x00, "PR": 0x04, "RLR": 0x08, "SR": 0x0C}),  # 21.4; 35.4; 45
    "CRC": (0x40023000, {"DR": 0x00, "CR": 0x08}),  # 4.4; 16.4; 21
    "NVIC": (0xE000E100, _NVIC | {f"IPR{i}": 0x300 + i for i in range(102)}),  # PM0214, 4.3 (the M7's: PM0253, 4)
    "SCB": (0xE000ED00, {"ICSR": 0x04, "AIRCR": 0x0C, "SHPR3": 0x20, "CPACR": 0x88} | _MPU),  # 4.4; CPACR 4.6, MPU 4.2
    "DBGMCU": (0xE0042000, {"APB1_FZ": 0x08}),  # 38.16; 47.16; 60
}
_RESET = {"IWDG.RLR": 0xFFF, "TIM2.ARR": 0xFFFFFFFF, "TIM5.ARR": 0xFFFFFFFF, "CRC.DR": 0xFFFFFFFF} | {
    "GPIOA.PUPDR": 0x64000000,
    "GPIOB.PUPDR": 0x00000100,
    "WWDG.CR": 0x7F,
}
_UPDATE_READS = 3  # of the watchdog's status until its slow clock has taken a new reload on


def _crc_table() -> list[int]:
    table = []
    for byte in range(256):
        value = byte << 24
        for _ in range(8):
            value = value << 1 ^ (0x04C11DB7 if value >> 31 else 0)
            value &= 0xFFFFFFFF
        table.append(value)
    return table


_CRC_TABLE = _crc_table()
Effect = Callable[[int], None]  # of the value written


class Peripherals:
    """`registers` by name, `trace` of all writes in order; `now_us` is set by whoever lets time pass."""

    BLOCKS: ClassVar[dict[str, tuple[int, dict[str, int]]]]
    RESET: ClassVar[dict[str, int]]
    ADDRESS: ClassVar[dict[str, int]]
    NAME: ClassVar[dict[int, str]]
    POWER_ON: ClassVar[int] = 0x0E000000  # RCC_CSR: pin, power and brown-out together
    RESET_FLAGS: ClassVar[str] = "RCC.CSR"
    HSI_READY: ClassVar[int]
    PLL_SOURCE: ClassVar[str] = "RCC.PLLCFGR"
    PLL_FROM_CRYSTAL: ClassVar[tuple[int, int]]  # mask and value in it
    FORGET_RESET_FLAGS: ClassVar[int]
    CHUNK_FLAGS: ClassVar[str]
    REFERENCE_WORD: ClassVar[int]  # what the factory's ADC read of the internal reference
    REFERENCE_V: ClassVar[float]  # VDDA meanwhile

    def __init_subclass__(cls) -> None:
        cls.BLOCKS = COMMON | cls.BLOCKS
        cls.RESET = _RESET | cls.RESET
        cls.ADDRESS = {
            f"{block}.{name}": base + at for block, (base, names) in cls.BLOCKS.items() for name, at in names.items()
        }
        cls.NAME = {address: name for name, address in cls.ADDRESS.items()}

    def __init__(self, *, crystal: bool = True, pll: bool = True, reset_flags: int | None = None) -> None:
        flags = self.POWER_ON if reset_flags is None else reset_flags
        self.registers = dict.fromkeys(self.ADDRESS, 0) | self.RESET | {self.RESET_FLAGS: flags}
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
        self._crystal = crystal
        self._pll = pll
        self._updating = 0
        self._effects: dict[str, Effect] = {
            "RCC.CR": self._clock_control,
            "RCC.CFGR": self._clock_switch,
            self.RESET_FLAGS: self._reset_flags,
            "IWDG.KR": self._watchdog_key,
            "IWDG.RLR": self._watchdog_reload,
            "WWDG.CR": self._window_watchdog,
            "SCB.AIRCR": self._system_reset,
            "SCB.ICSR": self._pend_tick,
            "CRC.CR": lambda _: self.registers.__setitem__("CRC.DR", 0xFFFFFFFF),
            "CRC.DR": self._crc,
            "GPIOA.BSRR": lambda value: self.move_pins("GPIOA.ODR", value),
            "GPIOB.BSRR": self._port_b,
            **{f"NVIC.ISER{i}": self._enable_interrupts(i) for i in range(4)},
            **{f"NVIC.ICPR{i}": self._forget_interrupt for i in range(4)},
            **self.own_effects(),
        }

    def own_effects(self) -> dict[str, Effect]:
        """What a write to a register of this chip alone does, besides being kept."""
        return {}

    def __getitem__(self, name: str) -> int:
        return self.registers[name]

    def __setitem__(self, name: str, value: int) -> None:
        self.registers[name] = value

    def field(self, name: str, at: int, width: int) -> int:
        return self.registers[name] >> at & ((1 << width) - 1)

    def read(self, address: int, size: int) -> int:
        self.reads += 1
        name = self.NAME[address]
        assert size == (1 if name.startswith("NVIC.IPR") else 4), f"{name} was read as {size} bytes"
        if name == "TIM5.CNT" and self.registers["TIM5.CR1"] & 1:
            return self.now_us & 0xFFFFFFFF
        if name == "IWDG.SR":
            self._updating = max(0, self._updating - 1)
            return 3 if self._updating else 0
        value = self.registers[name]
        if name == self.CHUNK_FLAGS:
            self.on_look()
        self.was_read(name)
        return value

    def was_read(self, name: str) -> None:
        """What a read of a register of this chip alone does."""

    def write(self, address: int, size: int, value: int) -> None:
        name = self.NAME[address]
        assert size == (1 if name.startswith("NVIC.IPR") else 4), f"{name} was written as {size} bytes"
        if name != "CRC.DR":
            self.trace.append((name, value))
        self._effects.get(name, lambda v: self.registers.__setitem__(name, v))(value)

    def _clock_control(self, value: int) -> None:
        mask, crystal = self.PLL_FROM_CRYSTAL
        ready = self.HSI_READY | (1 << 17 if value & 1 << 16 and self._crystal else 0)
        source_runs = self._crystal or self.registers[self.PLL_SOURCE] & mask != crystal
        ready |= 1 << 25 if value & 1 << 24 and self._pll and source_runs else 0
        self.registers["RCC.CR"] = value & ~(self.HSI_READY | 1 << 17 | 1 << 25) | ready

    def _clock_switch(self, value: int) -> None:
        self.registers["RCC.CFGR"] = value & ~0xC | (value & 3) << 2

    def _reset_flags(self, value: int) -> None:
        self.registers[self.RESET_FLAGS] = 0 if value & self.FORGET_RESET_FLAGS else value

    def reset_blocks(self, value: int, blocks: dict[int, list[str]]) -> None:
        for bit, names in blocks.items():
            for block in names if value & 1 << bit else []:
                for register in self.BLOCKS[block][1]:
                    name = f"{block}.{register}"
                    self.registers[name] = self.RESET.get(name, 0)

    def clear(self, flags: str, value: int) -> None:
        self.registers[flags] &= ~value
        if flags == self.CHUNK_FLAGS:
            self.on_clear()

    def _watchdog_key(self, value: int) -> None:
        if value == 0xCCCC or (value == 0xAAAA and self.t_fed_us is not None):
            self.t_fed_us = self.now_us
            self.fed_early |= value == 0xAAAA and self._updating > 0

    def _watchdog_reload(self, value: int) -> None:
        self.registers["IWDG.RLR"] = value
        self._updating = _UPDATE_READS

    def adc_control(self, name: str, reference: int, other_bits: int, convert: Callable[[str], None]) -> Effect:
        """Of the ADCs of the G4 and the H7. Calibration ends at once. One is ready if its regulator ran, and it was
        calibrated. `convert` is called when it starts on the channel of the internal reference."""
        calibrated = False

        def write(value: int) -> None:
            nonlocal calibrated
            before = self.registers[f"{name}.CR"]
            if value & 1 << 31:
                assert before & ~other_bits == 1 << 28, "calibrated without its regulator, or while enabled"
                calibrated = True
            if value & 1 and not before & 1:
                assert calibrated, "enabled before it was calibrated"
                self.registers[f"{name}.ISR"] |= 1
            assert not value & 4 or before & 1, "started before it was enabled"
            self.registers[f"{name}.CR"] = value & ~(1 << 31)
            if value & 4 and self.field(f"{name}.SQR1", 6, 5) == reference:
                convert(name)

        return write

    def reference_reading(self) -> int:
        """What the ADC reads of the internal reference."""
        return round(self.REFERENCE_WORD * self.REFERENCE_V / self.supply_v)

    def _window_watchdog(self, value: int) -> None:
        self.registers["WWDG.CR"] = value
        self.t_window_us = self.now_us if value & 0x80 else None

    def _system_reset(self, value: int) -> None:
        assert value == 0x05FA0004
        self.reset_requested = True
        self.on_reset()

    def _pend_tick(self, value: int) -> None:
        assert value == 1 << 28, "PENDSVSET alone (PM0214, 4.4.3)"
        self.tick_pending = True

    def _crc(self, word: int) -> None:
        value = self.registers["CRC.DR"]
        for byte in word.to_bytes(4, "big"):
            value = (value << 8 & 0xFFFFFF00) ^ _CRC_TABLE[value >> 24 ^ byte]
        self.registers["CRC.DR"] = value

    def _enable_interrupts(self, i: int) -> Effect:
        return lambda value: self.registers.__setitem__(f"NVIC.ISER{i}", self.registers[f"NVIC.ISER{i}"] | value)

    def _forget_interrupt(self, _: int) -> None:
        self.pending = False

    def _port_b(self, value: int) -> None:
        if value & ~self.registers["GPIOB.ODR"] & 1 << 12:
            self.t_pulse_us = self.now_us
        self.move_pins("GPIOB.ODR", value)

    def move_pins(self, output: str, value: int) -> None:
        self.registers[output] = self.registers[output] & ~(value >> 16) | value & 0xFFFF
