"""The STM32H743, revision V, as RM0433 (rev 8) has it: its memory map (2.3), addresses by the public CMSIS header. A
section's number at a block is this manual's.

Two AD5624 hang at its SPIs: `Registers.dacs` is what they would put out, where the firmware moves their pins by hand.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from . import chip
from .chip import Chip, Effect, Interrupt, Registers, Route, dma_blocks

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
        **dma_blocks(0x40020000),
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
    silent=lambda _: {},
    sampled=lambda _: [Route(f"DMA2_S{i}", f"ADC{k}.DR", 2, n, n) for i, k, n in ((1, 1, 3), (2, 2, 3), (0, 3, 2))],
    played=lambda _: [Route("DMA1_S0", "SPI1.TXDR", 4, 4, 4), Route("DMA1_S1", "SPI3.TXDR", 4, 4, 4)],
    chunk=lambda _: Interrupt(58, "DMA2.LISR", 0x10 << 16, 0x20 << 16),  # 19.1.2; 15.3.4: the last of equal streams
    sample_hz=320e3,
    chunk_samples=16,
    # The fourth of a period's words moves all: SYNC is high for 52 ns of its quarter, 0.13 us pass until the first
    # clock, which the firmware assumes too, and 24 bits come at 48 MHz. A sensor is sampled at a quarter of the period
    # and 8.5 cycles of 24 MHz, those behind it on its ADC 15 cycles later each.
    moved_s=3.0260e-6,
    sampled_s=lambda mode: 0.78125e-6 + (8.5 + 15 * (mode % 3)) / 24e6,
    played_shift=4,
    resets={
        ("RCC.AHB1RSTR", 5): ("ADC1", "ADC2", "ADC12"),
        ("RCC.AHB4RSTR", 24): ("ADC3", "ADC3C"),
        ("RCC.APB1LRSTR", 0): ("TIM2",),
        ("RCC.APB1LRSTR", 1): ("TIM3",),
        ("RCC.APB1LRSTR", 15): ("SPI3",),
        ("RCC.APB2RSTR", 12): ("SPI1",),
    },
    reference_channel=19,
    effects=_effects,
    identity_at=0x1FF1E800,
    reference_at=0x1FF1E860,  # DS12110: read at 3.3 V, in 16 bits
    reference_word=24150,  # 1.216 V of 3.3
    reference_v=3.3,
    core_hz=384e6,
    line_hz=96e6,
    window_hz=96e6,
    load_max=0.61,
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
    line="USART3",
    line_flags="USART3.ISR",
    receives="DMA2_S3",
    sends=("DMA2_S4", "DMA2.HISR", 0x20),
    window_prescaler=(11, 3),
    port="GPIOC",
    fault_pin=6,
    stop_pin=7,
    interlock_irq=23,
    brown_out_off={"FLASH.OPTSR_CUR": 0x0406AAF0},  # 4.9, FLASH_OPTSR
    weak_supply={"PWR.CSR1": 0x2010},
    wait_states=40,
    core="M7",
    memories=((0x00000000, 64 << 10), (0x08000000, 2 << 20), (0x20000000, 128 << 10), (0x30000000, 288 << 10)),
    peripherals=((0x52000000, 0x3000), (0x58000000, 0x30000), (0x5C000000, 0x2000)),
    flash_cache=(512, 32),  # the core's cache of instructions; it has none of data
    bus_cycles=(40, 12),  # assumed: no manual says it
)
