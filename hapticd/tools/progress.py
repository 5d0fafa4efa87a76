"""Progress of long work on standard error: a bar with the time left on a terminal, now and then a line elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from ..values import OnProgress

BAR = "{desc} [{bar:24}] {percentage:3.0f} %, {remaining} left"
LINE = "{desc}: {percentage:.0f} %, {remaining} left\n"


@contextmanager
def progress_bar(what: str) -> Iterator[OnProgress]:
    """Give what is called with the share of the work that is done, 0 .. 1; short work shows nothing."""
    from tqdm import tqdm

    form, every_s, after_s = (BAR, 0.1, 1.0) if sys.stderr.isatty() else (LINE, 10.0, 10.0)
    tqdm.monitor_interval = 0  # no thread of its own
    how = {"bar_format": form, "mininterval": every_s, "delay": after_s, "miniters": 0, "leave": False, "ascii": ".#"}
    with tqdm(desc=what, total=1.0, **how) as bar:
        yield lambda done_frac: bar.update(min(done_frac, 1.0) - bar.n)
