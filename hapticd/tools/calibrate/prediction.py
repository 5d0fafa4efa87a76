"""Initial weights of the predictor for this pad, learned from a minute of strokes.

Weights are learned on one half of the touches and judged on the other. None are kept that are no better there than
those of many pads.
"""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...config.sections import PredictionConfig
from ...core.prediction import make_predictor
from ...core.prediction.pad_memory import PadMemory
from ...errors import CalibrationError
from ...io.devices.trackpad_source import TrackpadSource
from ...sim.fingers.sensor import SensorModel
from ...sim.fingers.strokes import Strokes
from ...values import FloatArray
from ...wire.trackpad import Pad
from .. import pads, plotting
from ..arguments import POSITIVE
from ..touches import RecordedTouches, Trace, recorded
from . import simulated
from .delays import period_setting
from .live_pad import reading
from .step import PICTURE, Figure, Finding, Outcome, Step, Verdict, add_config, judge

SIMULATED_SPEED_MM_S = 100.0
AHEADS_MS = (15, 25)
FEWEST_SAMPLES = 1000  # ten seconds of strokes: fewer teach less than many pads do
PASSES = 2
LANDING_SAMPLES = 5  # whose predictions say more about the landing than about the pad
PIECE_SAMPLES = 100  # a second: what was kept counts most where a touch is young
WORTH_FRAC = 0.99  # of the error on the other half: a smaller gain is chance


class Learned(NamedTuple):
    """Weights to keep, and RMS errors on the other half by horizon: with those of many pads, and with these."""

    weights: tuple[float, ...]
    before_mm: tuple[float, ...]
    after_mm: tuple[float, ...]

    @property
    def is_better(self) -> bool:
        """The geometric mean over the horizons falls by more than chance."""
        return float(np.prod(self.after_mm)) < WORTH_FRAC ** len(AHEADS_MS) * float(np.prod(self.before_mm))


def check(options: argparse.Namespace) -> None:
    """Check the arguments. Raises HapticdError."""
    pads.chosen(options)
    if options.recording is not None and not options.recording.is_file():
        raise CalibrationError(f"--recording: {options.recording} is not a file: give a recording (.mcap).")


def run(options: argparse.Namespace) -> Verdict:
    """Run the step. Raises HapticdError."""
    if options.sim:
        traces = strokes(options.seed, options.strokes)
    elif options.recording is not None:
        traces = recorded(options.recording)
    else:
        traces = asyncio.run(_touched(pads.connected(pads.chosen(options)), options.strokes))
    if sum(len(trace.t_s) for trace in traces) < FEWEST_SAMPLES:
        raise CalibrationError(
            f"The touches have fewer than {FEWEST_SAMPLES} samples: stroke the pad for a minute, slowly and fast."
        )
    found = learned(traces)
    draw(found, options.out / "prediction.png", source=simulated.source(options))
    return verdict(traces, found, is_simulated=options.sim)


def strokes(seed: int, seconds: float) -> list[Trace]:
    """Return the touch that the simulated pad reports of a finger's strokes."""
    touches = RecordedTouches()
    for frame in simulated.frames(SensorModel(seed=seed).reports([Strokes(seed, SIMULATED_SPEED_MM_S)], seconds)):
        touches.add(frame)
    return touches.traces()


async def _touched(source: TrackpadSource, seconds: float) -> list[Trace]:
    """Return the touches of the next seconds on the pad."""
    touches = RecordedTouches()

    def on_link(pad: Pad | None) -> None:
        touches.lift_all()
        if pad is not None:
            print(f"stroke the pad for {seconds:g} s with one or two fingers, slowly and fast, with stops", flush=True)

    async with reading(source, touches.add, on_link):
        await asyncio.sleep(seconds)
    return touches.traces()


def learned(traces: Sequence[Trace]) -> Learned:
    """Learn on the first half of the samples, judge on the second, where each piece begins with what was kept."""
    first, second = halves(traces)
    memory = PadMemory()
    for _ in range(PASSES):
        errors_mm(first, lambda: memory)
    judged = [piece for trace in second for piece in pieces(trace)]
    return Learned(memory.kept, errors_mm(judged, PadMemory), errors_mm(judged, lambda: PadMemory.of(memory.kept)))


def pieces(trace: Trace) -> list[Trace]:
    """Cut a trace into touches of PIECE_SAMPLES."""
    starts = range(0, len(trace.t_s) - PIECE_SAMPLES + 1, PIECE_SAMPLES)
    return [_cut(trace, slice(start, start + PIECE_SAMPLES)) for start in starts] or [trace]


