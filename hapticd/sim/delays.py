"""What shorter delays gain: the leak of simulated strokes with each delay on the way of a touch shortened, in turn.

The delay of a link of two modes at 3 Mbaud is that of a frame of 24 knots (`firmware/README.md`); a pad that reports
every 8 ms is one of 125 Hz. The daemon's own time is in the horizon already, so it is predicted too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from .fingers.scenarios import REAL
from .lockstep import run
from .settings import Settings

USUAL = "link 5 ms, reports 11.25 ms"
SHORTER: Mapping[str, tuple[float, float]] = {  # the link's delay and the period of reports, in ms
    USUAL: (5.0, 11.25),
    "the fast line: link 1.5 ms": (1.5, 11.25),
    "reports every 8 ms": (5.0, 8.0),
    "both": (1.5, 8.0),
}
SEEDS, SECONDS = range(1, 6), 6.0


@dataclass(frozen=True, slots=True)
class Delayed:
    """With one set of delays: the median from sample to plate, and the RMS leak of all seeds."""

    horizon_ms: float
    leak_um: float


def measure(
    *,
    seeds: Sequence[int] = SEEDS,
    seconds: float = SECONDS,
    motion: str = REAL,
    progress: Callable[[float], None] = lambda _: None,
) -> dict[str, Delayed]:
    """Return the gain of each of SHORTER, on the two-mode plate."""
    found, done = dict[str, Delayed](), 0
    for name, (link_ms, period_ms) in SHORTER.items():
        horizons_ms, leaks_um = [], []
        settings = Settings(motion=motion, link_ms=link_ms, report_period_ms=period_ms)
        for seed in seeds:
            played = run("strokes", settings=settings, seed=seed, seconds=seconds)
            horizons_ms.append(float(played.status["latency_ms"]["horizon"]["p50"]))
            leaks_um.append(played.score.leak_um)
            done += 1
            progress(done / (len(SHORTER) * len(seeds)))
        mean_square = sum(leak_um * leak_um for leak_um in leaks_um) / len(leaks_um)
        found[name] = Delayed(sorted(horizons_ms)[len(horizons_ms) // 2], math.sqrt(mean_square))
    return found
