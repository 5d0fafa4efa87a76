"""Arguments of `hapticd plate --felt`: ranges of plates and of modes."""

from __future__ import annotations

import argparse
import math

from ..config.sections import LEAST_MODES, MOST_MODES
from ..design.glued_plate import GluedPlate, Patch
from ..design.materials import find_material
from ..errors import CalibrationError, UsageError
from .arguments import number

SIZE_STEP_MM, THICKNESS_STEP_MM = 10.0, 0.5
DRIVES = "27000..33000"  # in Hz: 30 kHz is above hearing, and amplifiers and patches are made for it
MOST_PLATES = 2000


def plates(options: argparse.Namespace) -> list[GluedPlate]:
    """Return the plates to compare, each size once: 200 x 150 is 150 x 200 turned."""
    try:
        materials = [find_material(name) for name in options.material.split("/")]
    except ValueError as error:
        raise CalibrationError(f"This plate cannot be designed: {error}") from None
    thicknesses_mm = _values(options.thickness, "--thickness", THICKNESS_STEP_MM, 0.01, 100.0)
    edges = options.size.lower().split("x")
    if len(edges) > 2:
        raise UsageError(f"--size: {options.size!r} has more than two edges: write 200x200, 150..240 or 150..240x200.")
    spans = [_values(edge, "--size", SIZE_STEP_MM, 10.0, 1000.0) for edge in edges]
    if len(spans) == 1:
        sizes = [(width_mm, depth_mm) for width_mm in spans[0] for depth_mm in spans[0] if depth_mm <= width_mm]
    else:
        sizes = [(width_mm, depth_mm) for width_mm in spans[0] for depth_mm in spans[1]]
    patches = tuple(_patch(text) for text in options.patch or ())
    plates = [
        GluedPlate(size, thick_mm, of, patches) for size in sizes for thick_mm in thicknesses_mm for of in materials
    ]
    if len(plates) > MOST_PLATES:
        raise UsageError(f"--size: {len(plates)} plates are too many: narrow the ranges to {MOST_PLATES}.")
    return plates


def dimensions_mm(text: str) -> tuple[float, float, float]:
    """Return a patch's width, depth and thickness. Raises ValueError and ArgumentTypeError."""
    width_mm, depth_mm, thickness_mm = (number(0.01, 1000.0)(part) for part in text.lower().split("x"))
    return width_mm, depth_mm, thickness_mm


def _patch(text: str) -> Patch:
    try:
        x_mm, y_mm, dimensions = text.split(",")
        width_mm, depth_mm, thickness_mm = dimensions_mm(dimensions)
        place_mm = number(-500.0, 500.0)(x_mm), number(-500.0, 500.0)(y_mm)
    except (ValueError, argparse.ArgumentTypeError):
        raise UsageError(
            f"--patch: {text!r} is no patch: write position and dimensions in mm, such as 90,90,10x10x0.3."
        ) from None
    return Patch(*place_mm, (width_mm, depth_mm), thickness_mm)


def modes(text: str) -> list[int]:
    """Return the numbers of modes of --modes. Raises UsageError."""
    values = _values(text, "--modes", 1.0, LEAST_MODES, MOST_MODES)
    if any(value != round(value) for value in values):
        raise UsageError(f"--modes: {text!r} is not a whole number, or a range of them such as 4..6.")
    return [round(value) for value in values]


def _values(text: str, name: str, step: float, low: float, high: float) -> list[float]:
    """Return one number, or those of a range such as 150..240, whose last is included."""
    first, last = span(text, name, low, high)
    return [first + step * index for index in range(math.floor((last - first) / step + 1e-9) + 1)]


def span(text: str, name: str, low: float, high: float) -> tuple[float, float]:
    """Return both ends of a range such as 150..240, of one number twice. Raises UsageError."""
    parsed = number(low, high)
    try:
        ends = [parsed(part) for part in text.split("..")]
    except argparse.ArgumentTypeError as error:
        raise UsageError(f"{name}: {error}.") from None
    if len(ends) > 2 or ends[-1] < ends[0]:
        raise UsageError(f"{name}: {text!r} is no range: write the lower end first, such as 150..240.")
    return ends[0], ends[-1]
