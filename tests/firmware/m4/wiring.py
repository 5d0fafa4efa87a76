"""What the registers mean: rates, routes and addresses, derived from nothing but what the firmware wrote.

`Wiring` is what the chips share; `stm32f405`, `stm32g474` and `stm32h743` add their manuals' channels, triggers and
dividers.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Final

from .peripherals import Peripherals

INTERNAL_HZ: Final = 16e6
WATCHDOG_HZ: Final = 32e3


@dataclass(frozen=True, slots=True)
class Stream:
    """A running DMA stream; `memory_size` and `peripheral_size` of an item in bytes."""

    name: str
    peripheral: int
    memory: int
    items: int
    memory_size: int
    peripheral_size: int
    to_peripheral: bool
    circular: bool
    interrupts: frozenset[str]  # of "half", "complete", "error"


def stream_of(name: str, control: int, peripheral: int, memory: int, items: int) -> Stream:
    """A stream of the DMA that the F4 and the H7 have, by its control register."""
    assert control >> 10 & 1, f"{name} stays at one address"
    enabled = {"error": 2, "half": 3, "complete": 4}
    return Stream(
        name,
        peripheral,
        memory,
        items,
        1 << (control >> 13 & 3),
        1 << (control >> 11 & 3),
        bool(control >> 6 & 1),
        bool(control >> 8 & 1),
        frozenset(what for what, bit in enabled.items() if control >> bit & 1),
    )


@dataclass(frozen=True, slots=True)
class Lane:
    """A mode's samples: addresses of the first of `samples`, and from one to the next, in bytes; to its sensor's next
    it may be another way. `delay_frac`: if not that of all. A word played is `played_shift` bits farther left."""

    played_at: int
    sampled_at: int
    stride: int
    sampled_stride: int | None = None
    delay_frac: float | None = None
    played_shift: int = 0


@dataclass(frozen=True, slots=True)
class Sampling:
    """The converters in time: both directions at `sample_hz`, `samples` before a buffer comes round. The ADCs sample
    `delay_frac` of a period after the DACs moved. `flags` get `half` and `complete`, and `irq` follows."""

    sample_hz: float
    samples: int
    delay_frac: float
    lanes: tuple[Lane, ...]
    channels: tuple[int, ...]
    irq: int
    flags: str
    half: int
    complete: int
    sampling: tuple[str, ...]  # streams
    playing: tuple[str, ...]
    items: dict[str, int] = field(default_factory=dict)  # of a stream's for each sample, if not 1


class Wiring(ABC):
    """Of one chip, as its registers are now; raises AssertionError where it would not work."""

    CRYSTAL_HZ: float

    def __init__(self, p: Peripherals) -> None:
        self.p = p

    @abstractmethod
    def core_hz(self) -> float: ...

    @abstractmethod
    def timer_clock_hz(self) -> float: ...

    @abstractmethod
    def streams(self) -> dict[str, Stream]:
        """All enabled streams, by who asks for their transfers."""

    @abstractmethod
    def baud(self) -> float: ...

    @abstractmethod
    def deaf(self) -> bool:
        """Whether an overrun keeps the line from receiving."""

    @abstractmethod
    def sampling(self) -> Sampling: ...

    @abstractmethod
    def finish_sending(self) -> None:
        """The line's stream has sent its last byte."""

    def timer_hz(self, name: str) -> float:
        """Updates per second."""
        return self.timer_clock_hz() / (self.p[f"{name}.PSC"] + 1) / (self.p[f"{name}.ARR"] + 1)

    def trigger_delay_frac(self) -> float:
        """Of TIM2's period, from the rising to the falling edge of its trigger output. The rising one comes first."""
        assert self.p["TIM2.CR1"] & 1, "TIM2 does not run"
        assert self.p.field("TIM2.CR2", 4, 3) == 4, "TIM2's trigger output is not its first channel"
        assert self.p.field("TIM2.CCMR1", 4, 3) == 6, "which is not high while the counter is below CCR1"
        assert self.p["TIM2.CNT"] >= self.p["TIM2.CCR1"], "the ADCs would be triggered first"
        return self.p["TIM2.CCR1"] / (self.p["TIM2.ARR"] + 1)

    def interrupts(self) -> set[int]:
        """All that are enabled, at the chunk's priority or above it."""
        return {32 * i + bit for i in range(4) for bit in range(32) if self.p[f"NVIC.ISER{i}"] >> bit & 1}

    def watchdog_s(self) -> float:
        return (self.p["IWDG.RLR"] + 1) * (4 << self.p["IWDG.PR"]) / WATCHDOG_HZ

    @abstractmethod
    def window_watchdog_s(self) -> float:
        """From being fed to the reset, at most; until then nothing resets the chip that feeds it early."""

    def _window_watchdog_s(self, bus_hz: float, prescaler: int) -> float:
        p = self.p
        assert p.field("WWDG.CFR", 0, 7) == 0x7F, "it must not be fed before its window opens"
        assert p.field("WWDG.CR", 6, 2) == 3, "off, or about to reset"
        return 4096 * (1 << prescaler) * (p.field("WWDG.CR", 0, 6) + 1) / bus_hz
