"""`hapticd doctor latency --what-if`: how often both fingers would feel what was asked, by the pad's rate, the age of
its reports and the link's delay. Simulated: strokes of real hands on the wide plate, in an ideal world."""

from __future__ import annotations

import itertools
import os
from dataclasses import replace
from typing import Final, NamedTuple, TextIO

import numpy as np

from ..config.sections import Config, DeviceConfig, TrackpadConfig
from ..daemon.board_gateway import FAST_BAUD
from ..sim import lockstep
from ..sim.fingers.scenarios import REAL
from ..sim.plate.glasses import WIDE
from ..sim.plate.ground_truth import PlateSettings
from ..sim.settings import Settings
from . import campaigns

RATES_HZ: Final = (60.0, 88.9, 120.0, 240.0, 1000.0)
AGES_MS: Final = (3.0, 10.0, 20.0)
LINKS: Final = {5.0: DeviceConfig().baud, 1.5: FAST_BAUD}  # delay of a frame in ms, and the speed of such a line
SEEDS, SECONDS = (1, 2, 3), 6.0


class PadAndLine(NamedTuple):
    """A pad, and the line to the board."""

    report_hz: float
    age_ms: float
    link_ms: float


def settings_of(one: PadAndLine, plate: PlateSettings) -> Settings:
    """Return a world with this pad, line and plate, and a daemon that knows them."""
    config = Config(trackpad=TrackpadConfig(latency_ms=one.age_ms), device=DeviceConfig(baud=LINKS[one.link_ms]))
    return Settings(
        motion=REAL,
        report_period_ms=1e3 / one.report_hz,
        sensor_latency_ms=one.age_ms,
        link_ms=one.link_ms,
        plate=plate,
        config=config,
    )


def felt_frac(one: PadAndLine) -> float:
    """Return the share of time in which both fingers feel what was asked, the mean over SEEDS."""
    settings = settings_of(one, replace(PlateSettings.of(WIDE), sensor_crosstalk=0.0))  # calibrated
    played = [lockstep.run("strokes", settings=settings, seed=seed, seconds=SECONDS) for seed in SEEDS]
    return float(np.mean([run.score.felt_frac for run in played]))


def table() -> dict[PadAndLine, float]:
    """Return the share for each of them; takes some three minutes of processor time."""
    pads = [PadAndLine(*one) for one in itertools.product(RATES_HZ, AGES_MS, LINKS)]
    jobs = len(os.sched_getaffinity(0))
    return dict(zip(pads, campaigns.run("what if", felt_frac, pads, jobs=jobs), strict=True))


def figures(found: dict[PadAndLine, float]) -> list[dict[str, float]]:
    """Return the result as plain data."""
    return [one._asdict() | {"felt_frac": share} for one, share in found.items()]


def print_table(found: dict[PadAndLine, float], out: TextIO) -> None:
    """Print a row for each rate, in per cent."""
    print("% of the time in which two stroking fingers feel what was asked: wide plate, ideal world", file=out)
    columns = [(age_ms, link_ms) for link_ms in LINKS for age_ms in AGES_MS]
    print(f"{'link, ms':<12}" + "".join(f"{link_ms:>7g}" for _, link_ms in columns), file=out)
    print(f"{'reports, ms':<12}" + "".join(f"{age_ms:>7g}" for age_ms, _ in columns), file=out)
    for rate_hz in RATES_HZ:
        shares = [found[PadAndLine(rate_hz, age_ms, link_ms)] for age_ms, link_ms in columns]
        print(f"{f'{rate_hz:g} Hz':<12}" + "".join(f"{100.0 * share:>7.0f}" for share in shares), file=out)
