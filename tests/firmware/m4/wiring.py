"""What the registers mean: rates, routes and addresses, derived from nothing but what the firmware wrote, by the tables
of its chip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from .chip import Registers, Route

WATCHDOG_HZ: Final = 32e3
_CHANNEL_FLAGS: Final = (4, 2)  # half and complete of the first channel; four bits later the next one's
_STREAM_FLAGS: Final = (0x10, 0x20)
_STREAM_SHIFTS: Final = (0, 6, 16, 22)


@dataclass(frozen=True, slots=True)
class Stream:
    """A running DMA stream; `memory_size` and `peripheral_size` of an item in bytes. `half` and `complete` are its bits
    in the register `flags`; `index` from 0."""

    name: str
    unit: int
    index: int
    peripheral: int
    memory: int
    items: int
    memory_size: int
    peripheral_size: int
    to_peripheral: bool
    circular: bool
    interrupts: frozenset[str]  # of "half", "complete", "error"
    flags: str
    half: int
    complete: int

    @property
    def irq(self) -> int:
        """RM0090, 12.2; RM0440, 14.3; RM0433, 19.1.2."""
        return {1: 11, 2: 56}[self.unit] + self.index


@dataclass(frozen=True, slots=True)
class Lane:
    """A mode's samples: addresses of the first of `samples`, and from one to the next, in bytes, played and sampled.
    The sensor is sampled `delay_frac` of a period after the DACs moved. Words played are `played_shift` bits farther
    left."""

    played_at: int
    played_stride: int
    sampled_at: int
    sampled_stride: int
    delay_frac: float
    played_shift: int


@dataclass(frozen=True, slots=True)
class Sampling:
    """The converters in time: both directions at `sample_hz`, `samples` before a buffer comes round. The flags of the
    stream `chunk` get `half` and `complete`, and its interrupt follows. `items` of a stream for each sample."""

    sample_hz: float
    samples: int
    lanes: tuple[Lane, ...]
    channels: tuple[int, ...]
    chunk: Stream
    sampling: tuple[str, ...]  # streams
    playing: tuple[str, ...]
    items: dict[str, int]


class Wiring:
    """As the registers are now; raises AssertionError where it would not work."""

    def __init__(self, p: Registers) -> None:
        self.p = p
        self.chip = p.chip

    def core_hz(self) -> float:
        return self.chip.clocks(self.p).core_hz

    def timer_hz(self, name: str) -> float:
        """Updates per second."""
        return self.chip.clocks(self.p).timer_hz / (self.p[f"{name}.PSC"] + 1) / (self.p[f"{name}.ARR"] + 1)

    def baud(self) -> float:
        return self.chip.clocks(self.p).line_hz / self.p[f"{self.chip.line}.BRR"]

    def deaf(self) -> bool:
        """Whether an overrun keeps the line from receiving. RM0440, 41.7.4: with OVRDIS it loses its byte alone."""
        return bool(self.p.field(self.chip.line_flags, 3, 1)) and not self.p.field(f"{self.chip.line}.CR3", 12, 1)

    def streams(self) -> dict[str, Stream]:
        """All enabled streams, by who asks for their transfers."""
        dma, found = self.chip.dma, {}
        for unit in (1, 2):
            for index in range(dma.count):
                control = self.p[dma.stream.format(unit, dma.first + index) + ".CR"]
                if control & 1:
                    request = self._request(unit, index, control)
                    assert request not in found, f"two streams answer {request}"
                    found[request] = self._stream(unit, index, control)
        return found

    def _request(self, unit: int, index: int, control: int) -> str:
        multiplexer = f"DMAMUX.C{8 * (unit - 1) + index}CR"
        number = self.p.values.get(multiplexer, 100 * unit + 10 * index + (control >> 25 & 7))
        return self.chip.requests[number]

    def _stream(self, unit: int, index: int, control: int) -> Stream:
        dma = self.chip.dma
        name = dma.stream.format(unit, dma.first + index)
        assert control >> dma.increments & 1, f"{name} stays at one address"
        if dma.is_channels:
            assert not control >> 6 & 1, f"{name} walks through the peripherals"
            assert not control >> 14 & 1, f"{name} waits for no request"
            flags, shift, bits = "ISR", 4 * index, _CHANNEL_FLAGS
        else:
            assert self.p[f"{name}.FCR"] == 0, "direct mode"
            flags, shift, bits = "LH"[index // 4] + "ISR", _STREAM_SHIFTS[index % 4], _STREAM_FLAGS
        memory = self.p[f"{name}.M0AR"]
        memory_size = 1 << (control >> dma.memory_size & 3)
        assert memory in self.chip.memory, f"{name} cannot reach {memory:#x}"
        assert memory % memory_size == 0
        enabled = {"half": dma.half, "complete": dma.complete, "error": dma.error}
        return Stream(
            name, unit, index, self.p[f"{name}.PAR"], memory, self.p[f"{name}.NDTR"], memory_size,
            1 << (control >> dma.peripheral_size & 3), bool(control >> dma.to_peripheral & 1),
            bool(control >> dma.circular & 1), frozenset(what for what, bit in enabled.items() if control >> bit & 1),
            f"DMA{unit}.{flags}", bits[0] << shift, bits[1] << shift,
        )  # fmt: skip

    def finish_sending(self) -> None:
        """The line's stream has sent its last byte: RM0090, 10.5.5, EN: it disables itself; RM0440, 12.6.3, EN: a
        channel stays enabled, with nothing left."""
        stream = self.streams()["TX"]
        if self.chip.dma.is_channels:
            self.p[f"{stream.name}.NDTR"] = 0
        else:
            self.p[f"{stream.name}.CR"] &= ~1
        self.p[stream.flags] |= stream.complete

    def trigger_delay_frac(self) -> float:
        """Of TIM2's period, from the rising to the falling edge of its trigger output. The rising one comes first."""
        assert self.p["TIM2.CR1"] & 1, "TIM2 does not run"
        assert self.p.field("TIM2.CR2", 4, 3) == 4, "TIM2's trigger output is not its first channel"
        assert self.p.field("TIM2.CCMR1", 4, 3) == 6, "which is not high while the counter is below CCR1"
        assert self.p["TIM2.CNT"] >= self.p["TIM2.CCR1"], "the ADCs would be triggered first"
        return self.p["TIM2.CCR1"] / (self.p["TIM2.ARR"] + 1)

    def sampling(self) -> Sampling:
        chip, running = self.chip, self.streams()
        assert (wrong := self.p.wrong(chip.expected(chip.modes))) == [], wrong
        routes = chip.sampled(chip.modes), chip.played(chip.modes)
        back, out = (
            [self._checked(route, running[route.request], i) for route in some] for i, some in enumerate(routes)
        )
        samples = back[0].items // routes[0][0].items
        items = {
            stream.name: route.items
            for some, of in zip((back, out), routes, strict=True)
            for stream, route in zip(some, of, strict=True)
        }
        assert {stream.items for stream in back + out} == {samples * each for each in items.values()} | {back[0].items}
        assert all(stream.items == samples * items[stream.name] for stream in back + out)
        chunk = self._check_interrupts(back, out)
        period_s = 1 / self.timer_hz("TIM2")
        moved_s = chip.timing(self)
        channels, at_s = zip(*self._conversions(routes[0]), strict=True)
        assert moved_s == 0.0 or max(at_s) < moved_s < period_s, "all is sampled before the DACs move"
        lanes = [
            Lane(*played, *sampled, (at - moved_s) % period_s / period_s, chip.played_shift)
            for played, sampled, at in zip(
                self._places(routes[1], out), self._places(routes[0], back), at_s, strict=True
            )
        ]
        return Sampling(
            1 / period_s, samples, tuple(lanes), channels, chunk,
            tuple(stream.name for stream in back), tuple(stream.name for stream in out), items,
        )  # fmt: skip

    def _checked(self, route: Route, stream: Stream, is_output: int) -> Stream:
        assert stream.peripheral == self.chip.addresses[route.register]
        assert (stream.to_peripheral, stream.circular) == (bool(is_output), True)
        assert (stream.memory_size, stream.peripheral_size) == route[2:4]
        return stream

    def _places(self, routes: list[Route], streams: list[Stream]) -> list[tuple[int, int]]:
        """Of each mode the first sample's address, and the distance to the next."""
        found = []
        for route, stream in zip(routes, streams, strict=True):
            stride = route.memory_size * route.items
            modes = max(route.modes, route.items)
            found += [(stream.memory + stride // modes * k, stride) for k in range(modes)]
        return found

    def _check_interrupts(self, back: list[Stream], out: list[Stream]) -> Stream:
        """The chunk's interrupt comes with the last word of an instant: of equally urgent streams of one controller the
        highest number (RM0440, 12.4.4; RM0090, 10.3.4)."""
        p, chip = self.p, self.chip
        chunk = max(back, key=lambda stream: stream.index)
        assert len({(stream.unit, p.field(f"{stream.name}.CR", chip.dma.priority, 2)) for stream in back}) == 1
        assert chunk.interrupts == {"half", "complete", "error"}
        others = [stream for stream in back + out if stream is not chunk]
        assert all(stream.interrupts == {"error"} for stream in others)
        assert chunk.flags == chip.chunk_flags
        irqs = {stream.irq for stream in back + out}
        assert self.interrupts() == irqs | {1, chip.interlock_irq}, (
            "the supply, the interlocks, the converters' streams"
        )
        assert p["NVIC.IPR1"] == 0
        assert {p[f"NVIC.IPR{irq}"] for irq in irqs} == {0x10}
        has_tick = chip.has_tick(chip.modes)
        assert p[f"NVIC.IPR{chip.interlock_irq}"] == (0x20 if has_tick else 0x10), "interlocks do not interrupt a tick"
        assert p["SCB.SHPR3"] == (0x20 << 16 if has_tick else 0), "PendSV is below the chunks (PM0214, 4.4.8)"
        return chunk

    def _conversions(self, routes: list[Route]) -> list[tuple[int, float]]:
        """Of each mode its sensor's channel, and when in a period of TIM2 it is sampled, in s."""
        p, chip, found = self.p, self.chip, []
        period_s, clock_hz = 1 / self.timer_hz("TIM2"), chip.clocks(p).adc_hz
        begin_s = self.trigger_delay_frac() * period_s
        register, first, width, length = chip.sequence
        for name in [f"ADC{k + 1}" for k in range(sum(route.modes for route in routes))]:  # one's words hold two ADCs'
            at_s = begin_s
            for rank in range(p.field(f"{name}.SQR1", length, 4) + 1):
                channel = p.field(f"{name}.{register}", first + width * rank, 5)
                port, pin = chip.inputs[name, channel]
                assert p.field(f"{port}.MODER", 2 * pin, 2) == 3, "an input is not analogue"
                code = self._sample_code(name, channel)
                found.append((channel, at_s + (chip.sample_cycles[code] / clock_hz if chip.timing(self) else 0.0)))
                at_s += (chip.sample_cycles[code] + chip.conversion_cycles) / clock_hz
            latest_s = period_s + (begin_s if chip.converts_past_moves else 0.0)
            assert at_s < latest_s, "it would be triggered while it converts, or the DACs move meanwhile"
        return found

    def _sample_code(self, name: str, channel: int) -> int:
        first, second = ("SMPR2", "SMPR1") if f"{name}.SR" in self.p.values else ("SMPR1", "SMPR2")
        return self.p.field(f"{name}.{first if channel < 10 else second}", 3 * (channel % 10), 3)

    def interrupts(self) -> set[int]:
        """All that are enabled, at the chunk's priority or above it."""
        return {32 * i + bit for i in range(4) for bit in range(32) if self.p[f"NVIC.ISER{i}"] >> bit & 1}

    def watchdog_s(self) -> float:
        return (self.p["IWDG.RLR"] + 1) * (4 << self.p["IWDG.PR"]) / WATCHDOG_HZ

    def window_watchdog_s(self) -> float:
        """From being fed to the reset, at most; until then nothing resets the chip that feeds it early. RM0090, 22.6.2;
        RM0440, 36.5.2; RM0433, 44."""
        p = self.p
        assert p.field("WWDG.CFR", 0, 7) == 0x7F, "it must not be fed before its window opens"
        assert p.field("WWDG.CR", 6, 2) == 3, "off, or about to reset"
        divider = 4096 << p.field("WWDG.CFR", *self.chip.window_prescaler)
        return divider * (p.field("WWDG.CR", 0, 6) + 1) / self.chip.clocks(p).window_hz
