"""The STM32G474 as RM0440 (rev 9) has it: its memory map (2.2), its DMAMUX (13.3.2). A section's number at a
block is this manual's."""

from __future__ import annotations

from . import chip
from .chip import Chip, Interrupt, Route, dma_blocks

_RCC = "CR _ CFGR PLLCFGR @2C AHB2RSTR @38 APB1RSTR1 @48 AHB1ENR AHB2ENR @58 APB1ENR1 APB1ENR2 APB2ENR @94 CSR"  # 7.4
# A mode's converters: who asks for the DMA of its ADC, then of its DAC, and the register that the words go to.
_LANES = (
    (5, 6, "DAC1.DHR12R1"),
    (36, 7, "DAC1.DHR12R2"),
    (37, 41, "DAC2.DHR12R1"),
    (38, 103, "DAC3.DHR12R2"),  # by OPAMP3
    (39, 102, "DAC3.DHR12R1"),  # by OPAMP6
)


def requests(modes: int) -> dict[str, int]:
    """The multiplexer's registers (13.3.2), which DMA1's channels begin."""
    lanes = list(enumerate(_LANES[:modes]))
    return {f"DMAMUX.C{k}CR": adc for k, (adc, _, _) in lanes} | {f"DMAMUX.C{8 + k}CR": dac for k, (_, dac, _) in lanes}


def _silent(modes: int) -> dict[str, int]:
    """RM0440, 22.4.5: without a trigger a word is put out a few cycles after it was written."""
    found = {"DAC1.CR": 0x00010001, "DAC1.DHR12RD": 0x08000800, "DAC2.CR": 1, "DAC2.DHR12R1": 0x800}
    return found | ({"DAC3.CR": 0x00010001, "DAC3.DHR12RD": 0x08000800} if modes > 3 else {})


G474 = Chip(
    name="stm32g474",
    modes=4,
    blocks={
        "PWR": (0x40007000, "_ CR2 @14 SR2 @80 CR5"),  # 6.4
        "LPUART1": (0x40008000, "CR1 CR2 CR3 BRR @1C ISR @24 RDR TDR PRESC"),  # 41.7
        "SYSCFG": (0x40010000, "@0C EXTICR2"),  # 10.2.4
        "OPAMP": (0x40010300, "CSR1 CSR2 CSR3 CSR4 CSR5 CSR6"),  # 25.5
        "EXTI": (0x40010400, chip.EXTI),  # 15.5
        "DMA1": (0x40020000, "ISR IFCR"),  # 12.6
        "DMA2": (0x40020400, "ISR IFCR"),
        "DMAMUX": (0x40020800, " ".join(f"C{i}CR" for i in range(16))),  # 13.6
        "RCC": (0x40021000, _RCC),
        "FLASH": (0x40022000, "ACR @20 OPTR"),  # 3.7
        **{f"GPIO{port}": (0x48000000 + 0x400 * i, chip.GPIO) for i, port in enumerate("ABC")},  # 9.4
        "ADC1": (0x50000000, chip.ADC),  # 21.7
        "ADC2": (0x50000100, chip.ADC),
        "ADC12": (0x50000300, "@08 CCR"),  # 21.8
        **{f"ADC{i}": (0x50000400 + 0x100 * (i - 3), chip.ADC) for i in (3, 4, 5)},
        "ADC345": (0x50000700, "@08 CCR"),
        **{f"DAC{i}": (0x50000800 + 0x400 * (i - 1), chip.DAC) for i in (1, 2, 3)},  # 22.7
        **dma_blocks(0x40020000, is_channels=True),
    },
    reset={
        "RCC.CR": 0x500,
        "RCC.CFGR": 0x5,
        "RCC.PLLCFGR": 0x1000,
        "RCC.AHB1ENR": 0x100,
        "PWR.CR5": 0x100,
        "GPIOA.MODER": 0xABFFFFFF,
        "GPIOB.MODER": 0xFFFFFEBF,
        "GPIOC.MODER": 0xFFFFFFFF,
        "GPIOC.IDR": 0,  # no amplifier has a fault, and the emergency stop is not pushed: both circuits are closed
        "LPUART1.ISR": 0xC0,  # nothing is on the line
        "FLASH.ACR": 0x40600,
        "FLASH.OPTR": 0xFFEFFCAA,  # as delivered, but for the brown-out level 4
        **{f"ADC{i}.{name}": value for i in range(1, 6) for name, value in (("CR", 1 << 29), ("CFGR", 1 << 31))},
    },
    silent=_silent,
    sampled=lambda modes: [Route(f"DMA1_C{k + 1}", f"ADC{k + 1}.DR", 2) for k in range(modes)],
    played=lambda modes: [Route(f"DMA2_C{k + 1}", register, 2) for k, (*_, register) in enumerate(_LANES[:modes])],
    # Equally urgent channels are served in their order (12.4.4): the last one's.
    chunk=lambda modes: Interrupt(10 + modes, "DMA1.ISR", 4 << 4 * (modes - 1), 2 << 4 * (modes - 1)),  # 14.3
    resets={
        ("RCC.APB1RSTR1", 0): ("TIM2",),
        ("RCC.AHB2RSTR", 13): ("ADC1", "ADC2", "ADC12"),
        ("RCC.AHB2RSTR", 14): ("ADC3", "ADC4", "ADC5", "ADC345"),
        **{("RCC.AHB2RSTR", 15 + i): (f"DAC{i}",) for i in (1, 2, 3)},
    },
    reference_channel=18,  # 21.4.11
    identity_at=0x1FFF7590,
    reference_at=0x1FFF75AA,  # DS12288: read at 3.0 V
    reference_word=1654,  # 1.212 V of 3.0
    reference_v=3.0,
    core_hz=170e6,
    line_hz=256 * 170e6,
    window_hz=170e6,
    load_max=0.51,
    reset_flags=(0x0C000000, 1 << 26, 5 << 26, 9 << 26, None, 1 << 31 | 1 << 26),
    power_on_flags=0x0C000000,  # there is no flag for power alone
    forget_reset_flags=1 << 23,
    hsi_ready=1 << 10,
    pll_from_crystal=(3, 3),
    line="LPUART1",
    line_flags="LPUART1.ISR",
    receives="DMA1_C7",
    sends=("DMA1_C8", "DMA1.ISR", 2 << 28),
    window_prescaler=(11, 3),
    port="GPIOC",
    fault_pin=6,
    stop_pin=7,
    interlock_irq=23,
    brown_out_off={"FLASH.OPTR": 0xFFEFF8AA},  # 3.7.8
    weak_supply={"PWR.SR2": 1 << 11},
    wait_states=4,
)
