"""Fit of the pad's position under the plate to touched marks, and of the scale of its ellipses to prints.

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
from ...values import AffineMap, TouchFrame
from ...wire.trackpad import DEFAULT_PAD, Decoder, Pad
from .. import pads, plotting
from . import simulated
from .contacts import Axes, ScaleFit, fit_scale, parse_prints
from .live_pad import reading
from .marks import APART_MM, MIN_MARKS, AffineFit, MarkPoint, TouchedMarks, fit_affine, placement
from .step import Step, add_config
from .verdict import PICTURE, Figure, Finding, Outcome, Verdict, judge

PICTURE_FILE = "trackpad.png"
WITHIN_S = 120.0  # all marks are touched
FARTHEST_MM = 500.0  # of a mark on the largest plate

PRINTS_MM = 1.0  # of axes: as far as a person touches alike, and reads a ruler
GOOD_MM, USABLE_MM = 1.0, 3.0  # of the left-out residual: a fingertip aims to about half a millimetre
TURNED_DEG = 45.0  # a larger rotation is probably an error
SCALE = (0.9, 1.1)  # of a pad's own millimetres, which are accurate to some per cent
MOST_SCALE = 2.0  # of `trackpad.matrix`
ENLARGED = 20.0  # magnification of the residuals in the picture


def check(options: argparse.Namespace) -> None:
    """Check the arguments. Raises HapticdError."""
    parse_prints(options.prints, len(parse_marks(options.marks)))
    pads.chosen(options)


def run(options: argparse.Namespace) -> Verdict:
    """Run the step. Raises HapticdError."""
    marks_mm = parse_marks(options.marks)
    prints_mm = parse_prints(options.prints, len(marks_mm))
    if options.sim:
        touched, device = _played(marks_mm, options.seed, prints_mm), {}
    else:
        chosen = pads.chosen(options)
        pad, touched = asyncio.run(touch_marks(pads.connected(chosen), marks_mm, WITHIN_S, prints_mm))
        device = pads.settings(chosen, pad.model)
    found = fit_affine(touched.rests_mm, marks_mm)
    scale = fit_scale(_on_plate(touched.axes_mm, found.plate_from_pad), prints_mm) if prints_mm else None
    draw(marks_mm, touched.rests_mm, found, options.out / PICTURE_FILE, source=simulated.source(options))
    return verdict(found, device, scale, is_simulated=options.sim)


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


def _played(marks_mm: Sequence[MarkPoint], seed: int, prints_mm: Sequence[Axes] = ()) -> TouchedMarks:
    """Return the touches that the simulated pad reports."""
    decoder, touched = Decoder(DEFAULT_PAD), TouchedMarks()
    for report in simulated.touch_reports(marks_mm, seed, prints_mm=prints_mm):
        for frame in decoder.decode(report.data, round(report.t_arrive_s * 1e9)):
            touched.update(frame)
    if len(touched.rests_mm) < len(marks_mm):
        missing = marks_mm[len(touched.rests_mm)]
        raise CalibrationError(
            f"The simulated pad does not reach the mark {missing}: choose marks nearer to the centre."
        )
    return touched


async def touch_marks(
    source: TrackpadSource,
    marks_mm: Sequence[MarkPoint],
    within_s: float,
    prints_mm: Sequence[Axes] = (),
) -> tuple[Pad, TouchedMarks]:
    """Prompt for one mark after the other; return the pad and the touches."""
    touched, done, pads = TouchedMarks(), asyncio.Event(), list[Pad]()

    def on_link(pad: Pad | None) -> None:
        if pad is not None:
            pads.append(pad)
            _ask(marks_mm, len(touched.rests_mm), prints_mm)

    def take(frame: TouchFrame) -> None:
        if not done.is_set() and touched.update(frame) is not None:
            _ask(marks_mm, len(touched.rests_mm), prints_mm)
            if len(touched.rests_mm) == len(marks_mm):
                done.set()

    try:
        async with reading(source, take, on_link):
            await asyncio.wait_for(done.wait(), within_s)
    except TimeoutError:
        raise CalibrationError(
            f"{len(touched.rests_mm)} of {len(marks_mm)} marks were touched in {within_s:g} s: rest one finger on each "
            "for half a second, lift it in between, and stop the service first if no touch is detected."
        ) from None
    return pads[-1], touched


def _ask(marks_mm: Sequence[MarkPoint], place: int, prints_mm: Sequence[Axes]) -> None:
    if place < len(marks_mm):
        (x_mm, y_mm), how = marks_mm[place], ""
        if prints_mm:
            how = ", as for the print of {:g} x {:g} mm".format(*prints_mm[place])
        print(f"touch mark {place + 1} of {len(marks_mm)}, at ({x_mm:g}, {y_mm:g}) mm{how}, and hold", flush=True)


def verdict(
    found: AffineFit, device: dict[str, object], scale: ScaleFit | None = None, *, is_simulated: bool
) -> Verdict:
    """Judge whether the marks agree, and whether the placement is plausible; `scale` is that of the pad's ellipses.

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
        *_scale_figures(scale),
    )
    matrix = [round(value, 6) for value in _matrix(here)]
    offset_mm = [round(here.offset_x_mm, 4), round(here.offset_y_mm, 4)]
    outcome, sentence = judge(
        _findings(found, scale, is_any=device.get("source") in pads.LIE_ANYHOW),
        f"{len(found.left_out_mm)} marks agree to {found.left_out_rms_mm:.2f} mm.",
    )
    ellipses: dict[str, float] = {}
    if scale is not None:
        ellipses = {"ellipse_scale": round(scale.scale, 4), "ellipse_offset_mm": round(scale.offset_mm, 4)}
    settings = {"trackpad": {**device, "offset_mm": offset_mm, "matrix": matrix, **ellipses}}
    return Verdict("trackpad", outcome, sentence, figures, settings, is_simulated)


