"""Targets as functions of position: amplitude in um over plate mm, and friction turned into amplitude.

A function is made once per request and called at every knot: plain arithmetic, about a microsecond.
It is finite and within the target's two amplitudes for every finite position; NaN and positions far from any plate
give what silence would.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final, NamedTuple

from ...content_values import (
    AmplitudeTarget,
    FrictionTarget,
    GradientTarget,
    GratingTarget,
    MapTarget,
    NoiseTarget,
    Target,
)
from ..friction import FrictionCurve
from .noise import FAR_MM, MOST_RMS, noise

Texture = Callable[[float, float], float]


class Sliding:
    """Factor by which a friction needs more amplitude at the speed of the finger that is looked up next."""

    __slots__ = ("gain",)

    def __init__(self) -> None:
        self.gain = 1.0


class Detail(NamedTuple):
    """How finely a texture must be sampled along a path: its corners lie at least `finest_mm` apart; a `smooth` one has
    none."""

    finest_mm: float
    smooth: bool


NO_DETAIL = Detail(math.inf, True)
FINEST_MM: Final = 1e-3
_PIECES_PER_WAVE = 4.0  # a smooth wave shows its curvature in the middle of a quarter of it


def detail(target: Target | None, plate_size_mm: tuple[float, float]) -> Detail:
    """Return how finely a target's texture must be sampled; what is finer than FINEST_MM is not felt."""
    found = _detail(target, plate_size_mm)
    return found if found.finest_mm >= FINEST_MM else Detail(FINEST_MM, found.smooth)


def _detail(target: Target | None, plate_size_mm: tuple[float, float]) -> Detail:
    match target:
        case GratingTarget(period_mm, duty_frac=0.0):
            return Detail(period_mm / _PIECES_PER_WAVE, True)
        case GratingTarget(duty_frac=1.0):
            return NO_DETAIL
        case GratingTarget(period_mm, duty_frac=duty_frac):
            return Detail(min(duty_frac, 1.0 - duty_frac) * period_mm, False)
        case MapTarget(width, height):
            return Detail(min(plate_size_mm[0] / max(width - 1, 1), plate_size_mm[1] / max(height - 1, 1)), False)
        case GradientTarget(length_mm):
            return Detail(length_mm, False)
        case NoiseTarget(shortest_mm=shortest_mm):
            return Detail(shortest_mm / _PIECES_PER_WAVE, True)  # where it is cut it is nearly flat
        case _:
            return NO_DETAIL


def highest_um(target: Target, curve: FrictionCurve) -> float:
    """The largest amplitude that a target can ask for anywhere."""
    match target:
        case AmplitudeTarget(amplitude_um):
            return amplitude_um
        case FrictionTarget(friction_frac):
            return curve.amplitude_um(friction_frac)
        case MapTarget(frictions=(low, high)):
            return curve.amplitude_um(min(low, high))
        case GratingTarget() | MapTarget():
            return max(target.low_um, target.high_um)
        case GradientTarget(from_um=from_um, to_um=to_um):
            return max(from_um, to_um)
        case NoiseTarget(mean_um=mean_um, rms_um=rms_um):
            return mean_um + MOST_RMS * rms_um


def refusal(target: Target, curve: FrictionCurve, w_limit_um: float) -> str:
    """Return why a target asks for too much; empty if it does not. A friction asks for as much as the plate can do."""
    asked_um = highest_um(target, curve)
    if asked_um <= w_limit_um or _asks_for_friction(target):
        return ""
    return f"cannot have {asked_um:g} um: ask for at most {w_limit_um:g} um."


def texture(
    target: Target,
    curve: FrictionCurve,
    plate_size_mm: tuple[float, float],
    w_limit_um: float = math.inf,
    sliding: Sliding | None = None,
) -> Texture:
    """The target as amplitude in um over plate position in mm; frictions that need more than the limit get that.

    Where the curve depends on speed, frictions get the amplitude for that of `sliding`.
    """
    at_rest = _at_rest(target, curve, plate_size_mm, w_limit_um)
    if sliding is None or curve.speed_mm_s == math.inf or not _asks_for_friction(target):
        return at_rest
    return lambda x_mm, y_mm: min(at_rest(x_mm, y_mm) * sliding.gain, w_limit_um)


def _asks_for_friction(target: Target) -> bool:
    return isinstance(target, FrictionTarget) or (isinstance(target, MapTarget) and target.frictions is not None)


