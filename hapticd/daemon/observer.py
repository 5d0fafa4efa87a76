"""What a machine and its parts tell of themselves while they work: to a recorder, or to nobody."""

from __future__ import annotations

from collections.abc import Callable

Observer = Callable[
    ..., None
]  # (kind, t_ns, *values): what was heard, written or found; `files.recording.records` has all kinds
