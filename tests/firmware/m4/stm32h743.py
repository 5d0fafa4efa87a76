"""The STM32H743, revision V, as RM0433 (rev 8) has it: its memory map (2.3), its DMAMUX request inputs (17.3), the
fields of its ADCs (25), SPIs (50) and timers (39.4), its clock tree (8.5); pins after DS12110. Addresses and bits are
those of the public CMSIS header. A section's number at a block is this manual's.

Two AD5624 hang at its SPIs: `Registers.dacs` is what they would put out, where the firmware moves their pins by hand.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from . import chip
from .chip import STREAMS, Chip, Clocks, Effect, Field, Registers, Route, dma_blocks, whole

if TYPE_CHECKING:
    from .wiring import Wiring

_CRYSTAL_HZ, _INTERNAL_HZ = 8e6, 64e6
_SPI = "CR1 CR2 CFG1 CFG2 @14 SR @20 TXDR"
_RCC = (  # 8.7
    "CR @10 CFGR @18 D1CFGR D2CFGR D3CFGR @28 PLLCKSELR PLLCFGR PLL1DIVR @50 D2CCIP1R D2CCIP2R "
    "@80 AHB1RSTR @88 AHB4RSTR @90 APB1LRSTR @98 APB2RSTR @A0 GCR @D0 RSR "
    "@D8 AHB1ENR AHB2ENR AHB4ENR APB3ENR APB1LENR @F0 APB2ENR APB4ENR"
)
# Clock and data of a chip of DACs, and the SYNC of both, with their alternate functions: SPI1, SPI3, TIM3_CH1.
_CLOCKS = (("GPIOA", 5, 5), ("GPIOC", 10, 6))
_DATA = (("GPIOB", 5, 5), ("GPIOC", 12, 6))
_SYNC = ("GPIOA", 6, 2)
_START_S = 25 / 192e6  # from a DMA request to the SPI's first clock: assumed, as the firmware does
_BITS = 24


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


def _effects(p: Registers) -> dict[str, Effect]:
    """The voltage scale is ready at once, and the DACs read their pins where the program moves them."""
    p.dacs = (Dac(), Dac())

    def level(port: str, pin: int, _function: int) -> int:
        return p.field(f"{port}.ODR", pin, 1) if p.field(f"{port}.MODER", 2 * pin, 2) == 1 else 0

    def moves(port: str, value: int) -> None:
        clocks, was_high = [level(*clock) for clock in _CLOCKS], level(*_SYNC)
        p.move_pins(port, value)
        for dac, before, clock, data in zip(p.dacs, clocks, _CLOCKS, _DATA, strict=True):
            if was_high and not level(*_SYNC):
                dac.sync_fell()
            if before and not level(*clock) and not level(*_SYNC):
                dac.clock_fell(level(*data))

    return {
        "PWR.D3CR": lambda value: p.values.__setitem__("PWR.D3CR", value | 1 << 13),
        "GPIOA.BSRR": lambda value: moves("GPIOA", value),
        "GPIOC.BSRR": lambda value: moves("GPIOC", value),
    }


def _pll_hz(p: Registers, divider_at: int) -> float:
    """Of an output of PLL1 (RM0433, 8.5.5); its VCO is wide."""
    source_hz = {0: _INTERNAL_HZ, 2: _CRYSTAL_HZ}[p.field("RCC.PLLCKSELR", 0, 2)]
    reference_hz = source_hz / p.field("RCC.PLLCKSELR", 4, 6)
    vco_hz = reference_hz * (p.field("RCC.PLL1DIVR", 0, 9) + 1)
    assert 8e6 <= reference_hz <= 16e6
    assert 192e6 <= vco_hz <= 836e6
    return vco_hz / (p.field("RCC.PLL1DIVR", divider_at, 7) + 1)


def _clocks(p: Registers) -> Clocks:
    """RM0433, 8.5: the bus at half of the core's clock, each APB at half of that."""
    core_hz = _pll_hz(p, 9)
    bus_hz = core_hz / 2
    assert core_hz <= 400e6, "VOS1"
    assert 140e6 <= bus_hz <= 200e6
    assert 12.5e6 < bus_hz / 8 <= 25e6, "what the ADCs' boost is for"
    assert p.wrong([
        Field("RCC.CFGR", 3, 3, 3),  # the PLL
        Field("RCC.PLLCFGR", 0, 2, 0), Field("RCC.PLLCFGR", 2, 2, 3),  # wide, without a fraction, of 8 to 16 MHz
        Field("RCC.PLLCFGR", 16, 2, 3),  # its outputs P and Q
        Field("PWR.D3CR", 14, 2, 3), whole("PWR.CR3", 2),  # VOS1; the regulator is the supply, by software
        Field("FLASH.ACR", 0, 4, 3), Field("FLASH.ACR", 4, 2, 2),  # wait states at VOS1, 140 to 210 MHz
        whole("RCC.D1CFGR", 4 << 4 | 8), whole("RCC.D2CFGR", 0x440), whole("RCC.D3CFGR", 0x40),
        Field("RCC.D2CCIP1R", 12, 3, 0), Field("RCC.D2CCIP2R", 0, 3, 0),  # the SPIs PLL1's output Q; the line APB1
    ]) == []  # fmt: skip
    return Clocks(core_hz, bus_hz, bus_hz / 4 / 2, bus_hz / 2, bus_hz / 2)


