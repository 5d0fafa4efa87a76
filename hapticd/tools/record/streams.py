"""Streams of other devices in a recording, as `replay` lists them: name, rate, samples, and each channel's range."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from ...files.recording.kinds import Fields, Record

MOST_LISTED = 20  # streams, and channels of one


@dataclass(slots=True)
class _Stream:
    """What is known of a stream: `rate_hz` is what it declares, 0 where it is irregular; instants in ns."""

    rate_hz: float = 0.0
    labels: list[tuple[str, str]] = field(default_factory=list)
    samples: int = 0
    first_ns: int = 0
    last_ns: int = 0
    ranges: list[tuple[float, float]] = field(default_factory=list)

    def add(self, t_ns: int, values: list[float]) -> None:
        """Take a sample, which may come in any order."""
        self.first_ns = t_ns if self.samples == 0 else min(self.first_ns, t_ns)
        self.last_ns = t_ns if self.samples == 0 else max(self.last_ns, t_ns)
        self.samples += 1
        self.ranges += [(math.inf, -math.inf)] * (len(values) - len(self.ranges))
        for channel, value in enumerate(values):
            least, most = self.ranges[channel]
            self.ranges[channel] = min(least, value), max(most, value)

    @property
    def measured_hz(self) -> float:
        """Mean rate of the samples, 0 for fewer than two."""
        span_ns = self.last_ns - self.first_ns
        return (self.samples - 1) * 1e9 / span_ns if span_ns else 0.0


class StreamList:
    """The streams in the records that were read."""

    def __init__(self) -> None:
        self._streams: dict[str, _Stream] = {}

    def watched(self, records: Iterable[Record]) -> Iterator[Record]:
        """Yield the records, and take note of what they measured."""
        for record in records:
            if record.kind in ("stream", "samples"):
                self._take(record.kind, record.fields)
            yield record

    def _take(self, kind: str, fields: Fields) -> None:
        stream = self._streams.setdefault(fields["stream"], _Stream())
        if kind == "stream":
            stream.rate_hz = fields["rate_hz"]
            stream.labels = [(channel["name"], channel["unit"]) for channel in fields["channels"]]
            return
        for sample in fields["samples"]:
            stream.add(sample["t_ns"], sample["values"])

    def lines(self, t_start_ns: int) -> Iterator[str]:
        """Yield the list for a person; times count from the recording's start."""
        for name, stream in list(self._streams.items())[:MOST_LISTED]:
            if not stream.samples:
                yield f"stream {name}: no samples"
                continue
            declared = f", {stream.rate_hz:g} Hz declared" if stream.rate_hz else ""
            first_s, last_s = (round((t_ns - t_start_ns) * 1e-9, 3) + 0.0 for t_ns in (stream.first_ns, stream.last_ns))
            rate = f", {stream.measured_hz:.4g} Hz{declared}"
            yield f"stream {name}: {stream.samples} samples from {first_s:.3f} to {last_s:.3f} s{rate}"
            for channel, (least, most) in enumerate(stream.ranges[:MOST_LISTED]):
                label, unit = stream.labels[channel] if channel < len(stream.labels) else ("", "")
                yield f"  {label or f'channel {channel + 1}'}: {least:.4g} .. {most:.4g} {unit}".rstrip()
            if len(stream.ranges) > MOST_LISTED:
                yield f"  and {len(stream.ranges) - MOST_LISTED} channels more"
        if len(self._streams) > MOST_LISTED:
            yield f"and {len(self._streams) - MOST_LISTED} streams more"
