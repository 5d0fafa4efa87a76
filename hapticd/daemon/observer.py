"""Observer: receives every input, output and decision of a machine, for recordings."""

from __future__ import annotations

from collections.abc import Callable

Observer = Callable[
    ..., None
]  # (kind, t_ns, *values): what was heard, written or found; `files.recording.records` has all kinds
