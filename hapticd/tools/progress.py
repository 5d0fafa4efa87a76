"""Progress of long work on a terminal: one line with a bar and an estimate of the time left."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TextIO

SHOWN_AFTER_S = 1.0  # short work shows nothing
EVERY_S = 0.1
WIDTH = 24


class Progress:
    """Context manager whose value is called with the share of the work that is done, 0 .. 1; erased at the end.

    Nothing is written where `stream`, standard error, is not a terminal.
    """

    def __init__(
        self, what: str, *, stream: TextIO | None = None, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._what = what
        self._stream = sys.stderr if stream is None else stream
        self._clock_s = clock_s
        self._t_start_s = clock_s()
        self._t_next_s = self._t_start_s + SHOWN_AFTER_S if self._stream.isatty() else float("inf")
        self._is_shown = False

    def __call__(self, done_frac: float) -> None:
        now_s = self._clock_s()
        if now_s < self._t_next_s or done_frac <= 0.0:
            return
        self._t_next_s = now_s + EVERY_S
        left_s = (now_s - self._t_start_s) * (1.0 / min(done_frac, 1.0) - 1.0)
        full = round(WIDTH * min(done_frac, 1.0))
        bar = "#" * full + "." * (WIDTH - full)
        self._write(f"{self._what} [{bar}] {100 * min(done_frac, 1.0):3.0f} %, {_span(left_s)} left")

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._is_shown:
            self._write("")

    def _write(self, text: str) -> None:
        self._stream.write(f"\r\x1b[K{text}")
        self._stream.flush()
        self._is_shown = True


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"
