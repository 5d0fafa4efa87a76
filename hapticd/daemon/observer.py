"""Observer: receives every input, output and decision of a machine, for recordings."""

from __future__ import annotations

from collections.abc import Callable

# (kind, t_ns, *values) of each input, output and decision; `files.recording.kinds` has all kinds
Observer = Callable[..., None]


class Observed:
    """Receiver of the records of a machine, its board and its clients; an observer may come and go at any time."""

    def __init__(self) -> None:
        self.observer: Observer | None = None

    def put(self, kind: str, t_ns: int, *values: object) -> None:
        """Pass a record on, if anything observes."""
        if self.observer is not None:
            self.observer(kind, t_ns, *values)