def _expected(_modes: int) -> list[Field]:
    """RM0433, 39.4 (SMCR, CCMR, CCER, DIER), 50 (SPI_CFG1, SPI_CFG2, SPI_CR1), 25 (ADC_CFGR, ADC_CR, ADC_PCSEL)."""
    found = [
        whole("TIM3.SMCR", 1 << 4 | 6),  # it starts with TIM2 (ITR1), once
        whole("TIM3.CR1", 0), whole("TIM3.CNT", 0), whole("TIM3.PSC", 0),
        Field("TIM3.CCMR1", 0, 8, 6 << 4), whole("TIM3.CCMR2", 0), whole("TIM3.CCER", 1),  # PWM 1: high first
        whole("TIM3.DIER", 1 << 9 | 1 << 11),  # words as channels 1 and 3 compare
        whole("RCC.GCR", 1),  # the window watchdog resets the whole chip
        whole("USART3.CR1", 0xD), Field("GPIOD.MODER", 16, 4, 0xA), Field("GPIOD.AFRH", 0, 8, 0x77),  # PD8, PD9 are AF7
    ]  # fmt: skip
    for spi in ("SPI1", "SPI3"):  # master, CPHA, it sends alone; started, without an end
        found += [
            Field(f"{spi}.CFG1", 0, 5, _BITS - 1),
            whole(f"{spi}.CFG2", 1 << 31 | 1 << 26 | 1 << 24 | 1 << 22 | 1 << 17),
        ]
        found += [whole(f"{spi}.CR1", 1 << 12 | 1 << 9 | 1), whole(f"{spi}.CR2", 0)]
    for port, pin, function in (*_CLOCKS, *_DATA, _SYNC):  # 48 MHz need a fast pin
        half = "AFRL" if pin < 8 else "AFRH"
        found += [Field(f"{port}.MODER", 2 * pin, 2, 2), Field(f"{port}.OSPEEDR", 2 * pin, 2, 3)]
        found += [Field(f"{port}.{half}", 4 * (pin % 8), 4, function)]
    channels = {"ADC1": (2, 6, 15), "ADC2": (2, 5, 10), "ADC3": (4, 6)}
    for (
        name,
        several,
    ) in channels.items():  # 12 bits, right-aligned in 16, circular, at the falling edge of TIM2's trigger
        found += [whole(f"{name}.CFGR", 1 << 31 | 2 << 10 | 11 << 5 | 2 << 2 | 3), whole(f"{name}.CFGR2", 0)]
        found += [Field(f"{name}.CR", 8, 2, 2), whole(f"{name}.PCSEL", sum(1 << channel for channel in several))]
    found += [whole("ADC12.CCR", 3 << 16), whole("ADC3C.CCR", 3 << 16)]  # independent, a quarter of the bus's clock
    # DMA1, DMA2, ADC12; SRAM1, SRAM2; GPIOA to D, F, CRC, ADC3; TIM2, TIM3, TIM5, SPI3, USART3; WWDG; SPI1; SYSCFG.
    clocked = {"AHB1ENR": (0, 1, 5), "AHB2ENR": (29, 30), "AHB4ENR": (0, 1, 2, 3, 5, 19, 24)}
    clocked |= {"APB1LENR": (0, 1, 3, 15, 18), "APB3ENR": (6,), "APB2ENR": (12,), "APB4ENR": (1,)}
    # TRBUFF is for the USARTs alone (ES0392, 2.20.4).
    found += [Field(f"{stream}.CR", 20, 1, 0) for stream in ("DMA1_S0", "DMA1_S1", "DMA2_S0", "DMA2_S1", "DMA2_S2")]
    found += [Field("DMA2_S3.CR", 20, 1, 1)]
    return found + [Field(f"RCC.{bus}", bit, 1, 1) for bus, bits in clocked.items() for bit in bits]