def _matrix(here: AffineMap) -> tuple[float, float, float, float]:
    return here.xx, here.xy, here.yx, here.yy


def _on_plate(axes_mm: Sequence[Axes], here: AffineMap) -> list[Axes]:
    """Return axes in the plate's millimetres, in which the service takes them."""
    size = math.sqrt(abs(here.xx * here.yy - here.xy * here.yx))
    return [(size * major_mm, size * minor_mm) for major_mm, minor_mm in axes_mm]


def _scale_figures(scale: ScaleFit | None) -> tuple[Figure, ...]:
    if scale is None:
        return ()
    return (
        Figure("scale of ellipses", scale.scale, ""),
        Figure("offset of their axes", scale.offset_mm, "mm"),
        Figure("residual of prints, RMS", scale.rms_mm, "mm"),
    )


def _findings(found: AffineFit, scale: ScaleFit | None, *, is_any: bool) -> Iterator[Finding]:
    where = placement(found.plate_from_pad)
    if is_any:
        if max(map(abs, _matrix(found.plate_from_pad))) > MOST_SCALE:
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
    if scale is not None and scale.rms_mm > PRINTS_MM:
        yield Outcome.WARN, f"Ellipses and prints disagree by {scale.rms_mm:.1f} mm: touch as firmly as for each print."


def draw(
    marks_mm: Sequence[MarkPoint], touches_mm: Sequence[MarkPoint], found: AffineFit, path: Path, *, source: str = ""
) -> None:
    """Draw marks, mapped touches and their difference, enlarged. Raises HapticdError."""
    figure, ((plot,),) = plotting.subplots(5.5, 4.5, source=source)
    marks = np.array(marks_mm)
    mapped = np.array([found.plate_from_pad.apply(*touch) for touch in touches_mm])
    plot.plot(*marks.T, "s", markersize=9, fillstyle="none", label="marks")
    plot.plot(*mapped.T, "+", markersize=9, label="touches, mapped")
    for mark, residual_mm in zip(marks, found.residual_mm, strict=True):
        tip = mark - ENLARGED * residual_mm
        plot.plot([mark[0], tip[0]], [mark[1], tip[1]], color="tab:red", linewidth=1.5)
    for place, mark in enumerate(marks, 1):
        plot.annotate(str(place), mark, xytext=(8, 8), textcoords="offset points")
    plot.plot([], [], color="tab:red", label=f"difference, {ENLARGED:g} times")
    plot.set(xlabel="x, mm", ylabel="y, mm", aspect="equal", title=f"left out: {found.left_out_rms_mm:.3f} mm RMS")
    plot.margins(0.2)
    plot.legend(fontsize=8, loc="center")
    plotting.save(figure, path, **PICTURE)


def _add_marks(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--marks", default="-50,-40 50,-40 50,40 -50,40", metavar="'X,Y ...'", help="on the plate in mm, 4 or more"
    )
    parser.add_argument(
        "--prints",
        default="",
        metavar="'LxW ...'",
        help="length and width in mm of the contact at each mark, or one for all, from inked prints on paper: "
        "calibrates the scale of the pad's ellipses (default: contacts are discs of solver.contact_radius_mm)",
    )


STEP = Step(
    name="trackpad",
    order=9,
    summary="fit the pad's position from touched marks on the plate",
    todo="touch marks on the plate to fit the pad's position (stop the service first)",
    example="--out DIR",
    arguments=(add_config, _add_marks),
    check=check,
    run=run,
)
