"""The truth of the simulated plate: what the plate does, as against what the daemon knows of it.

Its P = 4 modes, in this order: X and Y, which are driven, and the pair that theory puts 84 Hz above them (9 x 6
nodal lines), which nobody asked for unless the first of it is driven as a third mode. In the rotating frame of the
drive each follows

    dW/dt = (-decay + j detuning) W - j gain V - (what the fingers take)

with V (M,) the complex actuator voltages. The daemon never sees any of this: it gets `cartography`, a noisy scan of
the driven modes with the usual fit, and what the sensors show, which is not quite W either.

Left out: every other mode (the nearest lies 154 Hz above: 11 x 1 lines), other modes showing in the vibrometer's
scan of X and Y, what glued actuators and supports do to the shapes, hysteresis and heating of the actuators, and a
finger's inertia and stiffness (it damps and couples modes, it does not detune them).

Sources: the paper, sections II and III (frequencies, sizes, limits) and eq. 5-6; `design.free_plate` for the shapes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from hapticd.core.plate.mode_shapes import BicubicSurfaces, ModeShapes
from hapticd.core.plate.parasitic_modes import ParasiticModes
from hapticd.design import fit_cartography, sample_cartography

from . import shapes as plate_shapes

FloatArray = npt.NDArray[np.float64]

DRIVEN_MODES = ("11x0", "0x11")  # X and Y: the shapes vary along x and along y
PARASITIC_MODES = ("9x6", "6x9")
MODES: tuple[str, ...] = (*DRIVEN_MODES, *PARASITIC_MODES)
_NEIGHBOUR_NOISE = 3.0  # of their scan, against that of the driven modes
_FINGER_DECAY_FOUND = 0.87  # a finger's damping as the laboratory measured it, as a share of what fingers do
_TABLE_POINTS = 161  # per axis: the interpolated shapes are within 1e-4 of the theory's
_POSITIVE = {"f_x_hz", "f_y_hz", "drive_hz", "q_factor", "w_limit_um", "v_limit_v", "damping_factor"}
_POSITIVE |= {"map_step_mm", "sized_for_damping"}
_NOT_NEGATIVE = {"finger_decay_1_s", "sensor_noise_um", "map_noise_frac"}


@dataclass(frozen=True, slots=True)
class PlateSettings:
    """The simulated plate, as built (first two groups) and as it is on the day (third).

    `finger_decay_1_s` is what one finger adds to a mode's decay rate times the square of the shape under it. At
    115 1/s two fingers, both on antinodes inside the plate (phi^2 about 0.4), raise the reference decay of 183 1/s to
    1.5 times, the most that the firmware's control is specified for; two fingers anywhere (phi^2 = 0.124 on average)
    to 1.16 times. No measurement of this plate exists.
    `sized_for_damping` follows the paper, which found W_LIM = 4 um to be what its amplifiers give *in use*, with a
    finger on the plate; 1 sizes them for the bare plate.
    `parasitic_offset_hz` is the distance between the two pairs' centres; None takes the theory's.
    `shapes` is one of `plate_shapes.KINDS`: of what shape, and so where on the plate `w_limit_um` is moved.
    `driven_modes` is 2, or 3 where the first of the neighbouring pair has an amplifier and a sensor too.
    """

    f_x_hz: float = 29195.0
    f_y_hz: float = 29215.0
    drive_hz: float = 29205.0
    q_factor: float = 500.0
    parasitic_offset_hz: float | None = None
    finger_decay_1_s: float = 115.0
    shapes: str = plate_shapes.FREE_PLATE
    driven_modes: int = 2

    w_limit_um: float = 4.0
    v_limit_v: float = 150.0
    sized_for_damping: float = 1.5  # `v_limit_v` holds `w_limit_um` at this many times the undamped plate's decay
    parasitic_coupling: float = 0.02  # of each actuator into each neighbour mode, as a share of its own mode's gain
    sensor_crosstalk: float = 0.01  # of Y in the sensor of X, and the other way round
    parasitic_pickup: float = 0.01  # of each neighbour mode in each sensor
    sensor_noise_um: float = 0.0006
    loop_phase_rad: float = 0.0  # what amplifiers, electrodes and sensors add, the same in both loops

    detune_hz: float = 0.0  # all modes drift together, as with temperature
    damping_factor: float = 1.0

    map_step_mm: float = 4.5
    map_noise_frac: float = 0.02

    def __post_init__(self) -> None:
        if self.shapes not in plate_shapes.KINDS:
            raise ValueError(f"PlateSettings.shapes is {self.shapes!r}; choose from {', '.join(plate_shapes.KINDS)}.")
        if self.driven_modes not in (2, 3):
            raise ValueError(f"PlateSettings.driven_modes is {self.driven_modes}; give 2 or 3.")
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, str) or (value is None and field.name == "parasitic_offset_hz"):
                continue
            if not math.isfinite(value):
                raise ValueError(f"PlateSettings.{field.name} is {value}; give a finite number.")
            if field.name in _POSITIVE and not value > 0.0:
                raise ValueError(f"PlateSettings.{field.name} is {value}; give a positive number.")
            if field.name in _NOT_NEGATIVE and not value >= 0.0:
                raise ValueError(f"PlateSettings.{field.name} is {value}; give zero or a positive number.")


class GroundTruth:
    """The plate's own modes for the board model: arrays for P = 4 modes and M actuators and sensors, read-only.

    `frequency_hz`, `decay_1_s`, `detuning_rad_s` (P,): pi f / Q times the damping factor, and 2 pi (f - drive).
    `gain_um_per_v_s` (P, M): such that, damped as it is sized for and not drifted, `v_limit_v` just holds `w_limit_um`.
    `nominal_decay_1_s`, `nominal_detuning_rad_s`, `nominal_gain_um_per_v_s` (M,): what a sweep of the bare plate finds
    of the driven modes, and the board's firmware is told.
    `sensor` (M, P): what each sensor shows of each mode. `loop_phase_rad` (M,): the constant phase of each loop.
    `finger_decay_1_s`: what a finger adds to a mode's decay times the square of the shape under it, in these units.
    """

    def __init__(self, settings: PlateSettings | None = None) -> None:
        self.settings = settings = PlateSettings() if settings is None else settings
        offset_hz = settings.parasitic_offset_hz
        offset_hz = _theory_offset_hz() if offset_hz is None else offset_hz
        # What splits the first pair (the plate is not quite square) splits the second as well.
        pair_hz = np.array((settings.f_x_hz, settings.f_y_hz))
        built_hz = np.concatenate((pair_hz, pair_hz + offset_hz))
        driven_hz = built_hz[: settings.driven_modes]
        self.frequency_hz = _read_only(built_hz + settings.detune_hz)
        self.decay_1_s = _read_only(math.pi * self.frequency_hz / settings.q_factor * settings.damping_factor)
        self.detuning_rad_s = _read_only(2.0 * math.pi * (self.frequency_hz - settings.drive_hz))
        self.gain_um_per_v_s = _read_only(_gain_um_per_v_s(settings, driven_hz, len(built_hz)))
        self.sensor = _read_only(_sensor(settings, len(built_hz)))
        self.loop_phase_rad = (settings.loop_phase_rad,) * settings.driven_modes
        self.nominal_decay_1_s = _read_only(math.pi * driven_hz / settings.q_factor)
        self.nominal_detuning_rad_s = _read_only(2.0 * math.pi * (driven_hz - settings.drive_hz))
        self.nominal_gain_um_per_v_s = _read_only(np.diag(self.gain_um_per_v_s).copy())
        peak = 1.0 if settings.shapes == plate_shapes.FREE_PLATE else plate_shapes.peak_at_fingers()
        self.finger_decay_1_s = peak**2 * settings.finger_decay_1_s
        self._surfaces = _true_surfaces(settings.shapes)

    def shapes(self, points_mm: npt.ArrayLike) -> FloatArray:
        """All modes (..., P) at points (..., 2): the plate's edge beyond it, zeros where a coordinate is NaN."""
        points = np.asarray(points_mm, np.float64)
        return self._surfaces.evaluate(points.reshape(-1, 2)).reshape(*points.shape[:-1], len(self.decay_1_s))

    def parasitic_modes(self, seed: int) -> ParasiticModes:
        """What a laboratory learns of the neighbouring pair: a scan at its own resonance, with three times the noise,
        for the actuators hardly reach it; a sweep; and how one finger damps, to within an eighth."""
        settings = self.settings
        beside = slice(settings.driven_modes, None)
        return ParasiticModes(
            self._scanned(MODES[beside], _NEIGHBOUR_NOISE * settings.map_noise_frac, seed),
            self.decay_1_s[beside].tolist(),
            self.detuning_rad_s[beside].tolist(),
            _FINGER_DECAY_FOUND * self.finger_decay_1_s,
        )

    def measured_mode_map(self, seed: int) -> ModeShapes:
        """The map of the driven modes for the daemon: a scan with the noise of `seed`, then `design.fit_cartography`.

        The scan's own scale is kept: the sensors tell W while the vibrometer reads, so their ratio is the shape.
        """
        return self._scanned(MODES[: self.settings.driven_modes], self.settings.map_noise_frac, seed)

    def _scanned(self, names: tuple[str, ...], noise_frac: float, seed: int) -> ModeShapes:
        return _cartography(self.settings.shapes, names, self.settings.map_step_mm, noise_frac, seed)


