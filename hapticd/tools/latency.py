"""`hapticd doctor latency`: serve the devices as `hapticd run` does, and measure each delay from report to plate.

It prints percentiles and draws the distributions; `hapticd export` has each frame of a recording. The first finger gets
a target of AMPLITUDE_UM, all others one of zero, so that each report leads to a frame. No clients are served meanwhile.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from hapticd_contract.contents import Amplitude, Content
from hapticd_contract.targets import ClientTargets

from ..config.sections import Config
from ..core.board.ledger import Histogram
from ..daemon.daemon import Daemon, now_ns
from ..daemon.lifecycle import while_served
from ..daemon.machine import Machine
from ..daemon.status import histogram_fields
from ..errors import HapticdError
from ..values import FloatArray, LedgerLine
from . import outputs, plotting
from .arguments import POSITIVE
from .progress import progress_bar
from .run import add_config_arguments, configuration, log_to_stderr
from .service import ConfigLoader

AMPLITUDE_UM = 0.5
TTL_NS = 500_000_000
# Half of that, and the ledger's 512 lines take far longer to fill: polling counts as the daemon's processor time.
POLL_EVERY_S = 0.25

_FROM_MS, _DECADES, _BINS_PER_DECADE = 0.001, 5, 20  # the picture's axis, logarithmic: 1 us .. 100 ms

STAGES = {  # along the way of a touch, then its sum, and what is to be compared with that
    "read_age": "sample to reading",
    "wait": "reading to pass",
    "compute": "pass and after",
    "wire": "reading to wire",
    "link": "writing to board",
    "total": "sample to plate",
    "horizon": "predicted ahead",
    "late": "later than planned",
    "tick_late": "timer late",
}
PATH, WHOLE = ("read_age", "wait", "compute", "wire", "link"), ("total", "horizon")


@dataclass(frozen=True, slots=True)
class MeasuredLatency:
    """Result of a run: the frames that the board applied, histograms of the stages, counts of late and missed ones, and
    the load of one processor since the first frame, NaN if not measured."""

    lines: tuple[LedgerLine, ...]
    stages: Mapping[str, Histogram]
    counts: Mapping[str, int]
    processor_percent: float = math.nan


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_config_arguments(parser)
    what = "duration (default 10); move two fingers meanwhile"
    parser.add_argument("--seconds", type=POSITIVE, default=10.0, help=what)
    what_if = "without devices: simulate what other pads and lines would give, in two minutes on two cores"
    parser.add_argument("--what-if", action="store_true", help=what_if)
    outputs.add_json(parser)
    outputs.add_file(parser, "--plot", outputs.PICTURE, metavar="F.png", help="draw the distributions")
    parser.set_defaults(command=_latency)


def _latency(options: argparse.Namespace) -> None:
    if options.what_if:
        from . import latency_felt

        found = latency_felt.table()
        latency_felt.print_table(found, outputs.table_stream(options.json))
        if options.json is not None:
            outputs.write_json({"what_if": latency_felt.figures(found)}, options.json)
        return
    loaded = configuration(options)
    log_to_stderr(loaded.log.level)
    run(loaded, options.seconds, json_file=options.json, plot=options.plot)


def run(config: Config, seconds: float, *, json_file: str | None, plot: Path | None) -> None:
    """Measure for `seconds` and print; write figures as JSON, and a picture.

    Raises HapticdError if the board applied no frame.
    """
    measured = measure(config, seconds)
    print_table(measured, outputs.table_stream(json_file))
    if json_file is not None:
        outputs.write_json(figures(measured), json_file)
    if plot is not None:
        draw(measured, plot)


def measure(config: Config, seconds: float) -> MeasuredLatency:
    """Serve the configured devices for `seconds`. Raises HapticdError if the board applied no frame."""
    with tempfile.TemporaryDirectory(prefix="hapticd-") as folder, ConfigLoader() as config_loader:
        prepared = replace(config_loader.prepare(config), runtime_dir=Path(folder))
        daemon = prepared.daemon()
        measured = asyncio.run(while_served(daemon, prepared.modes, _watch(daemon, seconds)))
    if measured is None or not measured.lines:
        raise HapticdError("latency: no frame reached the board: move two fingers on the pad, and see the log above.")
    return measured


async def _watch(daemon: Daemon, seconds: float) -> MeasuredLatency:
    """Set targets for all fingers and copy the ledger, for `seconds`."""
    await asyncio.sleep(0)  # let it start
    machine, lines, counted = daemon.machine, list[LedgerLine](), 0
    ledger = machine.session.ledger
    t_end_ns = now_ns() + round(seconds * 1e9)
    t_from_ns, computed_ns = now_ns(), time.process_time_ns()
    with progress_bar("measuring") as progress:
        while now_ns() < t_end_ns:
            progress(1.0 - (t_end_ns - now_ns()) * 1e-9 / seconds)
            if not lines:
                t_from_ns, computed_ns = now_ns(), time.process_time_ns()
            machine.set_targets(_targets(machine), now_ns())
            counted, before = ledger.age.count, counted  # only the new ones: this process measures itself, too
            lines += [ledger.lines[n] for n in range(-min(counted - before, len(ledger.lines)), 0)]
            await asyncio.sleep(POLL_EVERY_S)
    share = (time.process_time_ns() - computed_ns) / max(now_ns() - t_from_ns, 1)
    return replace(gather(machine, lines), processor_percent=100.0 * share)


def _targets(machine: Machine) -> ClientTargets:
    fingers = [finger.finger_id for finger in machine.pipeline.fingers]
    targets: dict[int | str, Content] = {
        finger: Amplitude(AMPLITUDE_UM if finger == fingers[0] else 0.0) for finger in fingers
    }
    return ClientTargets.of("latency", TTL_NS, targets, {})


def gather(machine: Machine, lines: Sequence[LedgerLine]) -> MeasuredLatency:
    """Collect the machine's histograms, and that of sample to plate from `lines`."""
    loop, ledger = machine.status.loop, machine.session.ledger
    total = Histogram()
    for line in lines:
        total.add(line.t_applied_ns - line.t_sample_ns)
    counts = {
        "frames": ledger.late.count,
        "frames late": ledger.late_frames,
        "frames unanswered": machine.session.window.unanswered,
        "reports joined": loop.joined_reports,
        "ticks missed": loop.missed_ticks,
    }
    stages = {
        "read_age": loop.read_age,
        "wait": loop.wait,
        "wire": loop.wire,
        "compute": loop.compute,
        "link": ledger.link,
        "late": ledger.late,
        "total": total,
        "horizon": ledger.horizon,
        "tick_late": loop.tick_late,
    }
    return MeasuredLatency(tuple(lines), stages, counts)


