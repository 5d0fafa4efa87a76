"""The STM32F405 as RM0090 (rev 18) has it: its memory map (2.3), its DMA request tables 42 and 43 (10.3.3), the
triggers of its DAC (14.3.6) and ADCs (13.6), its clock tree (7.2). A section's number at a block is this manual's.
"""

from __future__ import annotations

from . import chip
from .chip import INTERNAL_HZ, STREAMS, Chip, Clocks, Effect, Field, Registers, Route, dma_blocks, whole

_CRYSTAL_HZ = 8e6
_ADC = "SR CR1 CR2 SMPR1 SMPR2 @2C SQR1 _ SQR3 @4C DR"
_DMA = "LISR HISR LIFCR HIFCR"
_MID_RAIL = 0x08000800


def _clocks(p: Registers) -> Clocks:
    """RM0090, 7.3.2 and 7.3.3; on a divided APB the timers have twice its clock."""
    assert p.field("RCC.CFGR", 2, 2) == 2, "the PLL clocks the core"
    assert p.field("RCC.CFGR", 4, 4) < 8, "the AHB prescaler is 1"
    config = p["RCC.PLLCFGR"]
    input_hz = _CRYSTAL_HZ if config >> 22 & 1 else INTERNAL_HZ
    core_hz = input_hz / (config & 0x3F) * (config >> 6 & 0x1FF) / (2 * (config >> 16 & 3) + 2)
    codes = p.field("RCC.CFGR", 10, 3), p.field("RCC.CFGR", 13, 3)
    apb1_hz, apb2_hz = (core_hz / (1 if code < 4 else 2 << (code - 4)) for code in codes)
    adc_hz = apb2_hz / (2 * p.field("ADC.CCR", 16, 2) + 2)
    assert adc_hz <= 36e6
    return Clocks(core_hz, apb1_hz * (2 if codes[0] >= 4 else 1), adc_hz, apb2_hz, apb1_hz)


def _expected(_modes: int) -> list[Field]:
    """RM0090, 14.5.1: EN, TEN, TSEL, DMAEN; 13.13.3 (CR2), 13.13.9 (SQR1), 13.13.16 (CCR); 7.3 (clocks)."""
    adc = [Field(f"{name}.SQR1", 20, 4, 0) for name in ("ADC1", "ADC2")]  # one channel each
    clocked = [("AHB1", 21), ("AHB1", 22), ("APB1", 0), ("APB1", 11), ("APB1", 29)]  # DMAs; TIM2, WWDG, DAC
    clocked += [("APB2", bit) for bit in (4, 8, 9, 14)]  # USART1, ADC1, ADC2, SYSCFG
    return [
        # Both on, at TIM2's trigger; channel 2's requests would go nowhere and count as underruns.
        whole("DAC.CR", (1 << 0 | 1 << 2 | 4 << 3) * 0x00010001 | 1 << 12),
        Field("GPIOA.MODER", 8, 4, 0xF),  # PA4 and PA5 are analogue
        # Dual simultaneous; requests go on after the buffer's first round; pairs by DMA; a quarter of APB2's clock.
        whole("ADC.CCR", 6 << 0 | 1 << 13 | 2 << 14 | 1 << 16),
        # On, right-aligned, at the falling edge of TIM2's trigger; ADC2 follows.
        whole("ADC1.CR2", 1 << 0 | 6 << 24 | 2 << 28),
        whole("ADC2.CR2", 1 << 0),
        *adc,
        *(Field(f"RCC.{bus}ENR", bit, 1, 1) for bus, bit in clocked),
    ]


def _silent(_modes: int) -> list[Field]:
    """RM0090, 14.3.4: without a trigger a word is put out a cycle after it was written."""
    return [whole("DAC.CR", 0x00010001), whole("DAC.DHR12RD", _MID_RAIL)]


def _effects(p: Registers) -> dict[str, Effect]:
    def control(value: int) -> None:
        """RM0090, 13.13.3: SWSTART converts one channel."""
        p["ADC1.CR2"] = value & ~(1 << 30)
        if value & 1 << 30:
            assert value & 1, "started before it was switched on"
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
        **dma_blocks(0x40026000, STREAMS),
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
    dma=STREAMS,
    requests={
        157: "DAC1",
        167: "DAC2",
        200: "ADC1",
        240: "ADC1",
        224: "RX",
        254: "RX",
        274: "TX",
    },  # unit stream channel
    memory=range(0x20000000, 0x20020000),
    clocks=_clocks,
    expected=_expected,
    silent=_silent,
    sampled=lambda _: [Route("ADC1", "ADC.CDR", 4, 4, modes=2)],
    played=lambda _: [Route("DAC1", "DAC.DHR12RD", 4, 4, modes=2)],
    inputs={("ADC1", 1): ("GPIOA", 1), ("ADC2", 2): ("GPIOA", 2)},
    sequence=("SQR3", 0, 5, 20),
    sample_cycles=(3, 15, 28, 56, 84, 112, 144, 480),
    conversion_cycles=12,
    converts_past_moves=True,
    resets={
        ("RCC.APB1RSTR", 0): ("TIM2",),
        ("RCC.APB1RSTR", 29): ("DAC",),
        ("RCC.APB2RSTR", 8): ("ADC1", "ADC2", "ADC"),
    },
    # 13.3.3: channel 17 of ADC1; 13.13.16: TSVREFE connects it; 480 cycles, as it needs 10 us of sampling (DS8626).
    references={"ADC1": (whole("ADC1.SQR3", 17), Field("ADC.CCR", 23, 1, 1), Field("ADC1.SMPR1", 21, 3, 7))},
    reference_channel=17,
    effects=_effects,
    identity_at=0x1FFF7A10,
    reference_at=0x1FFF7A2A,  # DS8626: read at 3.3 V
    reference_word=1501,  # 1.21 V of 3.3
    reference_v=3.3,
    core_hz=168e6,
    load_max=0.25,
    reset_flags=(0x0E000000, 1 << 26, 5 << 26, 9 << 26, 1 << 25 | 1 << 26, 1 << 31 | 1 << 26),
    power_on_flags=0x0E000000,  # pin, power and brown-out together
    forget_reset_flags=1 << 24,
    hsi_ready=1 << 1,
    pll_from_crystal=(1 << 22, 1 << 22),
    chunk_flags="DMA2.LISR",
    line="USART1",
    line_flags="USART1.SR",
    window_prescaler=(7, 2),
    port="GPIOB",
    fault_pin=14,
    stop_pin=15,
    interlock_irq=40,
    has_tick=lambda _: False,
    supply_detector=Field("PWR.CR", 4, 4, 7 << 1 | 1),  # 5.4: on, at 2.9 V
    brown_out_off={"FLASH.OPTCR": 0x0FFFAAED},  # 3.9.9
    weak_supply={"PWR.CSR": 1 << 2},
)
