"""Periodic timer, polled by its caller."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class PolledTimer:
    """Due once every `every_ns`. Instants are arguments."""

    every_ns: int
    t_last_ns: int = 0

    def restart(self, t_now_ns: int) -> None:
        """Count the period from now."""
        self.t_last_ns = t_now_ns

    def due(self, t_now_ns: int) -> bool:
        """Return whether the period has passed; then the next one starts."""
        if t_now_ns - self.t_last_ns < self.every_ns:
            return False
        self.t_last_ns = t_now_ns
        return True
