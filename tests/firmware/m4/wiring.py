"""What the registers mean: rates, routes and addresses, derived from nothing but what the firmware wrote.

Numbers of channels, triggers and dividers are RM0090's: clock tree figure 21, DMA request tables 42 and 43, DAC triggers
table 76, ADC triggers table 68.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from .peripherals import ADDRESS, Peripherals

INTERNAL_HZ: Final = 16e6
CRYSTAL_HZ: Final = 8e6
WATCHDOG_HZ: Final = 32e3
REQUESTS: Final = {  # (unit, stream, channel) -> who asks
    (1, 5, 7): "DAC1",
    (1, 6, 7): "DAC2",
    (2, 0, 0): "ADC1",
    (2, 4, 0): "ADC1",
    (2, 2, 4): "USART1_RX",
    (2, 5, 4): "USART1_RX",
    (2, 7, 4): "USART1_TX",
}
_TRIGGER_TIM2_DAC: Final = 4
_TRIGGER_TIM2_ADC: Final = 6
_WORDS: Final = 2


@dataclass(frozen=True, slots=True)
class Stream:
    """A running DMA stream; sizes in bytes."""

    name: str
    peripheral: int
    memory: int
    items: int
    item_size: int
    to_peripheral: bool
    circular: bool


def _divider(code: int) -> int:
    return 1 if code < 4 else 2 << (code - 4)


def core_hz(p: Peripherals) -> float:
    """System clock; the AHB is not divided."""
    assert p["RCC.CFGR"] >> 4 & 0xF < 8, "the AHB prescaler is 1"
    source = p["RCC.CFGR"] >> 2 & 3
    if source != 2:
        return (INTERNAL_HZ, CRYSTAL_HZ)[source]
    config = p["RCC.PLLCFGR"]
    input_hz = CRYSTAL_HZ if config >> 22 & 1 else INTERNAL_HZ
    return input_hz / (config & 0x3F) * (config >> 6 & 0x1FF) / (2 * (config >> 16 & 3) + 2)


def apb_hz(p: Peripherals, bus: int) -> float:
    return core_hz(p) / _divider(p["RCC.CFGR"] >> (10 if bus == 1 else 13) & 7)


def timer_hz(p: Peripherals, name: str) -> float:
    """Updates per second of a timer on APB1: its clock is twice the bus's if that is divided."""
    divided = p["RCC.CFGR"] >> 10 & 7 >= 4
    clock_hz = apb_hz(p, 1) * (2 if divided else 1)
    return clock_hz / (p[f"{name}.PSC"] + 1) / (p[f"{name}.ARR"] + 1)


def streams(p: Peripherals) -> dict[str, Stream]:
    """All enabled streams, by who asks for their transfers."""
    found = {}
    for unit in (1, 2):
        for i in range(8):
            name = f"DMA{unit}_S{i}"
            control = p[f"{name}.CR"]
            if not control & 1:
                continue
            assert p["RCC.AHB1ENR"] >> (20 + unit) & 1, f"{name} runs without a clock"
            assert control >> 11 & 3 == control >> 13 & 3, f"{name} changes the width"
            assert control >> 10 & 1, f"{name} stays at one address"
            request = REQUESTS[unit, i, control >> 25 & 7]
            assert request not in found, f"two streams answer {request}"
            memory, items = p[f"{name}.M0AR"], p[f"{name}.NDTR"]
            assert 0x20000000 <= memory < 0x20020000, f"{name} cannot reach {memory:#x}"
            found[request] = Stream(
                name,
                p[f"{name}.PAR"],
                memory,
                items,
                1 << (control >> 11 & 3),
                bool(control >> 6 & 1),
                bool(control >> 8 & 1),
            )
    return found


@dataclass(frozen=True, slots=True)
class Sampling:
    """The converters in time: both directions at `sample_hz`, `words` samples of a pair before a buffer comes round."""

    sample_hz: float
    words: int
    played_at: int
    sampled_at: int
    channels: tuple[int, int]


