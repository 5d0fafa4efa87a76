"""Ground truth of the simulated plate: its true dynamics, in contrast to the daemon's measurements.

Its P modes are those of a `Glass`: the driven ones in the order of their amplifiers, then parasitic ones. In the
rotating frame of the drive each follows

    dW/dt = (-decay + j detuning) W - j gain V - (damping by fingers)

with V (M,) the complex actuator voltages. The daemon gets only `measured_mode_map`, a noisy measurement of the driven
modes with the usual fit, and the sensor signals, which differ from W by crosstalk and noise.

Not modelled: all other modes (the reference plate's nearest is 109 Hz above: 11 x 1 lines) and their share in the
measurement of the driven ones, the influence of glued actuators and supports on the shapes, hysteresis and heating of
the actuators. Fingers damp and couple modes; they detune them, as sensors and shapes have errors, in a world
(`sim.world_errors`) that has such.

Sources: the paper, sections II and III (frequencies, sizes, limits) and eq. 5-6; `design.glued_plate` for the shapes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hapticd.config.sections import LEAST_MODES, UncertaintyConfig
from hapticd.core.plate.mode_shapes import ModeShapes, ParasiticModes
from hapticd.design.cartography import compensated

from ...values import FloatArray
from ..world_errors import NEUTRAL, SensorErrors, WorldErrors
from .glasses import GLASSES, LEAST_PARASITIC, REFERENCE, CopiedGlass, find_glass, most_driven
from .shape_tables import ModeScan, coupled, mode_map, true_grid, true_surfaces
from .shapes import theory
from .stored import SCANS
from .wirings import IDENTITY, wiring

MODES = GLASSES[REFERENCE].modes[:4]  # X and Y, whose shapes vary along x and along y, and the pair below them
DRIVEN_MODES = MODES[:2]
_SPLIT_HZ = 10.0  # a plate is not quite square: modes of equal frequency are this far to either side of it
_SIZED_EACH = 3  # driven modes of the reference plate whose amplifiers are sized for them
_LEAST_ALL = 4  # modes
FINGER_DECAY_1_S = 115.0  # on the reference plate
_PARASITIC_NOISE = 3.0  # of their measurement, relative to that of the driven modes
WELL_MEASURED = UncertaintyConfig(map_frac=0.003, sensors_frac=0.003, place_mm=0.0)
DRIFT_S = 40.0  # period of a drift: it reaches its size after 10 s


@dataclass(frozen=True, slots=True)
class PlateSettings:
    """Parameters of the simulated plate: as built (first two groups) and its drift (third).

    `finger_decay_1_s` times the square of the shape under a finger is the decay rate that it adds to a mode. At 115 1/s
    two fingers, both on antinodes inside the plate (phi^2 about 0.4), raise the reference decay of 183 1/s to 1.5
    times, the limit of the firmware's control; two fingers anywhere (phi^2 = 0.124 on average) to 1.16 times. No
    measurement of this plate exists.
    `sized_for_damping` follows the paper, whose amplifiers reach W_LIM = 4 um *in use*, with a finger on the plate; 1
    sizes them for the bare plate.
    `world` is what is wrong: causes of the plate apply here, those of pad, link and fingers in `sim.lockstep`.
    `wiring` is one of `wirings.WIRINGS`; its amplifiers hold all driven modes at `w_limit_um` together.
    `driven_modes` have an amplifier and a sensor; up to three of the reference plate have amplifiers that reach
    `w_limit_um` each, all others share the size of the first, so that a mode reaches less the farther it is from the
    drive (`GroundTruth.w_limit_um`).
    """

    plate: str = REFERENCE
    f_x_hz: float = 29195.0
    f_y_hz: float = 29215.0
    drive_hz: float = 29205.0
    q_factor: float = 500.0
    finger_decay_1_s: float = FINGER_DECAY_1_S
    driven_modes: int = 2
    wiring: str = IDENTITY
    world: WorldErrors = NEUTRAL

    w_limit_um: float | tuple[float, ...] = 4.0  # in any mode, or in each that has an amplifier
    v_limit_v: float = 150.0
    sized_for_damping: float = 1.5  # `v_limit_v` holds `w_limit_um` at this many times the undamped plate's decay
    parasitic_coupling: float = 0.02  # of each actuator into each parasitic mode, as a share of its own mode's gain
    sensor_crosstalk: float = 0.01  # of Y in the sensor of X, and vice versa
    parasitic_pickup: float = 0.01  # of each parasitic mode in each sensor
    sensor_noise_um: float = 0.0006
    loop_phase_rad: float = 0.0  # phase of amplifiers, electrodes and sensors, the same in both loops

    detune_hz: float = 0.0  # all modes drift together, as with temperature

    map_step_mm: float = 4.5
    map_noise_frac: float = 0.02

    @classmethod
    def of(cls, plate: str, driven_modes: int | None = None, wiring: str = IDENTITY) -> PlateSettings:
        """Return the settings of a plate (`find_glass`) with this many amplifiers. Raises ValueError."""
        driven = find_glass(plate).driven if driven_modes is None else driven_modes
        if plate == REFERENCE:
            return cls(driven_modes=driven, wiring=wiring)
        glass = find_glass(plate)
        return cls(
            plate=plate,
            drive_hz=glass.drive_hz,
            driven_modes=driven,
            finger_decay_1_s=FINGER_DECAY_1_S * GLASSES[REFERENCE].mass_ratio(glass),
            w_limit_um=glass.reach_um[:driven] if isinstance(glass.reach_um, tuple) else glass.reach_um,
            sized_for_damping=1.0,
            wiring=wiring,
        )

    def __post_init__(self) -> None:
        most = most_driven(self.plate)
        if not LEAST_MODES <= self.driven_modes <= most:
            raise ValueError(f"PlateSettings.driven_modes is {self.driven_modes}; give {LEAST_MODES} to {most}.")
        wiring(self.wiring, self.driven_modes)


class GroundTruth:
    """True parameters of the plate for the board model: read-only arrays for P modes, M actuators and sensors.

    `frequency_hz`, `decay_1_s`, `detuning_rad_s` (P,): pi f / Q, and 2 pi (f - drive), at the
    start; `drifted_rad_s` gives later detunings.
    `gain_um_per_v_s` (P, M): at the design damping and without drift, `v_limit_v` just holds `w_limit_um` (M,).
    `nominal_decay_1_s`, `nominal_detuning_rad_s`, `nominal_gain_um_per_v_s` (M,): result of a sweep of
    the bare plate's driven modes, set in the board's firmware, as are `drive` and `sense` (M, M): amplifiers by modes
    and modes by sensors.
    `sensor` (M, P): gain of each mode in each sensor, complex where the world's sensors have errors.
    `loop_phase_rad` (M,): the constant phase of each loop.
    `finger_decay_1_s`, `finger_detuning_rad_s`: what a finger adds, per square of the shape under it.
    """

    def __init__(self, settings: PlateSettings | None = None) -> None:
        self.settings = settings = PlateSettings() if settings is None else settings
        built_hz = _built_hz(settings)
        driven_hz = built_hz[: settings.driven_modes]
        world = settings.world
        names = find_glass(settings.plate).modes[: len(built_hz)]
        disturbed = settings.plate, names, world.of_plate, tuple(built_hz.tolist())
        risen_hz = coupled(*disturbed)[1] if world.couples_modes else np.zeros(len(built_hz))
        self.frequency_hz = _read_only(built_hz + settings.detune_hz + world.mistuning_hz + risen_hz)
        self.decay_1_s = _read_only(math.pi * self.frequency_hz / settings.q_factor)
        self.detuning_rad_s = _read_only(2.0 * math.pi * (self.frequency_hz - settings.drive_hz))
        own, self.w_limit_um = _amplifiers(settings, driven_hz)
        parasitic = len(built_hz) - len(own)
        wires = wiring(settings.wiring, len(own))
        driven = np.diag(own) @ wires.drives
        glass = find_glass(settings.plate)
        self._pushed: FloatArray | None = None
        pushed = np.tile(settings.parasitic_coupling * own, (parasitic, 1))
        if isinstance(glass, CopiedGlass):
            pushes = np.array(glass.pushes[:parasitic])
            pushed = pushes @ driven
            stiffness_1_s = self.decay_1_s - 1j * self.detuning_rad_s
            self._pushed = (pushes * stiffness_1_s[: len(own)] / stiffness_1_s[len(own) :, None]).real
        self.gain_um_per_v_s = _read_only(np.vstack((driven, pushed)))
        self.sensor = _true_sensor(wires.senses @ _sensor(settings, len(built_hz)), world.sensors)
        self.drive, self.sense = _read_only(wires.drive), _read_only(wires.sense)
        self.loop_phase_rad = (settings.loop_phase_rad,) * settings.driven_modes
        self.nominal_decay_1_s = _read_only(math.pi * driven_hz / settings.q_factor)
        self.nominal_detuning_rad_s = _read_only(2.0 * math.pi * (driven_hz - settings.drive_hz))
        self.nominal_gain_um_per_v_s = _read_only(wires.gain * own)
        self.finger_decay_1_s = world.finger_load.damping_factor * settings.finger_decay_1_s
        mass_ratio = settings.finger_decay_1_s / FINGER_DECAY_1_S  # a finger changes a heavier plate less
        self.finger_detuning_rad_s = 2.0 * math.pi * world.finger_load.detuning_hz * mass_ratio
        self._names = names
        self._grid, self._surfaces = true_grid(*disturbed), true_surfaces(*disturbed)

    @property
    def uncertainty(self) -> UncertaintyConfig:
        """Uncertainty of this plate: little, but where a world has errors what is configured for any."""
        return WELL_MEASURED if self.settings.world == NEUTRAL else UncertaintyConfig()

    def shapes(self, points_mm: npt.ArrayLike) -> FloatArray:
        """Return all modes (..., P) at points (..., 2); clamped to the plate's edge, zero where a coordinate is NaN."""
        points = np.asarray(points_mm, np.float64)
        return self._surfaces.evaluate(points.reshape(-1, 2)).reshape(*points.shape[:-1], len(self.decay_1_s))

    def drifted_rad_s(self, t_s: float) -> FloatArray:
        """Return the detunings (P,) at an instant."""
        drift_hz = np.zeros(len(self.detuning_rad_s))
        given_hz = self.settings.world.drift_hz[: len(drift_hz)]
        drift_hz[: len(given_hz)] = given_hz
        drifted: FloatArray = self.detuning_rad_s + 2.0 * math.pi * drift_hz * math.sin(2.0 * math.pi * t_s / DRIFT_S)
        return drifted + 2.0 * math.pi * self.settings.world.drift_hz_per_min * t_s / 60.0

    @property
    def drifts(self) -> bool:
        """Whether the detunings change with time."""
        return any(self.settings.world.drift_hz) or self.settings.world.drift_hz_per_min != 0.0

    def finger_load(self, t_s: FloatArray, finger: int) -> tuple[FloatArray, FloatArray]:
        """Return decay rate and detuning (T,) that a finger adds, per square of the shape under it."""
        share = self.settings.world.finger_load.force(self.settings.world.seed, finger, t_s)
        return self.finger_decay_1_s * share, self.finger_detuning_rad_s * share

    def true_mode_map(self, modes: int | None = None) -> ModeShapes:
        """Return the true shapes of the driven modes, as perfect knowledge has them, or of the first `modes`."""
        count = self.settings.driven_modes if modes is None else modes
        x_mm, y_mm, shapes = self._grid
        shown = shapes[:count]
        if modes is None and self._pushed is not None:
            shown = compensated(shown, shapes[count:], self._pushed)
        return ModeShapes(x_mm, y_mm, shown)

    def parasitic_modes(self, seed: int) -> ParasiticModes:
        """Return the measured parasitic modes: mode map and sweep.

        Its mode map has three times the noise, as the actuators hardly drive it.
        """
        settings = self.settings
        parasitic = slice(settings.driven_modes, None)
        return ParasiticModes(
            mode_map(settings.plate, *self.scan(seed, is_driven=False)),
            self.decay_1_s[parasitic].tolist(),
            self.detuning_rad_s[parasitic].tolist(),
        )

    def measured_mode_map(self, seed: int) -> ModeShapes:
        """Return the mode map of the driven modes: measured with the noise of `seed`, then fitted by `design`.

        Its scale is kept: sensors measure W during the vibrometer's measurement, so their ratio is the shape. There are
        SCANS of each plate; seeds repeat them. On a copy the motion of undriven modes is compensated.
        """
        driven = mode_map(self.settings.plate, *self.scan(seed, is_driven=True))
        if self._pushed is None:
            return driven
        others = mode_map(self.settings.plate, *self.scan(seed, is_driven=False))
        return ModeShapes(driven.x_mm, driven.y_mm, compensated(driven.shapes, others.shapes, self._pushed))

    def scan(self, seed: int, is_driven: bool) -> tuple[tuple[str, ...], ModeScan]:
        """Return modes and scan of a mode map."""
        settings, world = self.settings, self.settings.world
        first, end = (0, settings.driven_modes) if is_driven else (settings.driven_modes, None)
        noise_frac = (1.0 if is_driven else _PARASITIC_NOISE) * (settings.map_noise_frac + world.map_noise_frac)
        step_mm = settings.map_step_mm if world.map_step_mm is None else world.map_step_mm
        glue = world.glue_frac, world.seed if world.glue_frac else 0
        return self._names[first:end], ModeScan(step_mm, noise_frac, seed % SCANS, first, *glue)


