"""Observer: receives every input, output and decision of a machine, for recordings."""

from __future__ import annotations

from collections.abc import Callable

# (kind, t_ns, *values) of each input, output and decision; `files.recording.kinds` has all kinds
Observer = Callable[..., None]