def _timing(w: Wiring) -> float:
    """Four words to each sample, the last moves all: RM0433, 39.4; AD5624: SYNC is high for 15 ns, the clock 50 MHz."""
    p = w.p
    assert 4 * (p["TIM3.ARR"] + 1) == p["TIM2.ARR"] + 1
    assert p["TIM3.CCR1"] == p["TIM3.CCR3"]
    tick_s, spi_hz = 1 / w.chip.clocks(p).timer_hz, _pll_hz(p, 16) / (2 << p.field("SPI1.CFG1", 28, 3))
    assert spi_hz <= 50e6
    sync_high_s, part_s = p["TIM3.CCR1"] * tick_s, (p["TIM3.ARR"] + 1) * tick_s
    word_s = sync_high_s + _START_S + _BITS / spi_hz
    assert sync_high_s >= 15e-9
    assert word_s < part_s, "a word outlasts its part"
    return 3 * part_s + word_s


_PIN = 1 << 22
H743 = Chip(
    name="stm32h743",
    modes=8,
    blocks={
        "TIM3": (0x40000400, chip.TIMER),  # 39.4
        "SPI3": (0x40003C00, _SPI),  # 50
        "USART3": (0x40004800, "CR1 _ CR3 BRR @1C ISR @24 RDR TDR"),  # 48.7
        "SPI1": (0x40013000, _SPI),
        "DMA1": (0x40020000, "LISR HISR LIFCR HIFCR"),  # 15
        "DMA2": (0x40020400, "LISR HISR LIFCR HIFCR"),
        "DMAMUX": (0x40020800, " ".join(f"C{i}CR" for i in range(16))),  # 17
        "ADC1": (0x40022000, chip.ADC),  # 25
        "ADC2": (0x40022100, chip.ADC),
        "ADC12": (0x40022300, "@08 CCR"),
        "WWDG": (0x50003000, chip.WWDG),
        "FLASH": (0x52002000, "ACR @1C OPTSR_CUR"),  # 4.9
        "EXTI": (0x58000000, "RTSR @80 IMR @88 PR"),  # 20
        "SYSCFG": (0x58000400, "@0C EXTICR2"),  # 12
        "IWDG": (0x58004800, chip.IWDG),
        **{f"GPIO{port}": (0x58020000 + 0x400 * i, chip.GPIO) for i, port in enumerate("ABCDEF")},  # 11.4
        "RCC": (0x58024400, _RCC),
        "PWR": (0x58024800, "CR1 CSR1 @0C CR3 @18 D3CR"),  # 6.8
        "CRC": (0x58024C00, chip.CRC),
        "ADC3": (0x58026000, chip.ADC),
        "ADC3C": (0x58026300, "@08 CCR"),
        "DBGMCU": (0x5C001000, "@34 APB3FZ1 @3C APB1LFZ1 @54 APB4FZ1"),
        **dma_blocks(0x40020000, STREAMS),
    },
    reset={
        "RCC.CR": 0x25,
        "RCC.PLLCKSELR": 0x02020200,
        "RCC.PLLCFGR": 0x01FF0000,
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
    },
    dma=STREAMS,
    requests={9: "ADC1", 10: "ADC2", 23: "TIM3_CH1", 25: "TIM3_CH3", 45: "RX", 46: "TX", 115: "ADC3"},
    memory=range(0x30000000, 0x30040000),  # else not at all, or only by way of another domain
    clocks=_clocks,
    expected=_expected,
    silent=lambda _: [],
    sampled=lambda _: [Route(name, f"{name}.DR", 2, 2, n) for name, n in (("ADC1", 3), ("ADC2", 3), ("ADC3", 2))],
    played=lambda _: [Route("TIM3_CH1", "SPI1.TXDR", 4, 4, 4), Route("TIM3_CH3", "SPI3.TXDR", 4, 4, 4)],
    inputs={("ADC1", 2): ("GPIOF", 11), ("ADC1", 6): ("GPIOF", 12), ("ADC1", 15): ("GPIOA", 3)}
    | {("ADC2", 2): ("GPIOF", 13), ("ADC2", 5): ("GPIOB", 1), ("ADC2", 10): ("GPIOC", 0)}
    | {("ADC3", 4): ("GPIOF", 5), ("ADC3", 6): ("GPIOF", 10)},
    sequence=("SQR1", 6, 6, 0),
    sample_cycles=(1.5, 2.5, 8.5, 16.5, 32.5, 64.5, 387.5, 810.5),
    conversion_cycles=6.5,  # of 12 bits
    timing=_timing,
    played_shift=4,
    resets={
        ("RCC.AHB1RSTR", 5): ("ADC1", "ADC2", "ADC12"),
        ("RCC.AHB4RSTR", 24): ("ADC3", "ADC3C"),
        ("RCC.APB1LRSTR", 0): ("TIM2",),
        ("RCC.APB1LRSTR", 1): ("TIM3",),
        ("RCC.APB1LRSTR", 15): ("SPI3",),
        ("RCC.APB2RSTR", 12): ("SPI1",),
    },
    # 810.5 cycles, where it needs 4.3 us (DS12110); in 16 bits, and started by no trigger.
    references={
        "ADC3": (
            Field("ADC3C.CCR", 22, 1, 1),
            Field("ADC3.SMPR2", 27, 3, 7),
            whole("ADC3.CFGR", 1 << 31),
            whole("ADC3.PCSEL", 1 << 19),
        )
    },
    reference_channel=19,
    boost=3 << 8,
    effects=_effects,
    identity_at=0x1FF1E800,
    reference_at=0x1FF1E860,  # DS12110: read at 3.3 V, in 16 bits
    reference_word=24150,  # 1.216 V of 3.3
    reference_v=3.3,
    core_hz=384e6,
    load_max=0.60,
    reset_flags=(
        1 << 23 | 1 << 21 | _PIN,
        _PIN,
        1 << 24 | _PIN,
        1 << 26 | _PIN,
        1 << 21 | _PIN,
        1 << 30 | _PIN,
    ),
    power_on_flags=1 << 21 | 1 << 22 | 1 << 23,
    reset_register="RCC.RSR",
    forget_reset_flags=1 << 16,
    hsi_ready=1 << 2,
    switch_bits=3,
    pll_source="RCC.PLLCKSELR",
    pll_from_crystal=(3, 2),
    chunk_flags="DMA2.LISR",
    line="USART3",
    line_flags="USART3.ISR",
    window_prescaler=(11, 3),
    port="GPIOC",
    fault_pin=6,
    stop_pin=7,
    interlock_irq=23,
    has_tick=lambda _: True,
    supply_detector=whole("PWR.CR1", 6 << 5 | 1 << 4),  # 6.8: on, at 2.85 V
    brown_out_off={"FLASH.OPTSR_CUR": 0x0406AAF0},  # 4.9, FLASH_OPTSR
    weak_supply={"PWR.CSR1": 0x2010},
    wait_states=40,
    core="M7",
    memories=((0x00000000, 64 << 10), (0x08000000, 2 << 20), (0x20000000, 128 << 10), (0x30000000, 288 << 10)),
    peripherals=((0x52000000, 0x3000), (0x58000000, 0x30000), (0x5C000000, 0x2000)),
    flash_cache=(512, 32),  # the core's cache of instructions; it has none of data
    bus_cycles=(40, 12),  # assumed: no manual says it
)