def _built_hz(settings: PlateSettings) -> FloatArray:
    """Return the frequencies of all modes as built, before drift."""
    count = _LEAST_ALL if settings.driven_modes <= _SIZED_EACH else settings.driven_modes + LEAST_PARASITIC
    names = find_glass(settings.plate).modes[:count]
    theory_hz = np.array([theory(name, settings.plate)[0] for name in names])
    if settings.plate != REFERENCE:
        is_pair = np.isclose(theory_hz[:, None], theory_hz, rtol=1e-9)
        is_first = is_pair.argmax(axis=1) == np.arange(len(names))
        return theory_hz + np.where(is_pair.sum(axis=1) == 2, np.where(is_first, -_SPLIT_HZ, _SPLIT_HZ), 0.0)
    pair_hz = np.array((settings.f_x_hz, settings.f_y_hz))
    share = theory_hz / theory_hz[0]  # of the measured pair's frequency
    return np.concatenate((pair_hz, pair_hz * share[2], pair_hz.mean() * share[4:]))


def _amplifiers(settings: PlateSettings, driven_hz: FloatArray) -> tuple[FloatArray, tuple[float, ...]]:
    """Return each driven mode's gain by its own amplifier, and the amplitude (um) that `v_limit_v` holds."""
    decay_1_s = settings.sized_for_damping * math.pi * driven_hz / settings.q_factor
    stiffness_1_s = np.hypot(decay_1_s, 2.0 * math.pi * (driven_hz - settings.drive_hz))
    reach_um = np.broadcast_to(settings.w_limit_um, len(driven_hz))
    own = reach_um * stiffness_1_s / settings.v_limit_v
    if settings.plate == REFERENCE and settings.driven_modes <= _SIZED_EACH:
        return own, tuple(reach_um.tolist())
    resonant_um_per_v_s = reach_um * decay_1_s[0] / settings.v_limit_v
    alike = np.full(len(own), own[0]) if settings.plate == REFERENCE else resonant_um_per_v_s
    return alike, tuple((alike * settings.v_limit_v / stiffness_1_s).tolist())


def _sensor(settings: PlateSettings, modes: int) -> FloatArray:
    sensor = np.full((settings.driven_modes, modes), settings.parasitic_pickup)
    sensor[:, : settings.driven_modes] = settings.sensor_crosstalk
    np.fill_diagonal(sensor, 1.0)
    return sensor


def _true_sensor(exact: FloatArray, errors: SensorErrors) -> FloatArray | npt.NDArray[np.complex128]:
    if errors == NEUTRAL.sensors:
        return _read_only(exact)
    return np.asarray(errors.matrix(len(exact)) @ exact)


def _read_only(array: FloatArray) -> FloatArray:
    array.setflags(write=False)
    return array
