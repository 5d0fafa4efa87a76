"""The STM32G474 as RM0440 (rev 9) has it: its memory map (2.2), its DMAMUX request inputs (13.3.2), the triggers of its
DACs and ADCs (22.7.1, 21.7.4), its clock tree (7.2); pins after the datasheet DS12288. A section's number at a block is
this manual's.
"""

from __future__ import annotations

from . import chip
from .chip import CHANNELS, INTERNAL_HZ, Chip, Clocks, Field, Registers, Route, dma_blocks, whole

_CRYSTAL_HZ = 24e6
_RCC = "CR _ CFGR PLLCFGR @2C AHB2RSTR @38 APB1RSTR1 @48 AHB1ENR AHB2ENR @58 APB1ENR1 APB1ENR2 APB2ENR @94 CSR"  # 7.4
_MID_RAIL, _HIGH_SPEED = 0x08000800, 2 << 14  # of a DAC's MCR: its interface at 160 MHz and more
# A mode's DAC: who asks for its words, the register that they go to, its pin.
_OUTPUTS = (
    ("DAC1_1", "DAC1.DHR12R1", "GPIOA", 4),
    ("DAC1_2", "DAC1.DHR12R2", "GPIOA", 5),
    ("DAC2_1", "DAC2.DHR12R1", "GPIOA", 6),
    ("DAC3_2", "DAC3.DHR12R2", "GPIOB", 1),  # by OPAMP3
    ("DAC3_1", "DAC3.DHR12R1", "GPIOB", 11),  # by OPAMP6
)


def _clocks(p: Registers) -> Clocks:
    """RM0440, 7.2.4 and 7.4.4; boost mode 6.1.5, wait states 3.3.3."""
    assert p.field("RCC.CFGR", 2, 2) == 3, "the PLL clocks the core"
    assert p.field("RCC.CFGR", 4, 10) == 0, "AHB and both APBs run at the core's clock"
    config = p["RCC.PLLCFGR"]
    assert config >> 24 & 1, "the PLL's output R is off"
    phase_hz = (_CRYSTAL_HZ if config & 3 == 3 else INTERNAL_HZ) / ((config >> 4 & 0xF) + 1)
    vco_hz = phase_hz * (config >> 8 & 0x7F)
    core_hz = vco_hz / (2 * (config >> 25 & 3) + 2)
    assert 2.66e6 <= phase_hz <= 16e6
    assert 96e6 <= vco_hz <= 344e6
    assert core_hz <= 150e6 or not p.field("PWR.CR5", 8, 1), "above 150 MHz without the boost mode"
    assert core_hz <= 34e6 * (1 + p.field("FLASH.ACR", 0, 4)), "too few wait states"
    assert core_hz / 4 <= 52e6
    return Clocks(core_hz, core_hz, core_hz / 4, 256 * core_hz, core_hz)


def _expected(modes: int) -> list[Field]:
    """RM0440, 22.7.1 (CR), 22.7.16 (MCR), 25.5 (OPAMP), 21.7.3 (CR), 21.7.4 (CFGR), 21.7.11 (SQR1), 21.8.2 (CCR)."""
    on = 1 << 0 | 1 << 1 | 4 << 2 | 1 << 12  # a channel: enabled, triggered by TIM2, it asks for DMA
    follows = 1 << 0 | 3 << 2 | 3 << 5 | 1 << 7  # an amplifier: on, of DAC3, as a follower, at high speed
    found = [whole("DAC1.CR", on * 0x00010001), whole("DAC1.MCR", _HIGH_SPEED)]
    if modes > 2:
        found += [whole("DAC2.CR", on), whole("DAC2.MCR", _HIGH_SPEED)]
    if modes > 3:  # within, without a buffer
        found += [whole("DAC3.CR", on << 16 | (on if modes > 4 else 0)), whole("DAC3.MCR", _HIGH_SPEED | 3 << 16 | 3)]
        found += [whole(f"OPAMP.CSR{i}", follows) for i in (3, 6)[: modes - 3]]
        found += [Field("RCC.AHB2ENR", 18, 1, 1)]
    found += [Field(f"{port}.MODER", 2 * pin, 2, 3) for _, _, port, pin in _OUTPUTS[:modes]]
    for name in [f"ADC{k + 1}" for k in range(modes)]:  # it converts: 12 bits, circular by DMA, at TIM2's falling edge
        found += [whole(f"{name}.CR", 1 << 28 | 1 << 2 | 1), whole(f"{name}.CFGR", 3 | 11 << 5 | 2 << 10)]
        found += [Field(f"{name}.SQR1", 0, 4, 0)]
    # Independent, a quarter of the core's clock; ADC5 watches the internal reference where it has no sensor.
    found += [whole("ADC12.CCR", 3 << 16), whole("ADC345.CCR", 3 << 16 | (modes < 5) << 22)]
    # DMA1, DMA2, DMAMUX; GPIOA to GPIOC, ADC12, ADC345, DAC1, DAC2; TIM2, TIM5, WWDG, PWR; LPUART1; SYSCFG and OPAMP.
    clocked = {"AHB1ENR": (0, 1, 2), "AHB2ENR": (0, 1, 2, 13, 14, 16, 17), "APB1ENR1": (0, 3, 11, 28)}
    clocked |= {"APB1ENR2": (0,), "APB2ENR": (0,)}
    found += [Field(f"RCC.{bus}", bit, 1, 1) for bus, bits in clocked.items() for bit in bits]
    # The line sends and receives; PA2 and PA3 are AF12.
    return [
        *found, whole("LPUART1.CR1", 0xD), Field("GPIOA.MODER", 4, 4, 0xA), Field("GPIOA.AFRL", 8, 8, 0xCC)
    ]  # fmt: skip


