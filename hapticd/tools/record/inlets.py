"""Streams of the Lab Streaming Layer in a live recording: each sample on the daemon's clock, texts as markers.

LSL's own synchronisation brings stamps of another machine to this one's LSL clock, which is the host's monotonic clock,
as the daemon's is. pylsl is passed in, so that tests need no liblsl.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final, NamedTuple, Self

from ...errors import UsageError, missing_library
from ...files.recording.kinds import MAX_WHOLE, Fields, Record

FOUND_WITHIN_S: Final = 5.0
KEPT_S: Final = 60  # that LSL keeps of a stream while this process is stopped
MOST_CHANNELS: Final = 512
MOST_VALUES: Final = 4096  # of one record
MOST_CHARACTERS: Final = 1000  # of one text


class InletSample(NamedTuple):
    """One sample: its instant on the daemon's clock, and its values."""

    t_ns: int
    values: tuple[Any, ...]


class Inlet:
    """One stream, from its constructor to `close`. `left_out` counts samples with a value or an instant that is none.

    Raises UsageError where there is no stream of that name.
    """

    def __init__(self, lsl: Any, name: str) -> None:
        found = lsl.resolve_byprop("name", name, minimum=1, timeout=FOUND_WITHIN_S)
        if not found:
            raise UsageError(f"--lsl {name}: no such stream came within {FOUND_WITHIN_S:g} s: start its outlet first.")
        count = int(found[0].channel_count())
        if count > MOST_CHANNELS:
            raise UsageError(f"--lsl {name}: has {count} channels, at most {MOST_CHANNELS} are taken.")
        self.name = name
        self.left_out = self.samples = 0
        self._inlet = lsl.StreamInlet(found[0], max_buflen=KEPT_S, processing_flags=lsl.proc_clocksync)
        self._offset_s = time.monotonic() - lsl.local_clock()
        try:
            info = self._inlet.info(FOUND_WITHIN_S)
            self._inlet.open_stream(FOUND_WITHIN_S)
        except (RuntimeError, TimeoutError):
            raise UsageError(f"--lsl {name}: the stream's outlet does not answer: start it again.") from None
        self.is_text = info.channel_format() == lsl.cf_string
        self.rate_hz = float(info.nominal_srate())
        self.about = str(info.type())
        names, units = _named(info.get_channel_labels(), count), _named(info.get_channel_units(), count)
        self.channels = list(zip(names, units, strict=True))
        self._at_once = max(MOST_VALUES // max(count, 1), 1)

    def pull(self) -> Iterator[list[InletSample]]:
        """Yield what came since the last call, in parts."""
        while True:
            rows, stamps_s = self._inlet.pull_chunk(timeout=0.0, max_samples=self._at_once)
            if not stamps_s:
                return
            samples = [self._sample(*one) for one in zip(rows, stamps_s, strict=True)]
            sound = [one for one in samples if one is not None]
            self.samples += len(sound)
            self.left_out += len(samples) - len(sound)
            if sound:
                yield sound

    def close(self) -> None:
        """Disconnect."""
        self._inlet.close_stream()

    def _sample(self, row: Sequence[Any], stamp_s: float) -> InletSample | None:
        t_s = stamp_s + self._offset_s
        if not 0.0 <= t_s < MAX_WHOLE * 1e-9:
            return None
        if self.is_text:
            return InletSample(round(t_s * 1e9), tuple(str(text)[:MOST_CHARACTERS] for text in row))
        values = tuple(map(float, row))
        return InletSample(round(t_s * 1e9), values) if all(map(math.isfinite, values)) else None


class Inlets:
    """All streams of one recording."""

    def __init__(self, inlets: Sequence[Inlet]) -> None:
        self._inlets = inlets
        self._described: set[str] = set()

    @classmethod
    @contextmanager
    def opened(cls, names: Sequence[str], lsl: Any = None) -> Iterator[Self]:
        """Connect to the streams of these names. Raises UsageError, or HapticdError without pylsl."""
        made: list[Inlet] = []
        try:
            if names:
                lsl = pylsl() if lsl is None else lsl
                made += [Inlet(lsl, name) for name in dict.fromkeys(names)]
            yield cls(made)
        finally:
            for inlet in made:
                inlet.close()

    def drop(self) -> None:
        """Drop what came before the recording began."""
        for inlet in self._inlets:
            for _ in inlet.pull():
                pass
            inlet.samples = inlet.left_out = 0

    def note(self, record: Record) -> None:
        """Take no notice of the daemon's records."""

    def records(self, seq: int) -> Iterator[Record]:
        """The samples that came since. Their number is that of the record before them, as a truth's."""
        for inlet in self._inlets:
            for samples in inlet.pull():
                if inlet.is_text:
                    yield from (_marker(inlet, sample, seq) for sample in samples)
                    continue
                if inlet.name not in self._described:
                    self._described.add(inlet.name)
                    yield Record("stream", seq, samples[0].t_ns, _description(inlet))
                rows = [{"t_ns": sample.t_ns, "values": list(sample.values)} for sample in samples]
                yield Record("samples", seq, samples[-1].t_ns, {"stream": inlet.name, "samples": rows})

    def summary(self) -> str:
        """Return what came, for a person; empty for no stream."""
        return "".join(
            f"; {inlet.name}: {inlet.samples} samples" + (f", {inlet.left_out} left out" if inlet.left_out else "")
            for inlet in self._inlets
        )


def pylsl() -> Any:
    """Return the library. Raises HapticdError without it, or without liblsl."""
    try:
        import pylsl
    except (ImportError, RuntimeError, OSError) as error:  # the latter two if pylsl finds no liblsl
        reason = str(error).partition("\n")[0]
        raise missing_library(f"The Lab Streaming Layer cannot be loaded ({reason})", "lsl") from None
    return pylsl


def _description(inlet: Inlet) -> Fields:
    channels = [{"name": name, "unit": unit} for name, unit in inlet.channels]
    return {"stream": inlet.name, "about": inlet.about, "rate_hz": inlet.rate_hz, "channels": channels}


def _marker(inlet: Inlet, sample: InletSample, seq: int) -> Record:
    return Record("marker", seq, sample.t_ns, {"client": inlet.name, "text": " ".join(sample.values)})


def _named(given: Sequence[str | None] | None, count: int) -> list[str]:
    """Return a text for each channel, empty where the stream's description has none."""
    texts = [str(one or "")[:MOST_CHARACTERS] for one in given or ()]
    return (texts + [""] * count)[:count]
