"""The STM32F405 as RM0090 (rev 18) has it: its memory map (2.3) and DMA request tables 42 and 43 (10.3.3). A section's
number at a block is this manual's."""

from __future__ import annotations

from . import chip
from .chip import Chip, Effect, Interrupt, Registers, Route, dma_blocks

_ADC = "SR CR1 CR2 SMPR1 SMPR2 @2C SQR1 _ SQR3 @4C DR"
_DMA = "LISR HISR LIFCR HIFCR"


def _effects(p: Registers) -> dict[str, Effect]:
    def control(value: int) -> None:
        """RM0090, 13.13.3: SWSTART converts one channel."""
        p["ADC1.CR2"] = value & ~(1 << 30)
        if value & 1 << 30:
            p.convert_reference("ADC1")

    return {"ADC1.CR2": control}


F405 = Chip(
    name="stm32f405",
    modes=2,
    blocks={
        "PWR": (0x40007000, "CR CSR"),  # 5.4
        "DAC": (0x40007400, chip.DAC),  # 14.5
        "USART1": (0x40011000, "SR DR BRR CR1 CR2 CR3"),  # 30.6
        "ADC1": (0x40012000, _ADC),  # 13.13
        "ADC2": (0x40012100, _ADC),
        "ADC": (0x40012300, "@04 CCR CDR"),
        "SYSCFG": (0x40013800, "@14 EXTICR4"),  # 9.2.6
        "EXTI": (0x40013C00, chip.EXTI),  # 12.3
        "GPIOA": (0x40020000, chip.GPIO),  # 8.4
        "GPIOB": (0x40020400, chip.GPIO),
        "RCC": (0x40023800, "CR PLLCFGR CFGR @20 APB1RSTR APB2RSTR @30 AHB1ENR @40 APB1ENR APB2ENR @74 CSR"),  # 7.3
        "FLASH": (0x40023C00, "ACR @14 OPTCR"),  # 3.9
        "DMA1": (0x40026000, _DMA),  # 10.5
        "DMA2": (0x40026400, _DMA),
        **dma_blocks(0x40026000),
    },
    reset={
        "RCC.CR": 0x83,
        "RCC.PLLCFGR": 0x24003010,
        "RCC.AHB1ENR": 0x00100000,
        "PWR.CR": 0x4000,
        "GPIOA.MODER": 0xA8000000,
        "GPIOB.MODER": 0x280,
        "GPIOB.IDR": 0,  # no amplifier has a fault, and the emergency stop is not pushed: both circuits are closed
        "USART1.SR": 0xC0,  # nothing is on the line
        "FLASH.OPTCR": 0x0FFFAAE1,  # as delivered, but for the brown-out level 3
    },
    # 14.3.4: without a trigger a word is put out a cycle after it was written.
    silent=lambda _: {"DAC.CR": 0x00010001, "DAC.DHR12RD": 0x08000800},
    sampled=lambda _: [Route("DMA2_S0", "ADC.CDR", 4, modes=2)],
    played=lambda _: [Route("DMA1_S5", "DAC.DHR12RD", 4, modes=2)],
    chunk=lambda _: Interrupt(56, "DMA2.LISR", 0x10, 0x20),  # 12.2
    resets={
        ("RCC.APB1RSTR", 0): ("TIM2",),
        ("RCC.APB1RSTR", 29): ("DAC",),
        ("RCC.APB2RSTR", 8): ("ADC1", "ADC2", "ADC"),
    },
    reference_channel=17,  # 13.3.3
    effects=_effects,
    identity_at=0x1FFF7A10,
    reference_at=0x1FFF7A2A,  # DS8626: read at 3.3 V
    reference_word=1501,  # 1.21 V of 3.3
    reference_v=3.3,
    core_hz=168e6,
    line_hz=84e6,
    window_hz=42e6,
    load_max=0.25,
    reset_flags=(0x0E000000, 1 << 26, 5 << 26, 9 << 26, 1 << 25 | 1 << 26, 1 << 31 | 1 << 26),
    power_on_flags=0x0E000000,  # pin, power and brown-out together
    forget_reset_flags=1 << 24,
    hsi_ready=1 << 1,
    pll_from_crystal=(1 << 22, 1 << 22),
    line="USART1",
    line_flags="USART1.SR",
    receives="DMA2_S2",
    sends=("DMA2_S7", "DMA2.HISR", 0x20 << 22),
    window_prescaler=(7, 2),
    port="GPIOB",
    fault_pin=14,
    stop_pin=15,
    interlock_irq=40,
    brown_out_off={"FLASH.OPTCR": 0x0FFFAAED},  # 3.9.9
    weak_supply={"PWR.CSR": 1 << 2},
)
