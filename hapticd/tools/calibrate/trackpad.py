"""Fit of the pad's position under the plate to touched marks.

The pad is read as the service reads it, so the service must not run. On the simulated plate the reports are generated
in virtual time.
"""

from __future__ import annotations

import argparse
import asyncio
import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from ...errors import CalibrationError
from ...io.devices.trackpad_source import TrackpadSource
from ...values import TouchFrame
from ...wire.trackpad import Pad
from .. import pads, plotting
from . import simulated
from .live_pad import reading
from .marks import APART_MM, MIN_MARKS, AffineFit, MarkPoint, TouchedMarks, fit_affine, placement
from .step import PICTURE, Figure, Finding, Outcome, Step, Verdict, add_config, judge

WITHIN_S = 120.0  # all marks are touched
FARTHEST_MM = 500.0  # of a mark on the largest plate

GOOD_MM, USABLE_MM = 1.0, 3.0  # of the left-out residual: a fingertip aims to about half a millimetre
TURNED_DEG = 45.0  # a larger rotation is probably an error
SCALE = (0.9, 1.1)  # of a pad's own millimetres, which are accurate to some per cent
MOST_SCALE = 2.0  # of `trackpad.matrix`
ENLARGED = 20.0  # magnification of the residuals in the picture


def check(options: argparse.Namespace) -> None:
    """Check the arguments. Raises HapticdError."""
    pads.chosen(options)


def run(options: argparse.Namespace) -> Verdict:
    """Run the step. Raises HapticdError."""
    marks_mm, device = options.marks, {}
    if options.sim:
        touched_mm = _played(marks_mm, options.seed)
    else:
        chosen = pads.chosen(options)
        pad, touched_mm = asyncio.run(touch_marks(pads.connected(chosen), marks_mm, WITHIN_S))
        device = pads.settings(chosen, pad.model)
    found = fit_affine(touched_mm, marks_mm)
    draw(marks_mm, touched_mm, found, options.out / "trackpad.png", source=simulated.source(options))
    return verdict(found, device, is_simulated=options.sim)


def parse_marks(text: str) -> list[MarkPoint]:
    """Parse marks "x,y x,y ..." in plate mm. Raises CalibrationError."""
    try:
        marks = [(float(x), float(y)) for x, y in (mark.split(",") for mark in text.split())]
    except ValueError:
        raise CalibrationError(f"--marks is {text!r}: write each mark as X,Y, with blanks between them.") from None
    if not all(abs(position) <= FARTHEST_MM for mark in marks for position in mark):
        raise CalibrationError(f"--marks is {text!r}: positions are millimetres from the plate's centre.")
    if len(marks) < MIN_MARKS or any(math.dist(*pair) <= 2 * APART_MM for pair in combinations(marks, 2)):
        raise CalibrationError(f"--marks needs at least {MIN_MARKS} marks, more than {2 * APART_MM:g} mm apart.")
    return marks


def _played(marks_mm: Sequence[MarkPoint], seed: int) -> list[MarkPoint]:
    """Return the touches that the simulated pad reports."""
    touched = TouchedMarks()
    for frame in simulated.frames(simulated.touch_reports(marks_mm, seed)):
        touched.update(frame)
    if len(touched.rests_mm) < len(marks_mm):
        missing = marks_mm[len(touched.rests_mm)]
        raise CalibrationError(
            f"The simulated pad does not reach the mark {missing}: choose marks nearer to the centre."
        )
    return touched.rests_mm


async def touch_marks(
    source: TrackpadSource, marks_mm: Sequence[MarkPoint], within_s: float
) -> tuple[Pad, list[MarkPoint]]:
    """Prompt for one mark after the other; return the pad and the touches."""
    touched, done, pads = TouchedMarks(), asyncio.Event(), list[Pad]()

    def ask() -> None:
        if (place := len(touched.rests_mm)) < len(marks_mm):
            x_mm, y_mm = marks_mm[place]
            print(f"touch mark {place + 1} of {len(marks_mm)}, at ({x_mm:g}, {y_mm:g}) mm, and hold", flush=True)
        else:
            done.set()

    def on_link(pad: Pad | None) -> None:
        if pad is not None:
            pads.append(pad)
            ask()

    def take(frame: TouchFrame) -> None:
        if not done.is_set() and touched.update(frame) is not None:
            ask()

    try:
        async with reading(source, take, on_link):
            await asyncio.wait_for(done.wait(), within_s)
    except TimeoutError:
        raise CalibrationError(
            f"{len(touched.rests_mm)} of {len(marks_mm)} marks were touched in {within_s:g} s: rest one finger on each "
            "for half a second, lift it in between, and stop the service first if no touch is detected."
        ) from None
    return pads[-1], touched.rests_mm