def figures(measured: MeasuredLatency) -> dict[str, object]:
    """Return the result as plain data, in ms."""
    stages = {name: histogram_fields(histogram) for name, histogram in measured.stages.items()}
    percent = measured.processor_percent if math.isfinite(measured.processor_percent) else None
    return {"stages": stages, "counts": dict(measured.counts), "processor_percent": percent}


def print_table(measured: MeasuredLatency, out: TextIO) -> None:
    """Print each stage's percentiles in ms, then the counts."""
    print(f"{'ms':<20}{'p50':>8}{'p95':>8}{'p99':>8}{'max':>8}", file=out)
    for name, what in STAGES.items():
        histogram = measured.stages[name]
        spans_ns = [*map(histogram.percentile_ns, (50, 95, 99)), histogram.longest_ns]
        print(f"{what:<20}" + "".join(f"{span_ns * 1e-6:>8.3f}" for span_ns in spans_ns), file=out)
    print(", ".join(f"{count} {what}" for what, count in measured.counts.items()), file=out)
    if math.isfinite(measured.processor_percent):
        print(f"{measured.processor_percent:.1f} % of one processor, all threads, since the first frame", file=out)


def verdict(measured: MeasuredLatency) -> str:
    """Return in one sentence how long a touch takes, and how many frames took effect when they were planned to."""
    total, horizon, frames = measured.stages["total"], measured.stages["horizon"], measured.counts["frames"]
    on_time_frac = 1.0 - measured.counts["frames late"] / max(frames, 1)
    return (
        f"{100.0 * on_time_frac:.1f} % of {frames} frames were on time: sample to plate took "
        f"{total.percentile_ns(50) * 1e-6:.1f} ms (p99 {total.percentile_ns(99) * 1e-6:.1f}), "
        f"{horizon.percentile_ns(50) * 1e-6:.1f} ms were predicted"
    )


def draw(measured: MeasuredLatency, path: Path, source: str = "", **style: int) -> None:
    """Draw each stage's distribution in a row of its own, along the way of a touch, below the verdict; `style` is that
    of `plotting.save`. Raises HapticdError."""
    figure, ((axes,),) = plotting.subplots(9.0, 5.0, source=source)
    axes.set(xscale="log", xlabel="ms", xlim=(_FROM_MS, _FROM_MS * 10**_DECADES), ylim=(len(STAGES) - 0.8, -1.0))
    right: dict[str, Any] = {"xycoords": ("axes fraction", "data"), "va": "center", "fontsize": 9}
    axes.annotate("p50 / p99, ms", (1.01, -0.75), **right)
    for row, name in enumerate(STAGES):
        histogram = measured.stages[name]
        edges_ms, heights = _outline(histogram)
        colour = "tab:blue" if name in PATH else "tab:orange" if name in WHOLE else "tab:gray"
        axes.fill_between(edges_ms, row, row - 0.85 * heights, step="post", color=colour, alpha=0.75, lw=0)
        axes.axhline(row, color=colour, lw=0.6)
        p50_ms, p99_ms = (histogram.percentile_ns(percent) * 1e-6 for percent in (50, 99))
        axes.plot([p50_ms, p50_ms], [row, row - 0.85], color="black", lw=1.2)
        axes.annotate(f"{p50_ms:.2f} / {p99_ms:.2f}", (1.01, row - 0.25), **right)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_yticks(np.arange(len(STAGES)) - 0.25, STAGES.values())
    axes.tick_params(axis="y", length=0)
    axes.grid(alpha=0.3, axis="x")
    axes.set_title(verdict(measured), loc="left", fontsize=10, x=-0.17)
    plotting.save(figure, path, **style)


def _outline(histogram: Histogram) -> tuple[FloatArray, FloatArray]:
    """Return a distribution over the picture's axis: edges in ms, and from each on its share of the highest column."""
    edges_ms = _FROM_MS * 10 ** (np.arange(_DECADES * _BINS_PER_DECADE + 1) / _BINS_PER_DECADE)
    shares = np.zeros(len(edges_ms))
    for from_ns, below_ns, count in histogram.buckets():
        middle_ms = max((from_ns + below_ns) * 0.5e-6, _FROM_MS)
        column = int(np.searchsorted(edges_ms, middle_ms, side="right")) - 1
        shares[min(column, len(shares) - 2)] += count
    return edges_ms, shares / max(shares.max(), 1.0)
