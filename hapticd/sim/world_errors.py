"""Errors of a laboratory: one field per cause.

The daemon's configuration describes a world without these errors; the simulation plays one with them. So perfect
knowledge of a cause is its field at the neutral value.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Final

import msgspec
import numpy as np

from ..errors import SimulationError
from ..formats.toml_file import shown
from ..values import FloatArray
from .fingers.pad_noise import PadNoise
from .score import CONTACT_RADIUS_MM

DRIFT_S: Final = 600.0
USUAL_MM_S: Final = 100.0  # the paper's fingers
_SKIN_STREAM: Final = 26
# Bounds of a world in a file.
_Size = Annotated[float, msgspec.Meta(ge=0.0)]
_Positive = Annotated[float, msgspec.Meta(gt=0.0)]
_Share = Annotated[float, msgspec.Meta(ge=0.0, lt=1.0)]
_Radius = Annotated[float, msgspec.Meta(gt=0.0, le=10.0)]
_Scale = Annotated[float, msgspec.Meta(gt=-1.0)]  # minus 1


@dataclass(frozen=True, slots=True)
class PadPose:
    """Pose of the pad, relative to a centred one: shift, anticlockwise rotation, scale minus 1."""

    x_mm: float = 0.0
    y_mm: float = 0.0
    angle_deg: float = 0.0
    scale_frac: _Scale = 0.0


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """Errors of the plate's sensors: gain minus 1 and phase of each, and the share of each other sensor's mode.

    `crosstalk_frac` holds the rows of a matrix of sensors by modes, whose diagonal does not count. Sensors beyond the
    given ones have no error.
    """

    gain_frac: tuple[float, ...] = ()
    phase_deg: tuple[float, ...] = ()
    crosstalk_frac: tuple[tuple[float, ...], ...] = ()

    def matrix(self, sensors: int) -> np.ndarray[Any, np.dtype[np.complex128]]:
        """Return what multiplies the exact readings, (sensors, sensors)."""
        gain, phase_deg = np.ones(sensors), np.zeros(sensors)
        gain[: len(self.gain_frac)] += self.gain_frac[:sensors]
        phase_deg[: len(self.phase_deg)] = self.phase_deg[:sensors]
        mixed = np.zeros((sensors, sensors), dtype=np.complex128)
        for sensor, row in enumerate(self.crosstalk_frac[:sensors]):
            mixed[sensor, : len(row)] = row[:sensors]
        np.fill_diagonal(mixed, 1.0)
        return (gain * np.exp(1j * np.radians(phase_deg)))[:, None] * mixed


@dataclass(frozen=True, slots=True)
class FingerLoad:
    """Effect of fingers on the plate in addition to their usual damping.

    `damping_factor` multiplies that; `detuning_hz` is added to a mode's frequency per square of its shape under a
    finger; both rise and fall by `force_frac` with the finger's force, at about 1 Hz. Both act over the contact's disc
    of `spread_frac` of its size: 0 is its centre, 1 the whole.
    """

    damping_factor: _Positive = 1.0
    detuning_hz: float = 0.0
    force_frac: _Share = 0.0
    spread_frac: _Size = 0.0

    def force(self, seed: int, finger: int, t_s: FloatArray) -> FloatArray:
        """Return a finger's force (T,), relative to its mean."""
        rate_hz, phase_rad = np.random.default_rng([seed, finger]).uniform((0.7, 0.0), (1.5, 2.0 * math.pi))
        return np.asarray(1.0 + self.force_frac * np.sin(2.0 * math.pi * rate_hz * t_s + phase_rad))


@dataclass(frozen=True, slots=True)
class MapChange:
    """Change of the mode shapes since their scan, different for each mode.

    `waves_frac`: RMS of other waves, as a share of the shape's RMS; `local_frac`: height of some cusps, as a share of
    the shape's peak.
    """

    waves_frac: _Size = 0.0
    local_frac: _Size = 0.0


