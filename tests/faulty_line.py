"""A faulty serial line in virtual time: lost, truncated, corrupted, duplicated, reordered or delayed writes.

A fault applies to one write, usually a whole frame. The same seed and writes give the same faults. Not modelled: baud
rate, framing errors and full buffers.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

_SHARES = ("lost", "truncated", "corrupted", "duplicated", "reordered", "delayed")


@dataclass(frozen=True, slots=True)
class LineFaults:
    """Shares (0..1) of the writes, drawn independently, that have each fault between `from_ns` and `until_ns`.

    Corrupted: one to three bits flip. Truncated: the end with its delimiter is missing. Reordered: the write arrives
    after the next one. Delayed: it and all later ones arrive up to `delay_ns` later.
    """

    lost: float = 0.0
    truncated: float = 0.0
    corrupted: float = 0.0
    duplicated: float = 0.0
    reordered: float = 0.0
    delayed: float = 0.0
    delay_ns: int = 0
    from_ns: int = 0
    until_ns: int | None = None


class Line:
    """One direction of a line. `counters` has the number of writes with each fault."""

    def __init__(self, faults: LineFaults, seed: int) -> None:
        self.counters = Counter(dict.fromkeys(_SHARES, 0))
        self._faults = faults
        self._rng = np.random.default_rng(seed)
        self._held: bytes | None = None
        self._t_last_ns = 0

    def __call__(self, t_ns: int, data: bytes) -> list[tuple[int, bytes]]:
        """Return the arrivals (time, bytes) of a write due at `t_ns`; calls must be in order of time."""
        faults, until_ns = self._faults, self._faults.until_ns
        faulty = dict.fromkeys(_SHARES, False)
        if faults.from_ns <= t_ns and (until_ns is None or t_ns < until_ns):
            drawn = self._rng.random(len(_SHARES))
            faulty = {name: bool(drawn[i] < getattr(faults, name)) for i, name in enumerate(_SHARES)}
        for name in _SHARES:
            self.counters[name] += faulty[name]
        if faulty["delayed"]:
            t_ns += int(self._rng.integers(0, faults.delay_ns, endpoint=True))
        t_ns = self._t_last_ns = max(t_ns, self._t_last_ns)  # a line keeps its order
        out = [] if faulty["lost"] else [self._damaged(data, faulty)] * (1 + faulty["duplicated"])
        if faulty["reordered"] and self._held is None:
            self._held = b"".join(out)
            return []
        if self._held is not None:
            out.append(self._held)
            self._held = None
        return [(t_ns, piece) for piece in out if piece]

    def _damaged(self, data: bytes, faulty: dict[str, bool]) -> bytes:
        damaged = bytearray(data)
        if faulty["truncated"]:
            del damaged[int(self._rng.integers(0, len(damaged))) :]
        if faulty["corrupted"] and damaged:
            for bit in self._rng.integers(0, 8 * len(damaged), self._rng.integers(1, 4)).tolist():
                damaged[bit // 8] ^= 1 << bit % 8
        return bytes(damaged)