def _silent(modes: int) -> list[Field]:
    """RM0440, 22.4.5: without a trigger a word is put out a few cycles after it was written."""
    found = [whole("DAC1.CR", 0x00010001), whole("DAC1.DHR12RD", _MID_RAIL)]
    found += [whole("DAC2.CR", 1), whole("DAC2.DHR12R1", 0x800)]
    return found + ([whole("DAC3.CR", 0x00010001), whole("DAC3.DHR12RD", _MID_RAIL)] if modes > 3 else [])


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
        **dma_blocks(0x40020000, CHANNELS),
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
    dma=CHANNELS,
    requests={5: "ADC1", 6: "DAC1_1", 7: "DAC1_2", 34: "RX", 35: "TX", 36: "ADC2", 37: "ADC3", 38: "ADC4", 39: "ADC5"}
    | {41: "DAC2_1", 102: "DAC3_1", 103: "DAC3_2"},
    memory=range(0x20000000, 0x20018000),
    clocks=_clocks,
    expected=_expected,
    silent=_silent,
    sampled=lambda modes: [Route(f"ADC{k + 1}", f"ADC{k + 1}.DR", 2, 4) for k in range(modes)],
    played=lambda modes: [Route(request, register, 2, 4) for request, register, *_ in _OUTPUTS[:modes]],
    inputs={("ADC1", 1): ("GPIOA", 0), ("ADC2", 2): ("GPIOA", 1), ("ADC3", 12): ("GPIOB", 0)}
    | {("ADC4", 5): ("GPIOB", 15), ("ADC5", 2): ("GPIOA", 9)},
    sequence=("SQR1", 6, 6, 0),
    sample_cycles=(2.5, 6.5, 12.5, 24.5, 47.5, 92.5, 247.5, 640.5),
    conversion_cycles=12.5,
    resets={
        ("RCC.APB1RSTR1", 0): ("TIM2",),
        ("RCC.AHB2RSTR", 13): ("ADC1", "ADC2", "ADC12"),
        ("RCC.AHB2RSTR", 14): ("ADC3", "ADC4", "ADC5", "ADC345"),
        **{("RCC.AHB2RSTR", 15 + i): (f"DAC{i}",) for i in (1, 2, 3)},
    },
    # 21.4.11: channel 18 of each but ADC2; 640.5 cycles, where it needs 4 us (DS12288); started by no trigger.
    references={
        name: (Field(f"{common}.CCR", 22, 1, 1), Field(f"{name}.SMPR2", 24, 3, 7), Field(f"{name}.CFGR", 10, 2, 0))
        for name, common in (("ADC1", "ADC12"), ("ADC5", "ADC345"))
    },
    reference_channel=18,
    identity_at=0x1FFF7590,
    reference_at=0x1FFF75AA,  # DS12288: read at 3.0 V
    reference_word=1654,  # 1.212 V of 3.0
    reference_v=3.0,
    core_hz=170e6,
    load_max=0.51,
    reset_flags=(0x0C000000, 1 << 26, 5 << 26, 9 << 26, None, 1 << 31 | 1 << 26),
    power_on_flags=0x0C000000,  # there is no flag for power alone
    forget_reset_flags=1 << 23,
    hsi_ready=1 << 10,
    pll_from_crystal=(3, 3),
    chunk_flags="DMA1.ISR",
    line="LPUART1",
    line_flags="LPUART1.ISR",
    window_prescaler=(11, 3),
    port="GPIOC",
    fault_pin=6,
    stop_pin=7,
    interlock_irq=23,
    has_tick=lambda modes: modes > 3,
    supply_detector=whole("PWR.CR2", 6 << 1 | 1),  # 6.4.2: on, at 2.9 V
    brown_out_off={"FLASH.OPTR": 0xFFEFF8AA},  # 3.7.8
    weak_supply={"PWR.SR2": 1 << 11},
    wait_states=4,
)