@dataclass(frozen=True, slots=True)
class CentroidErrors:
    """Distance from a contact's centre at which a resting finger is reported, in mm.

    `finger_mm` in a direction of each finger's own, the same always; `posture_mm` in one that all fingers share in a
    session, and another in the next (`settings.Settings.session`); `wander_mm`, RMS, in a few seconds to and fro,
    each finger by itself; `pressure_mm` along the posture with the force, as it departs by its own mean
    (`FingerLoad.force_frac` of it). Left out: what differs over the pad and with the contact's form, and that the pad's
    own pressure shows the force.
    """

    finger_mm: _Size = 0.0
    posture_mm: _Size = 0.0
    wander_mm: _Size = 0.0
    pressure_mm: _Size = 0.0


@dataclass(frozen=True, slots=True)
class ContactSizes:
    """True contacts: the radius of a disc of the same area, uniform between two bounds, and the ratio of the axes,
    uniform up to `aspect`, at any angle; each finger has its own. Left out: contacts that are no ellipse, and that
    grow with the force."""

    least_mm: _Radius = CONTACT_RADIUS_MM
    most_mm: _Radius = CONTACT_RADIUS_MM
    aspect: Annotated[float, msgspec.Meta(ge=1.0, le=4.0)] = 1.0


@dataclass(frozen=True, slots=True)
class Skin:
    """Changes of a person's `friction_factor`.

    `finger_ratio`: each finger has its own, up to so many times the person's either way. `drift_frac`: by which it
    grows in DRIFT_S from a run's start on, as skin moistens. `speed_s_m`, `force_power`: a friction takes an amplitude
    that grows by `speed_s_m` times the sliding speed, and with this power of the force (`FingerLoad.force_frac`); at
    USUAL_MM_S and the mean force it is that of the factor. The daemon's curve grows by `known_s_m` already. Left out:
    curves of another form.
    """

    finger_ratio: Annotated[float, msgspec.Meta(ge=1.0)] = 1.0
    drift_frac: _Scale = 0.0
    speed_s_m: _Size = 0.0
    force_power: float = 0.0
    known_s_m: _Size = 0.0


