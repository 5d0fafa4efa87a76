"""What is done every so often, as often as somebody looks; time is an argument."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class PeriodicTimer:
    """Something done every so often."""

    every_ns: int
    t_last_ns: int = 0

    def restart(self, t_now_ns: int) -> None:
        """It was just done."""
        self.t_last_ns = t_now_ns

    def due(self, t_now_ns: int) -> bool:
        """Whether it is time; then the interval starts anew."""
        if t_now_ns - self.t_last_ns < self.every_ns:
            return False
        self.t_last_ns = t_now_ns
        return True
