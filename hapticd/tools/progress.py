"""Progress of long work: a bar with an estimate of the time left on a terminal, now and then a line elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TextIO

SHOWN_AFTER_S = 1.0  # short work shows nothing
EVERY_S = 0.1
LINE_EVERY_S = 10.0  # into a pipe or a file
WIDTH = 24


class Progress:
    """Context manager whose value is called with the share of the work that is done, 0 .. 1.

    Written to `stream`, standard error: on a terminal a bar that is erased at the end, elsewhere lines.
    """

    def __init__(
        self, what: str, *, stream: TextIO | None = None, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._what = what
        self._stream = sys.stderr if stream is None else stream
        self._clock_s = clock_s
        self._t_start_s = clock_s()
        self._is_bar = self._stream.isatty()
        self._t_next_s = self._t_start_s + (SHOWN_AFTER_S if self._is_bar else LINE_EVERY_S)
        self._is_shown = False

    def __call__(self, done_frac: float) -> None:
        now_s = self._clock_s()
        if now_s < self._t_next_s or done_frac <= 0.0:
            return
        self._t_next_s = now_s + (EVERY_S if self._is_bar else LINE_EVERY_S)
        done_frac = min(done_frac, 1.0)
        text = f"{100 * done_frac:3.0f} %, {_span((now_s - self._t_start_s) * (1.0 / done_frac - 1.0))} left"
        if self._is_bar:
            full = round(WIDTH * done_frac)
            self._write(f"\r\x1b[K{self._what} [{'#' * full}{'.' * (WIDTH - full)}] {text}")
            self._is_shown = True
        else:
            self._write(f"{self._what}: {text.lstrip()}\n")

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._is_shown:
            self._write("\r\x1b[K")

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"