def sampling(p: Peripherals) -> Sampling:
    """Reads the wiring of TIM2, DACs, ADCs and their streams; raises AssertionError where it would not work."""
    assert p["TIM2.CR1"] & 1 and p["TIM2.CR2"] >> 4 & 7 == 2, "TIM2 does not run or does not trigger on update"
    for name, bus, bit in (("TIM2", 1, 0), ("DAC", 1, 29), ("ADC1", 2, 8), ("ADC2", 2, 9), ("USART1", 2, 4)):
        assert p[f"RCC.APB{bus}ENR"] >> bit & 1, f"{name} runs without a clock"
    _check_dacs(p)
    channels = _check_adcs(p)
    running = streams(p)
    out, back = running["DAC1"], running["ADC1"]
    assert (out.peripheral, back.peripheral) == (ADDRESS["DAC.DHR12LD"], ADDRESS["ADC.CDR"])
    assert out.to_peripheral and not back.to_peripheral
    assert out.circular and back.circular and out.items == back.items and out.item_size == back.item_size == 4
    assert "DAC2" not in running, "one stream feeds both DACs"
    interrupts = [name for name in ("DMA1_S5", "DMA2_S0") if p[f"{name}.CR"] & (1 << 3 | 1 << 4)]
    assert interrupts == ["DMA2_S0"] and p["DMA2_S0.CR"] >> 3 & 3 == 3, "half and full transfer of the ADCs interrupt"
    assert p["NVIC.ISER1"] == 1 << 56 - 32
    return Sampling(timer_hz(p, "TIM2"), out.items, out.memory, back.memory, channels)


def _check_dacs(p: Peripherals) -> None:
    for channel in (0, 16):
        control = p["DAC.CR"] >> channel
        assert control & 1 and control >> 2 & 1, "a DAC is off or not triggered"
        assert control >> 3 & 7 == _TRIGGER_TIM2_DAC
    assert p["DAC.CR"] >> 12 & 1, "DAC channel 1 does not ask for DMA"
    assert not p["DAC.CR"] >> 28 & 1, "channel 2's requests would go nowhere and count as underruns"
    assert p["GPIOA.MODER"] >> 8 & 0xF == 0xF, "PA4 and PA5 are not analogue"


def _check_adcs(p: Peripherals) -> tuple[int, int]:
    common = p["ADC.CCR"]
    assert common & 0x1F == 6 and common >> 14 & 3 == 2, "not dual simultaneous with pairs by DMA"
    assert common >> 13 & 1, "requests end with the buffer's first round"
    clock_hz = apb_hz(p, 2) / (2 * (common >> 16 & 3) + 2)
    assert clock_hz <= 36e6
    for name in ("ADC1", "ADC2"):
        assert p[f"{name}.CR2"] & 1 and p[f"{name}.CR2"] >> 11 & 1, f"{name} is off or not left-aligned"
        assert p[f"{name}.SQR1"] >> 20 & 0xF == 0 and p[f"{name}.SMPR2"] == 0, "one conversion, 3 cycles of sampling"
    assert p["ADC1.CR2"] >> 24 & 0xF == _TRIGGER_TIM2_ADC and p["ADC1.CR2"] >> 28 & 3 == 1
    assert p["ADC2.CR2"] >> 28 & 3 == 0, "the second converter follows the first"
    assert 15 / clock_hz < 1 / timer_hz(p, "TIM2"), "a conversion outlasts the period"
    channels = p["ADC1.SQR3"] & 0x1F, p["ADC2.SQR3"] & 0x1F
    assert all(p["GPIOA.MODER"] >> 2 * pin & 3 == 3 for pin in channels), "an input is not analogue"
    return channels


def baud(p: Peripherals) -> float:
    return apb_hz(p, 2) / p["USART1.BRR"]


def watchdog_s(p: Peripherals) -> float:
    return (p["IWDG.RLR"] + 1) * (4 << p["IWDG.PR"]) / WATCHDOG_HZ