@dataclass(frozen=True, slots=True)
class EllipseErrors:
    """Difference of the pad's law of ellipses from `pad_ellipse.USUAL`: scale over its less 1, and its offset."""

    scale_frac: _Scale = 0.0
    offset_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class WorldErrors:
    """Everything that a laboratory may have wrong. The default is a world without errors.

    `centroid_shift_mm`: how far the reported centroid lies ahead of the contact's centre while the finger moves.
    `latency_ms`: true latency of the pad less the configured one. `noise`: None takes the settings' own.
    `stamp_jitter_ms` (half width), `map_noise_frac`: in addition to the settings' own. `link_jitter_ms`: additional
    delay of a message, uniform from 0 to this. `glue_frac`: share of other waves in the shapes, as in `MapChange`, but
    present when they are scanned. `drift_hz` (P,): each mode's drift, a sine of this size and a period of 40 s.
    `mistuning_hz`: of all modes since the board's calibration. `stop_ramp_s`: in which strokes begin and end; None
    takes the scenario's. `seed` is that of the random functions that the sizes above belong to; no cause.
    `centroids` are biased in addition to that shift. `pad_warp_mm`: the largest departure of the pad's coordinates from
    a straight grid, smooth over the pad; left out: steps from electrode to electrode. `mixing_deg`: angle by which the
    modes of each pair have turned into each other since the scan. `chip_mm`: sides of a corner that broke off since,
    `supports_hz`: springs that four points of the edge have met since, by which a mode rises where its shape is 1;
    both mix and shift the modes (`plate.coupled_modes`). `drift_hz_per_min`: of all modes alike, from a run's start
    on, while `drift_hz` returns. `contacts`: None are discs of 5 mm radius. `friction_factor`: an amplitude gives this
    person the friction that so many times as much gives by the daemon's curve.
    What a laboratory knows is no cause either, and is never drawn: `map_step_mm`, from one point of the scan to the
    next, and `report_period_ms` of the pad; None takes the settings'. `lost_frac` of the reports do not arrive.
    """

    pad_pose: PadPose = field(default_factory=PadPose)
    centroid_shift_mm: float = 0.0
    latency_ms: float = 0.0
    noise: PadNoise | None = None
    stamp_jitter_ms: _Size = 0.0
    link_jitter_ms: _Size = 0.0
    map_change: MapChange = field(default_factory=MapChange)
    map_noise_frac: _Size = 0.0
    glue_frac: _Size = 0.0
    sensors: SensorErrors = field(default_factory=SensorErrors)
    finger_load: FingerLoad = field(default_factory=FingerLoad)
    drift_hz: tuple[float, ...] = ()
    mistuning_hz: float = 0.0
    stop_ramp_s: _Positive | None = None
    centroids: CentroidErrors = field(default_factory=CentroidErrors)
    pad_warp_mm: _Size = 0.0
    mixing_deg: float = 0.0
    chip_mm: _Size = 0.0
    supports_hz: _Size = 0.0
    drift_hz_per_min: float = 0.0
    contacts: ContactSizes | None = None
    friction_factor: _Positive = 1.0
    ellipses: EllipseErrors = field(default_factory=EllipseErrors)
    skin: Skin = field(default_factory=Skin)
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    map_step_mm: _Positive | None = None
    report_period_ms: _Positive | None = None
    lost_frac: _Share = 0.0

    @property
    def of_plate(self) -> WorldErrors:
        """The errors of its plate's shapes alone."""
        causes = ("map_change", "glue_frac", "mixing_deg", "chip_mm", "supports_hz", "seed")
        return WorldErrors(**{cause: getattr(self, cause) for cause in causes})

    @property
    def couples_modes(self) -> bool:
        """Whether modes of the plate mix (`plate.coupled_modes`)."""
        return any((self.mixing_deg, self.chip_mm, self.supports_hz))

    def amplitude_gains(self, t_s: FloatArray, sliding_mm_s: FloatArray) -> FloatArray:
        """Return how many times the amplitude of the daemon's curve each finger needs for a friction, at instants (T,)
        and sliding speeds (T,N)."""
        skin, per_mm_s = self.skin, 1e-3 * sliding_mm_s
        gains = (1.0 + skin.speed_s_m * per_mm_s) / (1.0 + skin.known_s_m * per_mm_s)
        gains /= self.friction_factor * (1.0 + 1e-3 * skin.speed_s_m * USUAL_MM_S)
        for finger in range(gains.shape[1]):
            share = float(np.random.default_rng([self.seed, _SKIN_STREAM, finger]).uniform(-1.0, 1.0))
            pressed = self.finger_load.force(self.seed, finger, t_s) ** skin.force_power
            gains[:, finger] *= pressed / skin.finger_ratio**share / (1.0 + skin.drift_frac) ** (t_s / DRIFT_S)
        return gains

    @classmethod
    def parsed(cls, text: str) -> WorldErrors:
        """Return the world of a JSON object with some of the fields, as `asdict` nests them. Raises SimulationError."""
        try:
            made = msgspec.json.decode(text, type=cls)
            _check_names(msgspec.json.decode(text), asdict(made), "world")
        except (ValueError, RecursionError) as error:
            raise SimulationError(f"This is no world: {error}. Give a JSON object with some of its fields.") from None
        return made


def _check_names(given: Mapping[str, Any], valid: Mapping[str, Any], name: str) -> None:
    """Raise SimulationError for a name that the world has not."""
    for key, value in given.items():
        if key not in valid:
            raise SimulationError(f"{name} has no {shown(key)}: choose from {', '.join(valid)}")
        if isinstance(value, dict):
            _check_names(value, valid[key], key)


NEUTRAL: Final = WorldErrors()
