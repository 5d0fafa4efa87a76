"""Delays from report to plate, which determine how far ahead fingers are predicted.

The sensor's own delay, from the finger's position to the report, shows in no host clock: `trackpad.latency_ms` stays.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...config import loader as config
from ...config.sections import SIMULATED, Config, PredictionConfig
from ...errors import CalibrationError
from ..arguments import POSITIVE
from .folder import CONFIG_FILE
from .step import PICTURE, Figure, Finding, Outcome, Step, Verdict, add_config, judge

if TYPE_CHECKING:
    from ..latency import MeasuredLatency

STEADY_FRAC, USABLE_FRAC = 0.02, 0.25  # share of frames that are late or never applied
PERIOD_WORTH_FRAC = 0.03  # least change of the report period that is worth a setting
LEAST_FRAMES = 50
SPREAD_WORTH_MS = 3.0  # of the link, from the median to the 95th percentile


def check(options: argparse.Namespace) -> None:
    """Check the arguments. Raises HapticdError."""
    if options.config is not None:
        config.load(options.config)


def run(options: argparse.Namespace) -> Verdict:
    """Run the step on the configured devices. Raises HapticdError."""
    configured = _configuration(options)
    is_simulated = SIMULATED in (configured.device.port, configured.trackpad.source)
    if is_simulated and not options.sim:
        raise CalibrationError("The configuration has simulated devices: calibrate the real ones first, or add --sim.")
    from .. import latency  # late, with the daemon: half of the time in which the steps are listed

    measured = latency.measure(configured, options.seconds)
    latency.draw(measured, options.out / "latency.png", "simulated" if options.sim else "", **PICTURE)
    return verdict(measured, configured, is_simulated=options.sim)


def _configuration(options: argparse.Namespace) -> Config:
    """Return the configuration of --config, else that of earlier steps, else the simulated plate."""
    made: Path = options.out / CONFIG_FILE
    if options.config is not None:
        named = config.load(options.config)
        return config.simulated(named) if options.sim else named
    if made.exists():
        return config.load(made)
    if options.sim:
        return Config()
    raise CalibrationError(f"No devices are configured: give --config, or run the earlier steps, which write {made}.")


def verdict(measured: MeasuredLatency, configured: Config, *, is_simulated: bool) -> Verdict:
    """Judge the frames, and derive the pad's period."""
    from ..latency import STAGES

    figures = tuple(
        Figure(f"{what}, {percent} %", measured.stages[name].percentile_ns(percent) * 1e-6, "ms")
        for name, what in STAGES.items()
        for percent in (50, 95, 99)
    )
    counts = measured.counts
    unanswered = counts["frames unanswered"]
    lost_frac = (counts["frames late"] + unanswered) / max(counts["frames"] + unanswered, 1)
    period_ms = report_period_ms(measured)
    figures += (Figure("report period", period_ms, "ms"), Figure("frames late or lost", 100.0 * lost_frac, "%"))
    outcome, sentence = judge(
        _findings(measured, lost_frac),
        f"Fingers are predicted {measured.stages['horizon'].percentile_ns(50) * 1e-6:.1f} ms ahead, "
        f"{measured.stages['link'].percentile_ns(50) * 1e-6:.1f} of them for the link.",
    )
    period = period_setting(period_ms, configured.prediction)
    return Verdict("latency", outcome, sentence, figures, {"prediction": period} if period else {}, is_simulated)


def period_setting(period_ms: float, before: PredictionConfig) -> dict[str, float]:
    """Return the setting of a measured report period that differs from that before."""
    differs = abs(period_ms / before.period_ms - 1.0) > PERIOD_WORTH_FRAC and 2.0 <= period_ms <= 50.0
    return {"period_ms": round(period_ms, 2)} if differs else {}


def report_period_ms(measured: MeasuredLatency) -> float:
    """Return the median time between samples that led to frames; NaN for fewer than two."""
    samples_ns = np.unique([line.t_sample_ns for line in measured.lines])
    return float(np.median(np.diff(samples_ns))) * 1e-6 if len(samples_ns) > 1 else float("nan")


def _findings(measured: MeasuredLatency, lost_frac: float) -> Iterator[Finding]:
    link = measured.stages["link"]
    spread_ms = (link.percentile_ns(95) - link.percentile_ns(50)) * 1e-6
    if lost_frac > USABLE_FRAC:
        yield Outcome.FAIL, f"{100 * lost_frac:.0f} % of the frames are late or lost: check the link."
    elif lost_frac > STEADY_FRAC:
        yield Outcome.WARN, f"{100 * lost_frac:.1f} % of the frames are late or lost: reduce the host's load."
    if len(measured.lines) < LEAST_FRAMES:
        yield Outcome.WARN, f"Only {len(measured.lines)} frames: move two fingers, for longer."
    if spread_ms > SPREAD_WORTH_MS:
        yield Outcome.WARN, f"The link's delay varies by {spread_ms:.1f} ms: check [realtime] and the cable."


def _add_seconds(parser: argparse.ArgumentParser) -> None:
    what = "duration (default 10); move two fingers meanwhile"
    parser.add_argument("--seconds", type=POSITIVE, default=10.0, help=what)


STEP = Step(
    name="latency",
    order=10,
    summary="measure the delays that the prediction must cover (stop the service first)",
    example="--out DIR --seconds 20",
    arguments=(add_config, _add_seconds),
    check=check,
    run=run,
)
