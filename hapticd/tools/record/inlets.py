"""Streams of the Lab Streaming Layer in a live recording: each sample on the daemon's clock, texts as markers.

LSL's own synchronisation brings stamps of another machine to this one's LSL clock, which is the host's monotonic clock,
as the daemon's is. pylsl is passed in, so that tests need no liblsl.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final, Self

from ...errors import UsageError, missing_library
from ...files.recording.kinds import MAX_WHOLE, Fields, Record

FOUND_WITHIN_S: Final = 5.0
KEPT_S: Final = 60  # that LSL keeps of a stream while this process is stopped
MOST_CHANNELS: Final = 512
MOST_VALUES: Final = 4096  # of one record
MOST_CHARACTERS: Final = 1000  # of one text


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
        self._is_text = info.channel_format() == lsl.cf_string
        named = zip(_texts(info.get_channel_labels(), count), _texts(info.get_channel_units(), count), strict=True)
        self._description: Fields | None = {  # until it is recorded
            "stream": name,
            "about": str(info.type()),
            "rate_hz": float(info.nominal_srate()),
            "channels": [{"name": label, "unit": unit} for label, unit in named],
        }
        self._at_once = max(MOST_VALUES // max(count, 1), 1)

    def drop(self) -> None:
        """Drop what came before the recording began."""
        for _ in self._pulled():
            pass
        self.samples = self.left_out = 0

    def records(self, seq: int) -> Iterator[Record]:
        """Yield what came since the last call, texts as markers. The number of all is that of the daemon's record
        before them: no number is missing with them or without."""
        for samples in self._pulled():
            if self._is_text:
                for sample in samples:
                    yield Record(
                        "marker", seq, sample["t_ns"], {"client": self.name, "text": " ".join(sample["values"])}
                    )
                continue
            if self._description is not None:
                yield Record("stream", seq, samples[0]["t_ns"], self._description)
                self._description = None
            yield Record("samples", seq, samples[-1]["t_ns"], {"stream": self.name, "samples": samples})

    def close(self) -> None:
        """Disconnect."""
        self._inlet.close_stream()

    def _pulled(self) -> Iterator[list[Fields]]:
        while True:
            rows, stamps_s = self._inlet.pull_chunk(timeout=0.0, max_samples=self._at_once)
            if not stamps_s:
                return
            samples = [sample for one in zip(rows, stamps_s, strict=True) if (sample := self._sample(*one))]
            self.samples += len(samples)
            self.left_out += len(rows) - len(samples)
            if samples:
                yield samples

    def _sample(self, row: Sequence[Any], stamp_s: float) -> Fields | None:
        t_s = stamp_s + self._offset_s
        values: list[Any] = [str(text)[:MOST_CHARACTERS] for text in row] if self._is_text else list(map(float, row))
        is_sound = 0.0 <= t_s < MAX_WHOLE * 1e-9 and (self._is_text or all(map(math.isfinite, values)))
        return {"t_ns": round(t_s * 1e9), "values": values} if is_sound else None


class Inlets(list[Inlet]):
    """All streams of one recording."""

    @classmethod
    @contextmanager
    def opened(cls, names: Sequence[str], lsl: Any = None) -> Iterator[Self]:
        """Connect to the streams of these names. Raises UsageError, or HapticdError without pylsl."""
        made = cls()
        try:
            for name in dict.fromkeys(names):
                made.append(Inlet(lsl or pylsl(), name))
            yield made
        finally:
            for inlet in made:
                inlet.close()

    def summary(self) -> str:
        """Return what came, for a person; empty for no stream."""
        return "".join(
            f"; {inlet.name}: {inlet.samples} samples" + (f", {inlet.left_out} left out" if inlet.left_out else "")
            for inlet in self
        )


def pylsl() -> Any:
    """Return the library. Raises HapticdError without it, or without liblsl."""
    try:
        import pylsl
    except (ImportError, RuntimeError, OSError) as error:  # the latter two if pylsl finds no liblsl
        reason = str(error).partition("\n")[0]
        raise missing_library(f"The Lab Streaming Layer cannot be loaded ({reason})", "lsl") from None
    return pylsl


def _texts(given: Sequence[str | None] | None, count: int) -> list[str]:
    """Return a text for each channel, empty where the stream's description has none."""
    texts = [str(one or "")[:MOST_CHARACTERS] for one in given or ()]
    return (texts + [""] * count)[:count]
