"""The STM32H743, revision V, as RM0433 (rev 8) has it: its memory map (2.3), its DMAMUX request inputs (17.3), the
fields of its ADCs (25), SPIs (50) and timers (39.4), its clock tree (8.5); pins after DS12110. Addresses and bits are
those of the public CMSIS header. A section's number at a block is this manual's.

Two AD5624 hang at its SPIs: `Registers.dacs` is what they would put out, where the firmware moves their pins by hand.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Final

from . import peripherals
from .peripherals import Effect, Peripherals
from .wiring import Lane, Sampling, Stream, Wiring, stream_of

_ADC = {"ISR": 0x00, "CR": 0x08, "CFGR": 0x0C, "CFGR2": 0x10, "SMPR1": 0x14, "SMPR2": 0x18, "PCSEL": 0x1C} | {
    "SQR1": 0x30,
    "DR": 0x40,
}
_SPI = {"CR1": 0x00, "CR2": 0x04, "CFG1": 0x08, "CFG2": 0x0C, "SR": 0x14, "TXDR": 0x20}
_STREAM = {"CR": 0x00, "NDTR": 0x04, "PAR": 0x08, "M0AR": 0x0C, "FCR": 0x14}
_USART = {"CR1": 0x00, "CR3": 0x08, "BRR": 0x0C, "ISR": 0x1C, "RDR": 0x24, "TDR": 0x28}
_TIM3 = {
    "CR1": 0x00,
    "SMCR": 0x08,
    "DIER": 0x0C,
    "CCMR1": 0x18,
    "CCMR2": 0x1C,
    "CCER": 0x20,
    "CNT": 0x24,
    "PSC": 0x28,
} | {
    "ARR": 0x2C,
    "CCR1": 0x34,
    "CCR3": 0x3C,
}
_RCC = {
    "CR": 0x00,
    "CFGR": 0x10,
    "D1CFGR": 0x18,
    "D2CFGR": 0x1C,
    "D3CFGR": 0x20,
    "PLLCKSELR": 0x28,
    "PLLCFGR": 0x2C,
} | {
    "PLL1DIVR": 0x30,
    "D2CCIP1R": 0x50,
    "D2CCIP2R": 0x54,
    "AHB1RSTR": 0x80,
    "AHB4RSTR": 0x88,
    "APB1LRSTR": 0x90,
    "APB2RSTR": 0x98,
    "GCR": 0xA0,
    "RSR": 0xD0,
    "AHB1ENR": 0xD8,
    "AHB2ENR": 0xDC,
    "AHB4ENR": 0xE0,
    "APB3ENR": 0xE4,
    "APB1LENR": 0xE8,
    "APB2ENR": 0xF0,
    "APB4ENR": 0xF4,
}
_REQUESTS: Final = {9: "ADC1", 10: "ADC2", 23: "TIM3_CH1", 25: "TIM3_CH3", 45: "RX", 46: "TX", 115: "ADC3"}
_TRIGGER_TIM2_ADC: Final = 11
_SAMPLE_CYCLES: Final = (1.5, 2.5, 8.5, 16.5, 32.5, 64.5, 387.5, 810.5)
_CONVERSION_CYCLES: Final = 6.5  # of 12 bits
# DS12110, pin definitions.
_INPUTS: Final = {("ADC1", 2): ("GPIOF", 11), ("ADC1", 6): ("GPIOF", 12), ("ADC1", 15): ("GPIOA", 3)} | {
    ("ADC2", 2): ("GPIOF", 13),
    ("ADC2", 5): ("GPIOB", 1),
    ("ADC2", 10): ("GPIOC", 0),
    ("ADC3", 4): ("GPIOF", 5),
    ("ADC3", 6): ("GPIOF", 10),
}
# Clock and data of a chip of DACs, and the SYNC of both, with their alternate functions: SPI1, SPI3, TIM3_CH1.
_CLOCKS: Final = (("GPIOA", 5, 5), ("GPIOC", 10, 6))
_DATA: Final = (("GPIOB", 5, 5), ("GPIOC", 12, 6))
_SYNC: Final = ("GPIOA", 6, 2)
# Clocks: DMA1, DMA2, ADC12; SRAM1, SRAM2; GPIOA to D, F, CRC, ADC3; TIM2, TIM3, TIM5, SPI3, USART3; WWDG; SPI1; SYSCFG.
_CLOCKED: Final = {"AHB1ENR": (0, 1, 5), "AHB2ENR": (29, 30), "AHB4ENR": (0, 1, 2, 3, 5, 19, 24)} | {
    "APB1LENR": (0, 1, 3, 15, 18),
    "APB3ENR": (6,),
    "APB2ENR": (12,),
    "APB4ENR": (1,),
}
_START_S: Final = 25 / 192e6  # from a DMA request to the SPI's first clock: assumed, as the firmware does
_BITS: Final = 24


@dataclass(slots=True)
class Dac:
    """An AD5624: 24 bits, read at falling edges of the clock while SYNC is low; the 24th does what they say.

    Two that do not matter, three of a command, three of an address, 12 of data, four that do not matter (AD5624, input
    shift register). `level` of 4096, None before anything was written.
    """

    held: list[int | None] = field(default_factory=lambda: [None] * 4)
    level: list[int | None] = field(default_factory=lambda: [None] * 4)
    _bits: list[int] = field(default_factory=list)

    def sync_fell(self) -> None:
        self._bits = []

    def clock_fell(self, bit: int) -> None:
        self._bits.append(bit)
        if len(self._bits) == _BITS:
            self.take(int("".join(map(str, self._bits)), 2))

    def take(self, word: int) -> None:
        command, address = word >> 19 & 7, word >> 16 & 7
        assert command in (0, 2, 3), "neither a write, nor one that moves all, nor one that moves its own"
        assert address in (0, 1, 2, 3, 7)
        written = range(4) if address == 7 else [address]
        for k in written:
            self.held[k] = word >> 4 & 0xFFF
        for k in {0: [], 2: range(4), 3: written}[command]:
            self.level[k] = self.held[k]


class Registers(Peripherals):
    BLOCKS: ClassVar = {
        "TIM3": (0x40000400, _TIM3),  # 39.4
        "SPI3": (0x40003C00, _SPI),  # 50
        "USART3": (0x40004800, _USART),  # 48.7
        "SPI1": (0x40013000, _SPI),
        "DMA1": (0x40020000, {"LISR": 0x00, "LIFCR": 0x08}),  # 15
        "DMA2": (0x40020400, {"LISR": 0x00, "HISR": 0x04, "LIFCR": 0x08, "HIFCR": 0x0C}),
        "DMAMUX": (0x40020800, {f"C{i}CR": 4 * i for i in range(16)}),  # 17
        "ADC1": (0x40022000, _ADC),  # 25
        "ADC2": (0x40022100, _ADC),
        "ADC12": (0x40022300, {"CCR": 0x08}),
        "WWDG": (0x50003000, {"CR": 0x00, "CFR": 0x04}),
        "FLASH": (0x52002000, {"ACR": 0x00, "OPTSR_CUR": 0x1C}),  # 4.9
        "EXTI": (0x58000000, {"RTSR": 0x00, "IMR": 0x80, "PR": 0x88}),  # 20
        "SYSCFG": (0x58000400, {"EXTICR2": 0x0C}),  # 12
        "IWDG": (0x58004800, {"KR": 0x00, "PR": 0x04, "RLR": 0x08, "SR": 0x0C}),
        **{f"GPIO{port}": (0x58020000 + 0x400 * i, peripherals.GPIO) for i, port in enumerate("ABCDEF")},  # 11.4
        "RCC": (0x58024400, _RCC),  # 8.7
        "PWR": (0x58024800, {"CR1": 0x00, "CSR1": 0x04, "CR3": 0x0C, "D3CR": 0x18}),  # 6.8
        "CRC": (0x58024C00, {"DR": 0x00, "CR": 0x08}),
        "ADC3": (0x58026000, _ADC),
        "ADC3C": (0x58026300, {"CCR": 0x08}),
        "DBGMCU": (0x5C001000, {"APB3FZ1": 0x34, "APB1LFZ1": 0x3C, "APB4FZ1": 0x54}),
        "SCB": (0xE000ED00, peripherals.COMMON["SCB"][1] | {"CCR": 0x14, "ICIALLU": 0x250}),
        **{
            f"DMA{unit}_S{i}": (0x40020000 + 0x400 * (unit - 1) + 0x10 + 0x18 * i, _STREAM)
            for unit in (1, 2)
            for i in range(8)
        },
    }
    RESET: ClassVar = {"RCC.CR": 0x25, "RCC.PLLCKSELR": 0x02020200, "RCC.PLLCFGR": 0x01FF0000} | {
        "RCC.PLL1DIVR": 0x01010280,
        "PWR.CR3": 0x6,
        "PWR.D3CR": 0x4000,
        "PWR.CSR1": 0x2000,
        "FLASH.ACR": 0x37,
        "FLASH.OPTSR_CUR": 0x0406AAFC,  # as delivered, but for the brown-out level 3
        "GPIOA.MODER": 0xABFFFFFF,
        "GPIOB.MODER": 0xFFFFFEBF,
        **{f"GPIO{port}.MODER": 0xFFFFFFFF for port in "CDEF"},
        "GPIOA.OSPEEDR": 0x0C000000,
        "GPIOB.OSPEEDR": 0x000000C0,
        "USART3.ISR": 0xC0,
        "SPI1.SR": 0x1002,
        "SPI3.SR": 0x1002,
        "TIM3.ARR": 0xFFFF,
        **{f"ADC{i}.{name}": value for i in (1, 2, 3) for name, value in (("CR", 1 << 29), ("CFGR", 1 << 31))},
    }
    POWER_ON: ClassVar = 1 << 21 | 1 << 22 | 1 << 23
    RESET_FLAGS: ClassVar = "RCC.RSR"
    HSI_READY: ClassVar = 1 << 2
    PLL_SOURCE: ClassVar = "RCC.PLLCKSELR"
    PLL_FROM_CRYSTAL: ClassVar = (3, 2)
    FORGET_RESET_FLAGS: ClassVar = 1 << 16
    CHUNK_FLAGS: ClassVar = "DMA2.LISR"
    REFERENCE_WORD: ClassVar = 24150  # 1.216 V of 3.3
    REFERENCE_V: ClassVar = 3.3

    def was_read(self, name: str) -> None:
        """RM0433, 25.4: a read of the data clears EOC."""
        if name == "ADC3.DR":
            self.registers["ADC3.ISR"] &= ~4

    def own_effects(self) -> dict[str, Effect]:
        self.dacs = (Dac(), Dac())
        return {
            "RCC.CFGR": lambda value: self.registers.__setitem__("RCC.CFGR", value & ~0x38 | (value & 7) << 3),
            "RCC.AHB1RSTR": lambda value: self.reset_blocks(value, {5: ["ADC1", "ADC2", "ADC12"]}),
            "RCC.AHB4RSTR": lambda value: self.reset_blocks(value, {24: ["ADC3", "ADC3C"]}),
            "RCC.APB1LRSTR": lambda value: self.reset_blocks(value, {0: ["TIM2"], 1: ["TIM3"], 15: ["SPI3"]}),
            "RCC.APB2RSTR": lambda value: self.reset_blocks(value, {12: ["SPI1"]}),
            "PWR.D3CR": lambda value: self.registers.__setitem__("PWR.D3CR", value | 1 << 13),
            "DMA1.LIFCR": lambda value: self.clear("DMA1.LISR", value),
            "DMA2.LIFCR": lambda value: self.clear("DMA2.LISR", value),
            "DMA2.HIFCR": lambda value: self.clear("DMA2.HISR", value),
            "GPIOA.BSRR": self._moves("GPIOA"),
            "GPIOC.BSRR": self._moves("GPIOC"),
            **{f"ADC{i}.CR": self.adc_control(f"ADC{i}", 19, 3 << 8, self._convert_reference) for i in (1, 2, 3)},
            **{f"ADC{i}.ISR": self._adc_flags(f"ADC{i}") for i in (1, 2, 3)},
        }

    def _moves(self, port: str) -> Effect:
        def write(value: int) -> None:
            before = [self._pin(*clock) for clock in _CLOCKS], self._pin(*_SYNC)
            self.move_pins(f"{port}.ODR", value)
            clocks, sync = [self._pin(*clock) for clock in _CLOCKS], self._pin(*_SYNC)
            for dac, was, is_high, data in zip(self.dacs, before[0], clocks, _DATA, strict=True):
                if before[1] and not sync:
                    dac.sync_fell()
                if was and not is_high and not sync:
                    dac.clock_fell(self._pin(*data))

        return write

    def _pin(self, port: str, pin: int, _function: int) -> int:
        """Of an output, what the program puts there; any other pin is low."""
        is_output = self.field(f"{port}.MODER", 2 * pin, 2) == 1
        return self.field(f"{port}.ODR", pin, 1) if is_output else 0

    def _convert_reference(self, name: str) -> None:
        """Once, by software, in 16 bits: 4.3 us of sampling are needed (DS12110)."""
        assert name == "ADC3"
        assert self.field("ADC3C.CCR", 22, 1), "the reference is off"
        assert self.field("ADC3.SMPR2", 27, 3) == 7, "810.5 cycles"
        assert self["ADC3.CFGR"] == 1 << 31, "16 bits, and started by no trigger"
        assert self["ADC3.PCSEL"] == 1 << 19
        self.registers["ADC3.DR"] = self.reference_reading()
        self.registers["ADC3.ISR"] |= 4
        self.registers["ADC3.CR"] &= ~4

    def _adc_flags(self, name: str) -> Effect:
        return lambda value: self.registers.__setitem__(f"{name}.ISR", self.registers[f"{name}.ISR"] & ~value)


class Wires(Wiring):
    CRYSTAL_HZ = 8e6
    INTERNAL_HZ = 64e6

    def core_hz(self) -> float:
        p = self.p
        assert p.field("RCC.D1CFGR", 8, 4) < 8, "the core runs at the system's clock"
        source = p.field("RCC.CFGR", 3, 3)
        if source == 0:
            return self.INTERNAL_HZ
        assert source == 3
        core_hz = self._pll_hz(9, 16)
        assert core_hz <= 400e6, "VOS1"
        assert p.field("PWR.D3CR", 14, 2) == 3, "VOS1"
        assert p["PWR.CR3"] == 2, "the regulator is the supply, by software"
        return core_hz

    def _pll_hz(self, divider_at: int, enable: int) -> float:
        """Of an output of PLL1 (RM0433, 8.5.5); its VCO is wide."""
        p = self.p
        assert p.field("RCC.PLLCFGR", enable, 1), "an output of the PLL is off"
        source = p.field("RCC.PLLCKSELR", 0, 2)
        reference_hz = {0: self.INTERNAL_HZ, 2: self.CRYSTAL_HZ}[source] / p.field("RCC.PLLCKSELR", 4, 6)
        assert p.field("RCC.PLLCFGR", 2, 2) == 3, "its reference is 8 to 16 MHz"
        assert 8e6 <= reference_hz <= 16e6
        assert p["RCC.PLLCFGR"] & 3 == 0, "wide, without a fraction"
        vco_hz = reference_hz * (p.field("RCC.PLL1DIVR", 0, 9) + 1)
        assert 192e6 <= vco_hz <= 836e6
        return vco_hz / (p.field("RCC.PLL1DIVR", divider_at, 7) + 1)

    def bus_hz(self) -> float:
        assert self.p.field("RCC.D1CFGR", 0, 4) == 8, "half of the core's clock"
        bus_hz = self.core_hz() / 2
        assert bus_hz <= 200e6
        assert self.p["FLASH.ACR"] & 0xF >= 2, "wait states at VOS1, 140 to 210 MHz"
        assert self.p.field("FLASH.ACR", 4, 2) == 2
        return bus_hz

    def apb_hz(self) -> float:
        """APB1 to APB4: half of the bus's."""
        assert (self.p["RCC.D2CFGR"], self.p["RCC.D3CFGR"]) == (0x440, 0x40)
        assert self.p.field("RCC.D1CFGR", 4, 3) == 4
        return self.bus_hz() / 2

    def timer_clock_hz(self) -> float:
        """Twice the divided bus's."""
        return 2 * self.apb_hz()

    def streams(self) -> dict[str, Stream]:
        found = {}
        for unit in (1, 2):
            for i in range(8):
                name = f"DMA{unit}_S{i}"
                control = self.p[f"{name}.CR"]
                if control & 1:
                    request = _REQUESTS[self.p[f"DMAMUX.C{8 * (unit - 1) + i}CR"]]
                    assert request not in found, f"two streams answer {request}"
                    found[request] = self._stream(name, control, request)
        return found

    def _stream(self, name: str, control: int, request: str) -> Stream:
        assert self.p[f"{name}.FCR"] == 0, "direct mode"
        assert bool(control >> 20 & 1) == (request in ("RX", "TX")), "TRBUFF is for the USARTs (ES0392, 2.20.4)"
        memory = self.p[f"{name}.M0AR"]
        assert 0x30000000 <= memory < 0x30040000, f"{name} cannot reach {memory:#x}, or only by way of another domain"
        assert memory % (1 << (control >> 13 & 3)) == 0
        return stream_of(name, control, self.p[f"{name}.PAR"], memory, self.p[f"{name}.NDTR"])

    def sampling(self) -> Sampling:
        p = self.p
        clocked = all(p[f"RCC.{bus}"] >> bit & 1 for bus, bits in _CLOCKED.items() for bit in bits)
        assert clocked, "a peripheral runs without a clock"
        running = self.streams()
        moved_s = self._check_dacs(running)
        sensors = [sensor for i in (1, 2, 3) for sensor in self._check_adc(f"ADC{i}", running[f"ADC{i}"])]
        period_s = 1 / self.timer_hz("TIM2")
        assert max(at_s for *_, at_s in sensors) < moved_s < period_s, "all is sampled before the DACs move"
        lanes = []
        for k, (at, stride, _, at_s) in enumerate(sensors):
            out = running["TIM3_CH1" if k < 4 else "TIM3_CH3"]
            delay_frac = (at_s + period_s - moved_s) / period_s
            lanes.append(Lane(out.memory + 4 * (k % 4), at, 16, stride, delay_frac, played_shift=4))
        self._check_interrupts(running)
        per_sample = {running[f"ADC{i}"].name: n for i, n in ((1, 3), (2, 3), (3, 2))}
        per_sample |= {running[name].name: 4 for name in ("TIM3_CH1", "TIM3_CH3")}
        return Sampling(
            self.timer_hz("TIM2"),
            running["ADC1"].items // 3,
            self.trigger_delay_frac(),
            tuple(lanes),
            tuple(channel for _, _, channel, _ in sensors),
            irq=58,
            flags="DMA2.LISR",
            half=0x10 << 16,
            complete=0x20 << 16,
            sampling=tuple(running[f"ADC{i}"].name for i in (3, 1, 2)),
            playing=(running["TIM3_CH1"].name, running["TIM3_CH3"].name),
            items=per_sample,
        )

    def _check_interrupts(self, running: dict[str, Stream]) -> None:
        p = self.p
        assert [running[name].name for name in ("ADC3", "ADC1", "ADC2")] == ["DMA2_S0", "DMA2_S1", "DMA2_S2"]
        assert running["ADC2"].interrupts == {"half", "complete", "error"}, "served last of its instant"
        for name in ("ADC1", "ADC3", "TIM3_CH1", "TIM3_CH3"):
            assert running[name].interrupts == {"error"}
        assert len({p.field(f"DMA2_S{i}.CR", 16, 2) for i in range(3)}) == 1, "equally urgent"
        assert self.interrupts() == {1, 11, 12, 23, 56, 57, 58}
        priorities = [p[f"NVIC.IPR{irq}"] for irq in (1, 11, 12, 23, 56, 57, 58)]
        assert priorities == [0, 16, 16, 32, 16, 16, 16], "interlocks do not interrupt a tick"
        assert p["SCB.SHPR3"] == 32 << 16, "PendSV is below the chunks"

    def _check_dacs(self, running: dict[str, Stream]) -> float:
        """When in a period of TIM2 the DACs move, in s after its rising edge. RM0433, 39.4: SMCR, CCMR, CCER, DIER."""
        p = self.p
        tick_s = 1 / self.timer_clock_hz()
        assert p["TIM3.PSC"] == 0
        assert 4 * (p["TIM3.ARR"] + 1) == p["TIM2.ARR"] + 1, "four words to each sample"
        assert p["TIM3.SMCR"] == 1 << 4 | 6, "it starts with TIM2 (ITR1), once"
        assert (p["TIM3.CR1"], p["TIM3.CNT"]) == (0, 0)
        assert (p["TIM3.CCMR1"] & 0xFF, p["TIM3.CCMR2"], p["TIM3.CCER"]) == (6 << 4, 0, 1), (
            "PWM 1 at the pin: high first"
        )
        assert p["TIM3.DIER"] == 1 << 9 | 1 << 11, "words as channels 1 and 3 compare"
        assert p["TIM3.CCR1"] == p["TIM3.CCR3"]
        self._check_pins()
        word_s = _BITS / self._spi_hz()
        sync_high_s, part_s = p["TIM3.CCR1"] * tick_s, (p["TIM3.ARR"] + 1) * tick_s
        assert sync_high_s >= 15e-9, "AD5624: SYNC high"
        assert sync_high_s + _START_S + word_s < part_s, "a word outlasts its part"
        for request, spi in (("TIM3_CH1", "SPI1"), ("TIM3_CH3", "SPI3")):
            out = running[request]
            assert out.peripheral == p.ADDRESS[f"{spi}.TXDR"]
            assert (out.to_peripheral, out.circular, out.memory_size, out.peripheral_size) == (True, True, 4, 4)
            assert out.items == 4 * (running["ADC1"].items // 3)
        return 3 * part_s + sync_high_s + _START_S + word_s

    def _spi_hz(self) -> float:
        """RM0433, 50: SPI_CFG1, SPI_CFG2, SPI_CR1."""
        p = self.p
        assert p.field("RCC.D2CCIP1R", 12, 3) == 0, "PLL1's output Q"
        for spi in ("SPI1", "SPI3"):
            assert p.field(f"{spi}.CFG1", 0, 5) == _BITS - 1
            assert p[f"{spi}.CFG2"] == 1 << 31 | 1 << 26 | 1 << 24 | 1 << 22 | 1 << 17, "master, CPHA, it sends alone"
            assert p[f"{spi}.CR1"] == 1 << 12 | 1 << 9 | 1, "started, without an end"
            assert p[f"{spi}.CR2"] == 0
        spi_hz = self._pll_hz(16, 17) / (2 << p.field("SPI1.CFG1", 28, 3))
        assert spi_hz <= 50e6, "AD5624: its clock"
        return spi_hz

    def _check_pins(self) -> None:
        for port, pin, function in (*_CLOCKS, *_DATA, _SYNC):
            half = "AFRL" if pin < 8 else "AFRH"
            assert self.p.field(f"{port}.MODER", 2 * pin, 2) == 2
            assert self.p.field(f"{port}.{half}", 4 * (pin % 8), 4) == function
            assert self.p.field(f"{port}.OSPEEDR", 2 * pin, 2) == 3, "48 MHz need a fast pin"

    def _check_adc(self, name: str, stream: Stream) -> list[tuple[int, int, int, float]]:
        """Of each sensor: where its first sample goes, how far it is to the next, its channel, when it is sampled.
        RM0433, 25: ADC_CFGR, ADC_CR (BOOST), ADC_PCSEL, ADC_SMPR, ADC_SQR1."""
        p = self.p
        assert stream.peripheral == p.ADDRESS[f"{name}.DR"]
        assert (stream.to_peripheral, stream.circular, stream.memory_size, stream.peripheral_size) == (
            False,
            True,
            2,
            2,
        )
        assert p[f"{name}.CFGR"] == 1 << 31 | 2 << 10 | _TRIGGER_TIM2_ADC << 5 | 2 << 2 | 3, (
            "12 bits, circular, falling"
        )
        assert p[f"{name}.CFGR2"] == 0, "right-aligned in 16"
        common = "ADC3C" if name == "ADC3" else "ADC12"
        assert p[f"{common}.CCR"] == 3 << 16, "independent, a quarter of the bus's clock"
        clock_hz = self.bus_hz() / 4 / 2
        assert 12.5e6 < clock_hz <= 25e6
        assert p.field(f"{name}.CR", 8, 2) == 2, "its boost is for 12.5 to 25 MHz"
        n = p.field(f"{name}.SQR1", 0, 4) + 1
        channels = [p.field(f"{name}.SQR1", 6 * (rank + 1), 5) for rank in range(n)]
        assert p[f"{name}.PCSEL"] == sum(1 << channel for channel in channels)
        found, at_s = [], self.trigger_delay_frac() / self.timer_hz("TIM2")
        for rank, channel in enumerate(channels):
            port, pin = _INPUTS[name, channel]
            assert p.field(f"{port}.MODER", 2 * pin, 2) == 3, "an input is not analogue"
            cycles = _SAMPLE_CYCLES[p.field(f"{name}.SMPR{1 + channel // 10}", 3 * (channel % 10), 3)]
            found.append((stream.memory + 2 * rank, 2 * n, channel, at_s + cycles / clock_hz))
            at_s += (cycles + _CONVERSION_CYCLES) / clock_hz
        assert at_s < 1 / self.timer_hz("TIM2"), "it would be triggered while it converts"
        return found

    def window_watchdog_s(self) -> float:
        assert self.p["RCC.GCR"] == 1, "it resets the whole chip"
        return self._window_watchdog_s(self.apb_hz(), self.p.field("WWDG.CFR", 11, 3))

    def baud(self) -> float:
        p = self.p
        assert p["USART3.CR1"] == 0xD, "enabled, to send and to receive"
        assert (p.field("GPIOD.MODER", 16, 4), p.field("GPIOD.AFRH", 0, 8)) == (0xA, 0x77), "PD8 and PD9 are AF7"
        assert p.field("RCC.D2CCIP2R", 0, 3) == 0, "APB1's clock"
        return self.apb_hz() / p["USART3.BRR"]

    def deaf(self) -> bool:
        """RM0433, 48.7, CR3: with OVRDIS an overrun loses its byte alone."""
        return bool(self.p.field("USART3.ISR", 3, 1)) and not self.p.field("USART3.CR3", 12, 1)

    def finish_sending(self) -> None:
        """RM0433, 15, DMA_SxCR, EN: a stream that is not circular disables itself."""
        self.p["DMA2_S4.CR"] &= ~1
        self.p["DMA2.HISR"] |= 0x20