def verdict(found: AffineFit, device: dict[str, object], *, is_simulated: bool) -> Verdict:
    """Judge whether the marks agree, and whether the placement is plausible.

    A trackpad is the right way up and knows its size; another device may lie in any way, and have any scale.
    """
    here, where = found.plate_from_pad, placement(found.plate_from_pad)
    figures = (
        Figure("pad's centre x", here.offset_x_mm, "mm"),
        Figure("pad's centre y", here.offset_y_mm, "mm"),
        Figure("rotation", where.rotation_deg, "degrees"),
        Figure("scale x", where.scale_x, ""),
        Figure("scale y", where.scale_y, ""),
        Figure("shear", where.shear, ""),
        Figure("marks", float(len(found.left_out_mm)), ""),
        Figure("residual, RMS", float(np.sqrt((found.residual_mm**2).sum(axis=1).mean())), "mm"),
        Figure("residual of a mark left out, RMS", found.left_out_rms_mm, "mm"),
        Figure("residual of a mark left out, largest", float(found.left_out_mm.max()), "mm"),
    )
    outcome, sentence = judge(
        _findings(found, is_any=device.get("source") in pads.LIE_ANYHOW),
        f"{len(found.left_out_mm)} marks agree to {found.left_out_rms_mm:.2f} mm.",
    )
    pose = {
        "offset_mm": [round(here.offset_x_mm, 4), round(here.offset_y_mm, 4)],
        "matrix": [round(value, 6) for value in (here.xx, here.xy, here.yx, here.yy)],
    }
    return Verdict("trackpad", outcome, sentence, figures, {"trackpad": {**device, **pose}}, is_simulated)


def _findings(found: AffineFit, *, is_any: bool) -> Iterator[Finding]:
    here, where = found.plate_from_pad, placement(found.plate_from_pad)
    if is_any:
        if max(abs(here.xx), abs(here.xy), abs(here.yx), abs(here.yy)) > MOST_SCALE:
            yield (
                Outcome.FAIL,
                "The device's size is far from the true one: measure it, and set trackpad.size_mm.",
            )
    elif where.scale_y < 0.0:
        yield Outcome.FAIL, "The pad seems mirrored: touch the marks in their order; x points right, y away from you."
    elif abs(where.rotation_deg) > TURNED_DEG:
        turned = f"The pad seems rotated by {where.rotation_deg:.0f} degrees, as if x and y were swapped or reversed"
        yield Outcome.WARN, f"{turned}: check how it lies, and the order of the touches."
    disagree = f"The marks disagree by {found.left_out_rms_mm:.1f} mm"
    if found.left_out_rms_mm > USABLE_MM:
        yield Outcome.FAIL, f"{disagree}: touch them again."
    elif found.left_out_rms_mm > GOOD_MM:
        yield Outcome.WARN, f"{disagree}, mark {np.argmax(found.left_out_mm) + 1} most: touch them again."
    if not is_any and not all(SCALE[0] <= abs(scale) <= SCALE[1] for scale in (where.scale_x, where.scale_y)):
        yield Outcome.WARN, "The pad's scale differs from the plate's: check the positions of the marks."


def draw(
    marks_mm: Sequence[MarkPoint], touches_mm: Sequence[MarkPoint], found: AffineFit, path: Path, *, source: str = ""
) -> None:
    """Draw marks, mapped touches and their difference, enlarged. Raises HapticdError."""
    figure, ((plot,),) = plotting.subplots(5.5, 4.5, source=source)
    marks = np.array(marks_mm)
    mapped = np.array([found.plate_from_pad.apply(*touch) for touch in touches_mm])
    plot.plot(*marks.T, "s", markersize=9, fillstyle="none", label="marks")
    plot.plot(*mapped.T, "+", markersize=9, label="touches, mapped")
    tips = marks - ENLARGED * found.residual_mm
    for place, (mark, tip) in enumerate(zip(marks, tips, strict=True), 1):
        label = f"difference, {ENLARGED:g} times" if place == 1 else None
        plot.plot(*np.stack((mark, tip)).T, color="tab:red", linewidth=1.5, label=label)
        plot.annotate(str(place), mark, xytext=(8, 8), textcoords="offset points")
    plot.set(xlabel="x, mm", ylabel="y, mm", aspect="equal", title=f"left out: {found.left_out_rms_mm:.3f} mm RMS")
    plot.margins(0.2)
    plot.legend(fontsize=8, loc="center")
    plotting.save(figure, path, **PICTURE)


def _add_marks(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--marks",
        type=parse_marks,
        default="-50,-40 50,-40 50,40 -50,40",
        metavar="'X,Y ...'",
        help="on the plate in mm, 4 or more",
    )


STEP = Step(
    name="trackpad",
    order=9,
    summary="fit the pad's position from touched marks on the plate (stop the service first)",
    example="--out DIR",
    arguments=(add_config, _add_marks),
    check=check,
    run=run,
)