def _at_rest(target: Target, curve: FrictionCurve, plate_size_mm: tuple[float, float], w_limit_um: float) -> Texture:
    match target:
        case AmplitudeTarget() | FrictionTarget():
            constant_um = min(highest_um(target, curve), w_limit_um)
            return lambda _x_mm, _y_mm: constant_um
        case GradientTarget():
            return _gradient(target)
        case NoiseTarget():
            return noise(target)
        case MapTarget(frictions=(low, high)):
            frictions = [low + (high - low) * level / 255.0 for level in range(256)]
            levels_um = [min(curve.amplitude_um(friction), w_limit_um) for friction in frictions]
            return _looked_up(_image(replace(target, low_um=0.0, high_um=255.0), plate_size_mm), levels_um)
        case GratingTarget(duty_frac=0.0):
            return _sine_grating(target)
        case GratingTarget():
            return _square_grating(target)
        case MapTarget():
            return _image(target, plate_size_mm)


def _sine_grating(grating: GratingTarget) -> Texture:
    along_x, along_y = math.cos(grating.angle_rad), math.sin(grating.angle_rad)
    mean_um = 0.5 * (grating.low_um + grating.high_um)
    half_um = 0.5 * (grating.high_um - grating.low_um)
    wavenumber = 2.0 * math.pi / grating.period_mm
    low_um, cos = grating.low_um, math.cos

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        along_mm = x_mm * along_x + y_mm * along_y
        if not -FAR_MM <= along_mm <= FAR_MM:
            return low_um
        return mean_um + half_um * cos(wavenumber * along_mm)

    return amplitude_um


def _square_grating(grating: GratingTarget) -> Texture:
    along_x, along_y = math.cos(grating.angle_rad), math.sin(grating.angle_rad)
    period_mm, half_crest_mm = grating.period_mm, 0.5 * grating.duty_frac * grating.period_mm
    low_um, high_um, remainder = grating.low_um, grating.high_um, math.remainder

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        along_mm = x_mm * along_x + y_mm * along_y
        if not -FAR_MM <= along_mm <= FAR_MM:
            return low_um
        return high_um if abs(remainder(along_mm, period_mm)) <= half_crest_mm else low_um

    return amplitude_um


def _gradient(gradient: GradientTarget) -> Texture:
    along_x, along_y = math.cos(gradient.angle_rad), math.sin(gradient.angle_rad)
    length_mm, from_um, to_um = gradient.length_mm, gradient.from_um, gradient.to_um

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        share = (x_mm * along_x + y_mm * along_y) / length_mm + 0.5
        if not share > 0.0:  # NaN too
            return from_um
        return from_um * (1.0 - share) + to_um * share if share < 1.0 else to_um

    return amplitude_um


def _looked_up(level_of: Texture, levels_um: list[float]) -> Texture:
    """Amplitudes of an image's 256 levels: bilinear in friction, which the curve turned into amplitude."""

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        level = level_of(x_mm, y_mm)
        below = min(int(level), 254)
        share = level - below
        return levels_um[below] * (1.0 - share) + levels_um[below + 1] * share

    return amplitude_um


def _image(image: MapTarget, plate_size_mm: tuple[float, float]) -> Texture:
    """Bilinear between pixel centres; the outermost lie on the plate's edges and reach beyond them."""
    width, height, levels = image.width, image.height, image.levels
    last_column, last_row = float(width - 1), float(height - 1)
    left_mm, top_mm = -0.5 * plate_size_mm[0], 0.5 * plate_size_mm[1]
    columns_per_mm, rows_per_mm = last_column / plate_size_mm[0], last_row / plate_size_mm[1]
    low_um, high_um = image.low_um, image.high_um

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        column = (x_mm - left_mm) * columns_per_mm
        row = (top_mm - y_mm) * rows_per_mm
        if not column > 0.0:  # NaN too
            column = 0.0
        elif column > last_column:
            column = last_column
        if not row > 0.0:
            row = 0.0
        elif row > last_row:
            row = last_row
        left, upper = int(column), int(row)
        right_share, lower_share = column - left, row - upper
        here = upper * width + left
        next_column = 1 if left < last_column else 0
        below = here + width if upper < last_row else here
        top_level = levels[here] + (levels[here + next_column] - levels[here]) * right_share
        bottom_level = levels[below] + (levels[below + next_column] - levels[below]) * right_share
        share = (top_level + (bottom_level - top_level) * lower_share) / 255.0
        return low_um * (1.0 - share) + high_um * share

    return amplitude_um
