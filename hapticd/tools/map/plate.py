"""The plate of `hapticd plate map`: of a configuration, a file of mode shapes, or the simulation."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...config.sections import MOST_MODES
from ...errors import ModesError, UsageError

if TYPE_CHECKING:
    from ...config.sections import Config
    from ...core.friction import FrictionCurve
    from ...core.plate.mode_shapes import ModeShapes

LIMIT_UM = 4.0  # of each mode with --modes, which names no configuration


class MappedPlate(NamedTuple):
    """A plate: its mode shapes, their limits (M,), and what a contact is and feels."""

    modes: ModeShapes
    size_mm: tuple[float, float]
    limit_um: Sequence[float]
    radius_mm: float
    curve: FrictionCurve

    def __str__(self) -> str:
        limits = ", ".join(f"{limit:.3g}" for limit in self.limit_um)
        named = "1 mode" if self.modes.M == 1 else f"{self.modes.M} modes"
        return f"a plate of {self.size_mm[0]:g} x {self.size_mm[1]:g} mm, {named} of at most {limits} um"


def mapped_plate(options: argparse.Namespace) -> MappedPlate:
    """Return the plate that the options name. Raises HapticdError."""
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
        radius_mm = Config().solver.contact_radius_mm
        return MappedPlate(modes, size_mm, (LIMIT_UM,) * modes.M, radius_mm, DEFAULT_FRICTION_CURVE)
    from ...daemon.settings import friction_curve
    from ..service import load_modes

    loaded = config.load(options.config) if options.config is not None else Config()
    if options.plate is not None:
        loaded = _simulated(loaded, options.plate)
    elif not loaded.plate.modes_file:
        from ...sim.plate.ground_truth import WELL_MEASURED

        loaded = config.with_uncertainty(loaded, WELL_MEASURED)
    radius_mm, curve = loaded.solver.contact_radius_mm, friction_curve(loaded)
    if not radius_mm > 0.0:
        raise UsageError("--config: friction is felt by whole contacts: set solver.contact_radius_mm above 0.")
    width_mm, depth_mm = loaded.plate.size_mm
    return MappedPlate(load_modes(loaded), (width_mm, depth_mm), loaded.reference_limit_um, radius_mm, curve)


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
