"""Settings of a simulated run, the configuration that its daemon has by them, and what that daemon has measured."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from ..board_values import UNCALIBRATED, BoardCalibration
from ..config.loader import on_plate, with_uncertainty
from ..config.sections import Config
from ..core.friction import DEFAULT_FRICTION_CURVE
from ..core.plate.mode_shapes import ModeShapes
from ..design.person import FRICTION_SPEED_MM_S
from ..errors import SimulationError
from .fingers import fingertip
from .fingers.fingertip import Fingertip
from .fingers.pad_noise import FILTERED_NOISE, PadNoise
from .fingers.scenarios import MOTIONS, SMOOTH, SPEED_MM_S
from .paper_scheme import paper_config
from .plate.glasses import find_glass
from .plate.ground_truth import GroundTruth, PlateSettings
from .world_errors import WorldErrors

SCHEMES = ("hapticd", "paper")
_POSITIVE = ("speed_mm_s", "report_period_ms")
_NOT_NEGATIVE = ("stamp_jitter_ms", "sensor_latency_ms", "link_ms")


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of a simulated run: the daemon's are in `config`, and what is wrong in `plate.world`; `fingertip` is the
    contact of all fingers that have none of their own. `motion` is that of strokes, one of `MOTIONS`; `speed_mm_s` that
    of smooth ones and of the other scenarios. Fingers that come back later touch in another `session`. With
    `friction_targets` clients ask for the frictions that the scenario's amplitudes have by the built-in curve."""

    scheme: str = "hapticd"
    motion: str = SMOOTH
    speed_mm_s: float = SPEED_MM_S
    noise: PadNoise = FILTERED_NOISE
    fingertip: Fingertip = fingertip.USUAL
    stamp_jitter_ms: float = 1.0
    report_period_ms: float = 11.25
    sensor_latency_ms: float = 10.0
    link_ms: float = 5.0
    session: int = 0
    friction_targets: bool = False
    plate: PlateSettings = field(default_factory=PlateSettings)
    config: Config = field(default_factory=Config)

    def __post_init__(self) -> None:
        """Raise SimulationError, a ValueError, for invalid settings."""
        if self.scheme not in SCHEMES:
            raise SimulationError(f"there is no scheme {self.scheme!r}: choose one of {', '.join(SCHEMES)}.")
        if self.motion not in MOTIONS:
            raise SimulationError(f"there is no motion {self.motion!r}: choose one of {', '.join(MOTIONS)}.")
        for name in (*_POSITIVE, *_NOT_NEGATIVE):
            value = getattr(self, name)
            if not (math.isfinite(value) and (value > 0 or (value == 0 and name in _NOT_NEGATIVE))):
                bound = "0 or more" if name in _NOT_NEGATIVE else "above 0"
                raise SimulationError(f"the setting {name} is {value}: give a finite number, {bound}.")


class Measured(NamedTuple):
    """The plate as the daemon has measured it: the mode map, and the calibration for the board."""

    modes: ModeShapes
    calibration: BoardCalibration = UNCALIBRATED


def scheme_config(settings: Settings) -> Config:
    """Return the daemon's configuration for a plate and a scheme.

    The paper's is its Matlab loop: hold, steps, PI, its formula.
    """
    plate = GroundTruth(settings.plate)
    config = on_plate(settings.config, find_glass(settings.plate.plate).size_mm, plate.w_limit_um)
    config = with_uncertainty(config, plate.uncertainty)
    return paper_config(config) if settings.scheme == "paper" else config


def in_world(settings: Settings, world: WorldErrors) -> Settings:
    """Return the same settings in another world."""
    return replace(settings, plate=replace(settings.plate, world=world))


def knowing_person(settings: Settings, factor: float) -> Settings:
    """Return settings whose daemon takes the person for one whose friction answers `factor` times as much to amplitude
    as the usual person's, and to speed as is assumed. What is wrong with that is left of `friction_factor`."""
    world, usual = settings.plate.world, DEFAULT_FRICTION_CURVE
    plate = replace(
        settings.config.plate,
        friction_curve=(0.0, usual.full_um / factor),
        friction_floor_frac=usual.floor_frac,
        friction_speed_mm_s=FRICTION_SPEED_MM_S,
    )
    knowing = replace(settings, config=replace(settings.config, plate=plate))
    skin = replace(world.skin, known_s_m=1e3 / FRICTION_SPEED_MM_S)
    return in_world(knowing, replace(world, friction_factor=world.friction_factor / factor, skin=skin))


def paper_settings(played: Settings) -> Settings:
    """Return the settings for the paper's scheme, whose sensor reports every 10 ms."""
    return replace(played, scheme="paper", report_period_ms=10.0)
