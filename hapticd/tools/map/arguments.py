"""Arguments of `hapticd plate map`: the plate and the fingers on it."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...config.sections import MOST_MODES
from ...errors import ModesError, UsageError

if TYPE_CHECKING:
    from ...config.sections import Config
    from ...core.friction import FrictionCurve
    from ...core.plate.mode_shapes import ModeShapes
    from ...design.achievability import MapFinger

LIMIT_UM = 4.0  # of each mode with --modes, which names no configuration
MOST_UM, MOST_LIMIT_UM = 1000.0, 20.0  # the bounds of client targets and of the configuration
FELT_CELLS, FELT_PAIR_CELLS = 61, 11  # per side, of a map of friction


class MappedPlate(NamedTuple):
    """A plate: its mode shapes, their limits (M,), and what a contact is and feels."""

    modes: ModeShapes
    size_mm: tuple[float, float]
    limit_um: tuple[float, ...]
    radius_mm: float
    curve: FrictionCurve


def plate(options: argparse.Namespace) -> MappedPlate:
    """Return the plate. Raises HapticdError."""
    from ...config import loader as config
    from ...config.sections import Config
    from ...core.friction import DEFAULT_FRICTION_CURVE

    if options.modes is not None:
        from ...core.plate.mode_shapes import ModeShapes

        try:
            modes = ModeShapes.load(options.modes)
        except ModesError as error:
            raise UsageError(f"--modes: {error}") from None
        if modes.M > MOST_MODES:
            raise UsageError(f"--modes: {options.modes} has {modes.M} modes: give a file of at most {MOST_MODES}.")
        size_mm = 2.0 * float(np.abs(modes.x_mm).max()), 2.0 * float(np.abs(modes.y_mm).max())
        limits_um, radius_mm = limits(options.limit, (LIMIT_UM,) * modes.M), Config().solver.contact_radius_mm
        return MappedPlate(modes, size_mm, limits_um, radius_mm, DEFAULT_FRICTION_CURVE)
    from ...daemon.settings import friction_curve
    from ..service import load_modes

    loaded = config.load(options.config) if options.config is not None else Config()
    if options.plate is not None:
        loaded = _simulated(loaded, options.plate)
    elif not loaded.plate.modes_file:
        from ...sim.plate.ground_truth import WELL_MEASURED

        loaded = config.with_uncertainty(loaded, WELL_MEASURED)
    width_mm, depth_mm = loaded.plate.size_mm
    limits_um = limits(options.limit, loaded.reference_limit_um)
    radius_mm, curve = loaded.solver.contact_radius_mm, friction_curve(loaded)
    return MappedPlate(load_modes(loaded), (width_mm, depth_mm), limits_um, radius_mm, curve)


def _simulated(loaded: Config, name: str) -> Config:
    from ...config.loader import on_plate, with_uncertainty
    from ...sim.plate.glasses import find_glass
    from ...sim.plate.ground_truth import GroundTruth, PlateSettings

    try:
        size_mm = find_glass(name).size_mm
    except ValueError as error:
        raise UsageError(f"--plate: {error}") from None
    loaded = replace(loaded, sim=replace(loaded.sim, plate=name))
    plate = GroundTruth(PlateSettings.of(name))
    return with_uncertainty(on_plate(loaded, size_mm, plate.w_limit_um), plate.uncertainty)


def frictions(text: str, given: int) -> tuple[float, ...]:
    """Return the frictions asked of so many given fingers and of another one, or of a pair. Raises UsageError."""
    asked = tuple([number(part, "--friction", 0.0, 1.0) for part in text.split(",")])
    count = max(given, 1) + 1
    if len(asked) != count:
        raise UsageError(f"--friction: has {len(asked)} frictions for {count} fingers: give one for each.")
    return asked


def limits(text: str | None, usual_um: tuple[float, ...]) -> tuple[float, ...]:
    """Return the limit of each mode. Raises UsageError."""
    if text is None:
        return usual_um
    given = [number(part, "--limit", 1e-3, MOST_LIMIT_UM) for part in text.split(",")]
    if len(given) not in (1, len(usual_um)):
        raise UsageError(f"--limit: has {len(given)} limits for {len(usual_um)} modes: give one, or one for each.")
    return tuple(given * len(usual_um) if len(given) == 1 else given)


def finger(text: str, usual_um: float, size_mm: tuple[float, float]) -> MapFinger:
    """Return a finger with its target, or with the usual one. Raises UsageError."""
    from ...design.achievability import MapFinger

    parts = text.split(",")
    if len(parts) not in (2, 3):
        raise UsageError(
            f"--finger: {text!r} is no position: write X,Y in mm, or X,Y,UM, such as -30,20 or -30,20,0.5."
        )
    x_mm, y_mm = (number(part, f"--finger {text}", -math.inf, math.inf) for part in parts[:2])
    if not (abs(x_mm) <= size_mm[0] / 2 and abs(y_mm) <= size_mm[1] / 2):
        raise UsageError(
            f"--finger {text}: lies off the plate, which reaches from -{size_mm[0] / 2:g},-{size_mm[1] / 2:g} "
            f"to {size_mm[0] / 2:g},{size_mm[1] / 2:g} mm."
        )
    return MapFinger(x_mm, y_mm, number(parts[2], f"--finger {text}", 0.0, MOST_UM) if len(parts) == 3 else usual_um)


def number(text: str | float, name: str, low: float, high: float) -> float:
    """Return a number within bounds. Raises UsageError."""
    try:
        value = float(text)
    except ValueError:
        raise UsageError(f"{name}: {text!r} is no number.") from None
    if not (math.isfinite(value) and low <= value <= high):
        bounds = f"it must be {low:g} .. {high:g}" if math.isfinite(low) else "it must be a number of mm"
        raise UsageError(f"{name}: {value:g} is out of bounds, {bounds}.")
    return value
