"""Laboratories at random: the tolerance of each error, and worlds drawn within them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from ..config.sections import MOST_MODES  # of a plate: errors are drawn for all, whatever plate is played
from ..errors import SimulationError
from .fingers.pad_noise import PadNoise
from .score import CONTACT_RADIUS_MM
from .world_errors import (
    CentroidErrors,
    ContactSizes,
    EllipseErrors,
    FingerLoad,
    MapChange,
    PadPose,
    SensorErrors,
    Skin,
    WorldErrors,
)


class Tolerance(NamedTuple):
    """Bound of one error in each kind of world, its unit, and where the figure comes from."""

    mild: float
    laboratory: float
    worst: float
    unit: str
    source: str


# Errors are uniform within these bounds, of either sign where that has a meaning.
TOLERANCES: Final[dict[str, Tolerance]] = {
    "pad_shift": Tolerance(0.2, 0.5, 1.0, "mm", "a pad laid by hand to marks; by eye, 1 mm"),
    "pad_angle": Tolerance(0.1, 0.3, 0.6, "deg", "0.5 mm over the pad's 110 mm is 0.26 degrees"),
    "pad_scale": Tolerance(0.001, 0.003, 0.005, "", "electrode pitch and the driver's counts per mm"),
    "centroid_shift": Tolerance(0.2, 0.5, 1.0, "mm", "skin shears by 0.5 to 2 mm before a finger slides"),
    "latency": Tolerance(1.0, 3.0, 5.0, "ms", "a quarter of a report's period; half of one"),
    "noise": Tolerance(0.02, 0.05, 0.1, "mm", "measured on 72 devices: 0.02 .. 0.03 typical, 0.1 the worst"),
    "time_error": Tolerance(0.3, 0.8, 1.5, "ms", "the same: 0.1 .. 0.25 good, 0.8 Apple's, 1.5 .. 2.5 the worst"),
    "stamp_jitter": Tolerance(0.5, 4.0, 6.0, "ms", "USB stamps 0.3 .. 0.7 RMS, polled 2.7, batched more"),
    "link_jitter": Tolerance(1.0, 5.0, 10.0, "ms", "latency timers of USB serial adapters: 1, and 16 by default"),
    "map_waves": Tolerance(0.02, 0.05, 0.1, "", "glue that ages, a support that moves; repeated scans differ by 2 %"),
    "map_local": Tolerance(0.02, 0.05, 0.1, "", "a wire, or an actuator's edge that comes loose"),
    "map_noise": Tolerance(0.01, 0.03, 0.08, "", "a vibrometer on bare glass: 2 to 10 % of the peak"),
    "glue": Tolerance(0.03, 0.05, 0.1, "", "glued actuators and supports against a free plate's theory"),
    "sensor_gain": Tolerance(0.01, 0.03, 0.05, "", "a calibration with a 3 % vibrometer; piezo sensors age"),
    "sensor_phase": Tolerance(1.0, 3.0, 6.0, "deg", "charge amplifier and filter tolerances at 29 kHz"),
    "sensor_crosstalk": Tolerance(0.01, 0.03, 0.05, "", "patches lie off the nodes of other modes by 1 mm"),
    "finger_damping": Tolerance(1.25, 2.0, 5.0, "times", "dry to moist fingers; a factor of 10 was never measured"),
    "finger_detuning": Tolerance(10.0, 50.0, 150.0, "Hz", "mass and stiffness of a fingertip, about half its damping"),
    "finger_force": Tolerance(0.2, 0.4, 0.6, "", "force varies by half during exploration"),
    "drift": Tolerance(5.0, 30.0, 80.0, "Hz", "0.01 % per kelvin of 29 kHz, heated by actuators and hands"),
    "mistuning": Tolerance(3.0, 20.0, 60.0, "Hz", "a room 1, 7 or 20 kelvin from that of the calibration"),
    "stop_ramp": Tolerance(0.2, 0.15, 0.1, "s", "a shortest ramp of smooth strokes; usually 0.3"),
    # A stream is numbered by its place in this table: what is new goes to the end.
    "centroid_finger": Tolerance(0.15, 0.35, 0.5, "mm", "fingers' pads differ in form, and in where they press"),
    "centroid_posture": Tolerance(0.1, 0.3, 0.5, "mm", "a finger that lies flatter shifts its contact by 0.5 mm"),
    "centroid_wander": Tolerance(0.2, 0.5, 0.8, "mm", "RMS: a finger rolls while it explores"),
    "centroid_pressure": Tolerance(0.1, 0.3, 0.6, "mm", "a contact that grows does so towards the palm"),
    "pad_warp": Tolerance(0.2, 0.5, 0.8, "mm", "edges of capacitive pads, where electrodes end"),
    "mixing": Tolerance(1.0, 4.0, 6.0, "deg", "modes 20 Hz apart turn by 3 degrees for 1 Hz of coupling"),
    "chip": Tolerance(0.0, 1.0, 2.0, "mm", "glass that stood on its corner; 1 mm is 4 mg of a fingertip plate"),
    "supports": Tolerance(0.5, 2.0, 8.0, "Hz", "10 mm2 of silicone 1 mm high: 0.7; of polyurethane: 18"),
    "drift_rate": Tolerance(1.0, 5.0, 15.0, "Hz/min", "2.9 Hz per kelvin of glass that warms by 1.7 K a minute"),
    "contact_smaller": Tolerance(0.5, 1.0, 1.0, "mm", "radius: 4 .. 7 mm, 50 .. 150 mm2 at 0.2 .. 1 N"),
    "contact_larger": Tolerance(0.5, 2.0, 2.0, "mm", "the same"),
    "contact_aspect": Tolerance(1.2, 1.4, 1.6, "", "prints of flat fingers: 1.2 .. 1.6"),
    "person": Tolerance(1.15, 1.4, 2.0, "times", "the decay of friction with amplitude, person to person"),
    "ellipse_scale": Tolerance(0.05, 0.15, 0.3, "", "no maker says what a pad's ellipses are"),
    "ellipse_offset": Tolerance(0.3, 0.8, 1.5, "mm", "the same"),
    "skin_finger": Tolerance(1.02, 1.05, 1.1, "times", "assumed: a seventh of what persons do; no source found"),
    "skin_drift": Tolerance(0.05, 0.1, 0.2, "", "assumed, in ten minutes; at once it takes 20 s (Dzidek 2017)"),
    "skin_speed": Tolerance(0.3, 1.0, 3.0, "s/m", "assumed: a film of air 0 (Wiertlewski 2016), bouncing more"),
    "skin_force": Tolerance(0.05, 0.17, 0.5, "", "power: 0 (Sednaoui 2017) .. 1/6, a film (Salbu 1964) below a sphere"),
}
LEVELS: Final = ("mild", "laboratory", "worst")

_CORRELATION: Final = 0.65  # of real pads that filter
_USUAL_RAMP_S: Final = 0.3
_FIRST_MODES: Final = 6  # that boards had when the worlds of the published figures were drawn


def draw(level: str, seed: int) -> WorldErrors:
    """Draw one of the laboratories of a level: the same for the same seed, each cause from a stream of its own.

    Raises SimulationError for an unknown level.
    """
    if level not in LEVELS:
        raise SimulationError(f"there is no world {level!r}: choose one of {', '.join(LEVELS)}.")
    bounds = {name: getattr(tolerance, level) for name, tolerance in TOLERANCES.items()}
    drawn = _Draws(bounds, seed)
    shift_mm, towards_rad = drawn.size("pad_shift"), drawn.within(math.pi, "pad_shift", 1)
    return WorldErrors(
        pad_pose=PadPose(
            shift_mm * math.cos(towards_rad),
            shift_mm * math.sin(towards_rad),
            drawn.signed("pad_angle"),
            drawn.signed("pad_scale"),
        ),
        centroid_shift_mm=drawn.signed("centroid_shift"),
        latency_ms=drawn.signed("latency"),
        noise=PadNoise(drawn.size("noise"), _CORRELATION, drawn.size("time_error"), hold_mm=0.02),
        stamp_jitter_ms=drawn.size("stamp_jitter"),
        link_jitter_ms=drawn.size("link_jitter"),
        map_change=MapChange(drawn.size("map_waves"), drawn.size("map_local")),
        map_noise_frac=drawn.size("map_noise"),
        glue_frac=drawn.size("glue"),
        sensors=SensorErrors(
            tuple(drawn.signed("sensor_gain", sensor) for sensor in range(MOST_MODES)),
            tuple(drawn.signed("sensor_phase", sensor) for sensor in range(MOST_MODES)),
            tuple(
                tuple(
                    0.0 if mode == sensor else drawn.signed("sensor_crosstalk", _pair(sensor, mode))
                    for mode in range(MOST_MODES)
                )
                for sensor in range(MOST_MODES)
            ),
        ),
        finger_load=FingerLoad(
            bounds["finger_damping"] ** drawn.within(1.0, "finger_damping"),
            drawn.signed("finger_detuning"),
            drawn.size("finger_force"),
            spread_frac=1.0,  # skin touches glass all over its contact
        ),
        drift_hz=tuple(drawn.signed("drift", mode) for mode in range(MOST_MODES)),
        mistuning_hz=drawn.signed("mistuning"),
        centroids=CentroidErrors(
            *(drawn.size(f"centroid_{name}") for name in ("finger", "posture", "wander", "pressure"))
        ),
        pad_warp_mm=drawn.size("pad_warp"),
        mixing_deg=drawn.size("mixing"),
        chip_mm=drawn.size("chip"),
        supports_hz=drawn.size("supports"),
        drift_hz_per_min=drawn.signed("drift_rate"),
        contacts=ContactSizes(
            CONTACT_RADIUS_MM - bounds["contact_smaller"],
            CONTACT_RADIUS_MM + bounds["contact_larger"],
            bounds["contact_aspect"],
        ),
        friction_factor=bounds["person"] ** drawn.within(1.0, "person"),
        skin=Skin(
            bounds["skin_finger"],
            drawn.signed("skin_drift"),
            bounds["skin_speed"] * drawn.share("skin_speed"),
            bounds["skin_force"] * drawn.share("skin_force"),
        ),
        ellipses=EllipseErrors(drawn.signed("ellipse_scale"), drawn.signed("ellipse_offset")),
        stop_ramp_s=_USUAL_RAMP_S - (_USUAL_RAMP_S - bounds["stop_ramp"]) * drawn.share("stop_ramp"),
        seed=seed,
    )


def _pair(sensor: int, mode: int) -> int:
    """Return a number of its own for each pair, which does not change when boards get more modes."""
    return _FIRST_MODES * sensor + mode if max(sensor, mode) < _FIRST_MODES else 100 + MOST_MODES * sensor + mode


class _Draws:
    """Uniform numbers, each from the stream of its name."""

    def __init__(self, bounds: Mapping[str, float], seed: int) -> None:
        self._bounds, self._seed = bounds, seed

    def share(self, name: str, index: int = 0) -> float:
        """Return a number in [0, 1)."""
        return float(np.random.default_rng([self._seed, list(self._bounds).index(name), index]).random())

    def within(self, bound: float, name: str, index: int = 0) -> float:
        """Return a number in [-bound, bound)."""
        return bound * (2.0 * self.share(name, index) - 1.0)

    def signed(self, name: str, index: int = 0) -> float:
        """Return an error of either sign."""
        return self.within(self._bounds[name], name, index)

    def size(self, name: str) -> float:
        """Return an error from half of its bound on: a quantity that every laboratory has some of."""
        return self._bounds[name] * (0.5 + 0.5 * self.share(name))