def _cut(trace: Trace, part: slice) -> Trace:
    return trace._replace(t_s=trace.t_s[part], xy_mm=trace.xy_mm[part])


def halves(traces: Sequence[Trace]) -> tuple[list[Trace], list[Trace]]:
    """Return the traces of the first and of the second half of all samples; the one in the middle is cut."""
    ends = np.cumsum([len(trace.t_s) for trace in traces])
    before = np.clip(ends[-1] // 2 - ends + np.diff(ends, prepend=0), 0, None).tolist()
    first = [_cut(trace, slice(None, count)) for trace, count in zip(traces, before, strict=True)]
    second = [_cut(trace, slice(count, None)) for trace, count in zip(traces, before, strict=True)]
    return [one for one in first if len(one.t_s) > 1], [one for one in second if len(one.t_s) > 1]


def errors_mm(traces: Sequence[Trace], memory: Callable[[], PadMemory]) -> tuple[float, ...]:
    """Return RMS distances to the pad's own later reports, by horizon; `memory` is that of one trace and learns."""
    squares: list[list[FloatArray]] = [[] for _ in AHEADS_MS]
    for trace in traces:
        predictor = make_predictor(memory=memory())
        predicted = []
        for t_ns, x_mm, y_mm in trace.samples:
            predictor.update(t_ns, x_mm, y_mm)
            predicted.append([predictor.predict(t_ns + 1_000_000 * ahead_ms) for ahead_ms in AHEADS_MS])
        for place, ahead_ms in enumerate(AHEADS_MS):
            t_s = trace.t_s + 1e-3 * ahead_ms
            truth_mm = np.stack([np.interp(t_s, trace.t_s, axis) for axis in trace.xy_mm.T], axis=-1)
            error_mm = (np.array(predicted)[:, place] - truth_mm)[t_s <= trace.t_s[-1]][LANDING_SAMPLES:]
            squares[place].append(np.sum(error_mm**2, axis=1))
    return tuple(float(np.sqrt(np.mean(np.concatenate(some)))) for some in squares)


def verdict(traces: Sequence[Trace], found: Learned, *, is_simulated: bool) -> Verdict:
    """Judge whether the pad's own weights help on touches that did not teach them."""
    period_ms = 1e3 * float(np.median(np.concatenate([np.diff(trace.t_s) for trace in traces])))
    figures = (
        Figure("samples", float(sum(len(trace.t_s) for trace in traces)), ""),
        Figure("report period", period_ms, "ms"),
        *(
            Figure(f"error {ahead_ms} ms ahead, {whose}", error_mm, "mm")
            for whose, errors in (("weights of many pads", found.before_mm), ("of this pad", found.after_mm))
            for ahead_ms, error_mm in zip(AHEADS_MS, errors, strict=True)
        ),
    )
    findings: list[Finding] = []
    settings: dict[str, list[float] | float] = {**period_setting(period_ms, PredictionConfig())}
    if found.is_better:
        settings["pad_weights"] = [round(weight, 4) for weight in found.weights]
    else:
        findings.append((Outcome.WARN, "The weights of many pads are as good: none are kept. Longer strokes may help."))
    gain = 100.0 * (1.0 - found.after_mm[0] / found.before_mm[0])
    outcome, sentence = judge(findings, f"The error 15 ms ahead falls by {gain:.0f} % on touches that taught nothing.")
    return Verdict("prediction", outcome, sentence, figures, {"prediction": settings} if settings else {}, is_simulated)


def draw(found: Learned, path: Path, *, source: str = "") -> None:
    """Draw the errors before and after. Raises HapticdError."""
    figure, ((plot,),) = plotting.subplots(4.5, 3.5, source=source)
    places = np.arange(len(AHEADS_MS))
    plot.bar(places - 0.2, found.before_mm, 0.4, label="weights of many pads")
    plot.bar(places + 0.2, found.after_mm, 0.4, label="weights of this pad")
    plot.set(xticks=places, xticklabels=[f"{ahead_ms} ms" for ahead_ms in AHEADS_MS], ylabel="RMS error, mm")
    plot.legend(fontsize=8)
    plotting.save(figure, path, **PICTURE)


def _add_strokes(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--recording", type=Path, metavar="F.mcap", help="learn from the strokes of a recording")
    parser.add_argument(
        "--strokes", type=POSITIVE, default=60.0, metavar="S", help="duration of the strokes (default 60)"
    )


STEP = Step(
    name="prediction",
    order=11,
    summary="learn the pad's predictor from a minute of strokes (stop the service first)",
    example="--out DIR",
    arguments=(add_config, _add_strokes),
    check=check,
    run=run,
)