def _gain_um_per_v_s(settings: PlateSettings, driven_hz: FloatArray, modes: int) -> FloatArray:
    """g = w_limit |decay - j detuning| / v_limit on the driven modes; a share of it leaks into the parasitic_modes."""
    decay_1_s = settings.sized_for_damping * math.pi * driven_hz / settings.q_factor
    detuning_rad_s = 2.0 * math.pi * (driven_hz - settings.drive_hz)
    own = settings.w_limit_um * np.hypot(decay_1_s, detuning_rad_s) / settings.v_limit_v
    leaked = settings.parasitic_coupling * own
    return np.vstack((np.diag(own), *[leaked] * (modes - len(own))))


def _sensor(settings: PlateSettings, modes: int) -> FloatArray:
    shown = np.full((settings.driven_modes, modes), settings.parasitic_pickup)
    shown[:, : settings.driven_modes] = settings.sensor_crosstalk
    np.fill_diagonal(shown, 1.0)
    return shown


def _theory_offset_hz() -> float:
    return plate_shapes.theory(PARASITIC_MODES[0])[0] - plate_shapes.theory(DRIVEN_MODES[0])[0]


@lru_cache(maxsize=len(plate_shapes.KINDS))
def _true_surfaces(kind: str) -> BicubicSurfaces:
    """The four shapes, tabulated: summing their Legendre series at every point takes several times as long."""
    shapes = plate_shapes.shapes(kind, MODES)
    x_mm, y_mm = (np.linspace(-edge_mm / 2.0, edge_mm / 2.0, _TABLE_POINTS) for edge_mm in shapes[0].size_mm)
    return BicubicSurfaces(x_mm, y_mm, np.stack([shape.on_grid(x_mm, y_mm) for shape in shapes]))


@lru_cache(maxsize=16)
def _cartography(kind: str, names: tuple[str, ...], step_mm: float, noise_frac: float, seed: int) -> ModeShapes:
    scanned = plate_shapes.shapes(kind, names)
    x_mm, y_mm, shapes = sample_cartography(scanned, step_mm=step_mm, noise_frac=noise_frac, seed=seed)
    return fit_cartography(x_mm, y_mm, shapes, size_mm=scanned[0].size_mm, normalise=False).modes


def _read_only(array: FloatArray) -> FloatArray:
    array.setflags(write=False)
    return array
