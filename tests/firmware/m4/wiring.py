"""What the registers mean: rates, routes and addresses, derived from nothing but what the firmware wrote.

Channels, triggers and dividers are RM0090's: its DMA request tables 42 and 43, the trigger tables of its DAC and ADC
chapters, its clock tree.
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
_CONVERSION_CYCLES: Final = 3 + 12
_CLOCKED: Final = (("APB1", 0), ("APB1", 29), ("APB2", 4), ("APB2", 8), ("APB2", 9))  # TIM2, DAC, USART1, ADC1, ADC2


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
    assert all(p[f"RCC.{bus}ENR"] >> bit & 1 for bus, bit in _CLOCKED), "a peripheral runs without a clock"
    assert p["TIM2.CR1"] & 1, "TIM2 does not run"
    assert _field(p, "TIM2.CR2", 4, 3) == 2, "TIM2 does not trigger on update"
    _check_dacs(p)
    channels = _check_adcs(p)
    running = streams(p)
    out, back = running["DAC1"], running["ADC1"]
    assert "DAC2" not in running, "one stream feeds both DACs"
    assert (out.peripheral, back.peripheral) == (ADDRESS["DAC.DHR12LD"], ADDRESS["ADC.CDR"])
    assert (out.to_peripheral, back.to_peripheral) == (True, False)
    assert (out.circular, out.item_size, out.items) == (True, 4, back.items)
    assert (back.circular, back.item_size) == (True, 4)
    _check_interrupt(p)
    return Sampling(timer_hz(p, "TIM2"), out.items, out.memory, back.memory, channels)


def _field(p: Peripherals, name: str, at: int, width: int) -> int:
    return p[name] >> at & ((1 << width) - 1)


def _check_dacs(p: Peripherals) -> None:
    for channel in (0, 16):
        assert _field(p, "DAC.CR", channel, 1), "a DAC is off"
        assert _field(p, "DAC.CR", channel + 2, 1), "a DAC is not triggered"
        assert _field(p, "DAC.CR", channel + 3, 3) == _TRIGGER_TIM2_DAC
    assert _field(p, "DAC.CR", 12, 1), "DAC channel 1 does not ask for DMA"
    assert not _field(p, "DAC.CR", 28, 1), "channel 2's requests would go nowhere and count as underruns"
    assert _field(p, "GPIOA.MODER", 8, 4) == 0xF, "PA4 and PA5 are not analogue"


def _check_adcs(p: Peripherals) -> tuple[int, int]:
    assert _field(p, "ADC.CCR", 0, 5) == 6, "not dual simultaneous"
    assert _field(p, "ADC.CCR", 14, 2) == 2, "not pairs by DMA"
    assert _field(p, "ADC.CCR", 13, 1), "requests end with the buffer's first round"
    for name in ("ADC1", "ADC2"):
        assert _field(p, f"{name}.CR2", 0, 1), f"{name} is off"
        assert _field(p, f"{name}.CR2", 11, 1), f"{name} is not left-aligned"
        assert _field(p, f"{name}.SQR1", 20, 4) == 0, f"{name} converts more than one channel"
        assert p[f"{name}.SMPR2"] == 0, f"{name} samples for more than 3 cycles"
    assert _field(p, "ADC1.CR2", 24, 4) == _TRIGGER_TIM2_ADC
    assert (_field(p, "ADC1.CR2", 28, 2), _field(p, "ADC2.CR2", 28, 2)) == (1, 0), "the second follows the first"
    clock_hz = apb_hz(p, 2) / (2 * _field(p, "ADC.CCR", 16, 2) + 2)
    assert clock_hz <= 36e6
    assert _CONVERSION_CYCLES / clock_hz < 1 / timer_hz(p, "TIM2"), "a conversion outlasts the period"
    channels = p["ADC1.SQR3"] & 0x1F, p["ADC2.SQR3"] & 0x1F
    assert all(_field(p, "GPIOA.MODER", 2 * pin, 2) == 3 for pin in channels), "an input is not analogue"
    return channels


def _check_interrupt(p: Peripherals) -> None:
    enabled = {name: _field(p, f"{name}.CR", 3, 2) for name in ("DMA1_S5", "DMA2_S0")}
    assert enabled == {"DMA1_S5": 0, "DMA2_S0": 3}, "half and full transfer of the ADCs interrupt, and nothing else"
    assert p["NVIC.ISER1"] == 1 << (56 - 32)


def baud(p: Peripherals) -> float:
    return apb_hz(p, 2) / p["USART1.BRR"]


def watchdog_s(p: Peripherals) -> float:
    return (p["IWDG.RLR"] + 1) * (4 << p["IWDG.PR"]) / WATCHDOG_HZ
