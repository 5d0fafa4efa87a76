"""Decoder of content: what a finger is to feel, as a target of its own or on a surface."""

from __future__ import annotations

import math
from collections.abc import Callable

from ..content_values import (
    AmplitudeTarget,
    FrictionTarget,
    GradientTarget,
    GratingTarget,
    MapTarget,
    NoiseTarget,
    Target,
)
from ..errors import RequestError
from .assets import DIGEST_BYTES
from .fields import Fields, bounded, items

MAX_AMPLITUDE_UM = 1000.0
MIN_PERIOD_MM, MAX_PERIOD_MM = 0.1, 1000.0
MAX_ANGLE_RAD = 2 * math.pi
MAX_MAP_SIDE = 128
MAX_ASSET_SIDE = 1024  # of a map whose levels are an asset
MAX_SEED = 2**32 - 1
MAX_EXPONENT = 4.0
MAX_POSITION_MM = 1000.0


def _grating(grating: Fields) -> GratingTarget:
    return GratingTarget(
        period_mm=grating.number("period_mm", MIN_PERIOD_MM, MAX_PERIOD_MM),
        angle_rad=grating.number("angle_rad", -MAX_ANGLE_RAD, MAX_ANGLE_RAD, 0.0),
        low_um=grating.number("low_um", 0.0, MAX_AMPLITUDE_UM, 0.0),
        high_um=grating.number("high_um", 0.0, MAX_AMPLITUDE_UM),
        duty_frac=grating.number("duty_frac", 0.0, 1.0, 0.0),
    )


def _map(image: Fields) -> MapTarget:
    asset = image.binary("asset", DIGEST_BYTES) if "asset" in image else b""
    longest = MAX_ASSET_SIDE if asset else MAX_MAP_SIDE
    width = image.whole("width", 1, longest)
    height = image.whole("height", 1, longest)
    frictions = _frictions(image) if "friction" in image else None
    return MapTarget(
        width=width,
        height=height,
        levels=b"" if asset else image.binary("levels", width * height),
        low_um=0.0 if frictions else image.number("low_um", 0.0, MAX_AMPLITUDE_UM, 0.0),
        high_um=0.0 if frictions else image.number("high_um", 0.0, MAX_AMPLITUDE_UM),
        asset=asset,
        frictions=frictions,
    )


def _frictions(image: Fields) -> tuple[float, float]:
    where = image.place("friction")
    ends = items(image.take("friction"), 2, where)
    if len(ends) != 2:
        raise RequestError(f"{where}: has two numbers, the frictions of level 0 and 255.")
    return bounded(ends[0], 0.0, 1.0, where), bounded(ends[1], 0.0, 1.0, where)


def _gradient(gradient: Fields) -> GradientTarget:
    return GradientTarget(
        length_mm=gradient.number("length_mm", MIN_PERIOD_MM, MAX_PERIOD_MM),
        angle_rad=gradient.number("angle_rad", -MAX_ANGLE_RAD, MAX_ANGLE_RAD, 0.0),
        from_um=gradient.number("from_um", 0.0, MAX_AMPLITUDE_UM, 0.0),
        to_um=gradient.number("to_um", 0.0, MAX_AMPLITUDE_UM),
    )


def _noise(noise: Fields) -> NoiseTarget:
    shortest_mm = noise.number("shortest_mm", MIN_PERIOD_MM, MAX_PERIOD_MM)
    return NoiseTarget(
        seed=noise.whole("seed", 0, MAX_SEED) if "seed" in noise else 0,
        shortest_mm=shortest_mm,
        longest_mm=noise.number("longest_mm", shortest_mm, MAX_PERIOD_MM),
        exponent=noise.number("exponent", 0.0, MAX_EXPONENT, 0.0),
        mean_um=noise.number("mean_um", 0.0, MAX_AMPLITUDE_UM),
        rms_um=noise.number("rms_um", 0.0, MAX_AMPLITUDE_UM),
    )


_TEXTURES: dict[str, Callable[[Fields], Target]] = {
    "grating": _grating,
    "map": _map,
    "gradient": _gradient,
    "noise": _noise,
}
CONTENTS = ("amplitude_um", "friction", *_TEXTURES)


def read_content(fields: Fields) -> Target:
    """Read the one field of content. Raises RequestError."""
    kind = fields.only(CONTENTS)
    if kind == "amplitude_um":
        return AmplitudeTarget(fields.number(kind, 0.0, MAX_AMPLITUDE_UM))
    if kind == "friction":
        return FrictionTarget(fields.number(kind, 0.0, 1.0))
    return fields.inner(kind, _TEXTURES[kind])
