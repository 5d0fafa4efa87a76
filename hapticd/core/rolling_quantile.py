"""Rolling quantile: a robust estimate from delays that are sometimes long."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque


class RollingQuantile:
    """The `share` quantile (lower) of the last `size` values."""

    def __init__(self, size: int, share: float) -> None:
        self._size = size
        self._share = share
        self._arrived: deque[int] = deque()
        self._sorted: list[int] = []

    def __len__(self) -> int:
        return len(self._arrived)

    def push(self, value: int) -> None:
        """Add a value; beyond `size` the oldest is dropped."""
        if len(self._arrived) == self._size:
            self.drop_oldest()
        self._arrived.append(value)
        insort(self._sorted, value)

    def drop_oldest(self) -> None:
        """Drop the oldest value."""
        del self._sorted[bisect_left(self._sorted, self._arrived.popleft())]

    def clear(self) -> None:
        """Drop all values."""
        self._arrived.clear()
        self._sorted.clear()

    @property
    def value(self) -> int:
        """The quantile; IndexError while there is no value."""
        return self.at(self._share)

    def at(self, share: float) -> int:
        """Another quantile (lower) of the same values; IndexError while there is no value."""
        return self._sorted[int(share * (len(self._sorted) - 1))]
