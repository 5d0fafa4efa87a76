"""Loads of a designed plate on glass, cooling, amplifiers and ears, each against a bound with its source.

Figures are of places at random, with the amplitudes and volts that the friction asked takes there. They follow from
mode shapes and small-signal values of the patches; nothing was measured.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..values import FloatArray
from . import legendre
from .felt_search import COUPLED_HZ, MOST_TURN_DEG, FeltDesign
from .materials import Material
from .mode_shape import ModeShape
from .patch_reach import TAN_DELTA, capacitance_f
from .section import wave_rad_mm

MOST_FRAC = 0.95  # of the places ask no more than what is stated
TOUGHENED_MPA = 70.0  # lasting load on thermally toughened glass, EN 16612: (120 - 45) / 1.2 + 0.29 * 45 / 1.8
AMPLIFIER_MA = 100.0  # peak, of the affordable ones
COOLING_W_M2_K = 10.0  # of each face: free convection and radiation, an estimate
DRIFT_HZ_K = 2.0  # at 29 kHz; an estimate
DRIFT_FRAC = 0.1  # of a mode's bandwidth: more is to be calibrated again
PUBLIC_DB = 100.0  # above 25 kHz, IRPA interim guidelines 1984, for the public
EAR_MM = 500.0
_AIR_KG_M3, _SOUND_M_S, _SILENT_PA = 1.2, 343.0, 20e-6


@dataclass(frozen=True, slots=True)
class Bound:
    """A figure of a plate, the most that it may be, and how both are known."""

    name: str
    value: float
    most: float
    unit: str
    known: str

    @property
    def is_kept(self) -> bool:
        """Whether the figure is within its bound."""
        return self.value <= self.most

    def __str__(self) -> str:
        """Return the bound as a line of a verdict."""
        verb = "within" if self.is_kept else "BEYOND"
        return f"{self.name}: {self.value:.3g} {self.unit}, {verb} {self.most:.3g} ({self.known})"


def bounds(design: FeltDesign, q_factor: float) -> tuple[Bound, ...]:
    """Return the figures of a plate and its patches."""
    plate = design.plate
    omega = 2.0 * math.pi * np.array(design.frequency_hz)
    mass_kg = np.array([shape.mass_kg for shape in design.shapes])
    stress_mpa_um = np.array([stress_mpa(shape, plate.thickness_mm, plate.material) for shape in design.shapes])
    square_um2 = design.modal_um**2
    speed2_m2_s2 = (0.5e-6 * omega) ** 2 / 2.0  # per um^2, in time
    farads = np.array([capacitance_f(patch) for patch in plate.patches])
    drive_1_s = 2.0 * math.pi * design.drive_hz
    moving_w = square_um2 @ (mass_kg * omega * speed2_m2_s2 / q_factor)
    ceramic_w = (design.patch_v**2 / 2.0) @ (farads * drive_1_s * TAN_DELTA)
    area_m2 = plate.size_mm[0] * plate.size_mm[1] * 1e-6
    warmer_k = float(np.mean(moving_w + ceramic_w)) / (2.0 * area_m2 * COOLING_W_M2_K)
    bandwidth_hz = design.drive_hz / q_factor
    heat_w = float(np.mean(moving_w)), float(np.mean(ceramic_w))
    return (
        Bound(
            "glass stress, all modes at their limits in one place",
            float(stress_mpa_um @ np.array(design.limits_um)),
            TOUGHENED_MPA,
            f"MPa ({most(design.modal_um @ stress_mpa_um):.2g} at {MOST_FRAC:.0%} of places)",
            f"computed, {stress_mpa_um.min():.2f} .. {stress_mpa_um.max():.2f} MPa per um of a mode; toughened glass, "
            "EN 16612",
        ),
        Bound(
            f"detuning by heat, {heat_w[0]:.2g} W in the plate and {heat_w[1]:.2g} W in the patches",
            warmer_k * DRIFT_HZ_K,
            DRIFT_FRAC * bandwidth_hz,
            "Hz",
            f"watts computed, {COOLING_W_M2_K:g} W/m2K and {DRIFT_HZ_K:g} Hz/K estimated; a tenth of f/Q",
        ),
        Bound(
            f"amplifier current at {MOST_FRAC:.0%} of places, peak",
            most((1e3 * drive_1_s * farads * design.patch_v).max(axis=1)),
            AMPLIFIER_MA,
            "mA",
            f"computed, {1e9 * farads.max():.2g} nF, at small fields; affordable amplifiers",
        ),
        Bound(
            f"turn of the closest modes, {design.closest_hz:.3g} Hz apart, into each other",
            design.turn_deg,
            MOST_TURN_DEG,
            "degrees",
            f"computed, where supports or a chip couple them by {COUPLED_HZ:g} Hz after the scan",
        ),
        Bound(
            f"airborne sound at {EAR_MM / 1e3:g} m",
            sound_db(design, square_um2.mean(axis=0) * speed2_m2_s2),
            PUBLIC_DB,
            "dB",
            "estimated, as of a plane radiator, in the mean over directions; IRPA 1984, public",
        ),
    )


def stress_mpa(shape: ModeShape, thickness_mm: float, material: Material) -> float:
    """Return the largest principal stress in the plate's faces per um, peak to peak, of a mode, in the mean over cells
    of half the thickness: a plate theory holds over no less, and at a patch's corners stress has no bound."""
    motion = shape.solved_motion
    counts = [max(round(2.0 * edge_mm / thickness_mm), 1) for edge_mm in shape.size_mm]
    cell_mm = [edge_mm / count for edge_mm, count in zip(shape.size_mm, counts, strict=True)]
    nodes = [
        legendre.values(np.linspace(-1.0, 1.0, count + 1), terms - 1)
        for count, terms in zip(counts, shape.coefficients.shape, strict=True)
    ]

    def slopes(field: FloatArray) -> tuple[FloatArray, FloatArray]:
        at = nodes[0] @ field @ nodes[1].T
        across, along = np.diff(at, axis=0) / cell_mm[0], np.diff(at, axis=1) / cell_mm[1]
        return (across[:, 1:] + across[:, :-1]) / 2.0, (along[1:] + along[:-1]) / 2.0

    nu, largest = material.poisson, 0.0
    for z_mm in (-thickness_mm / 2.0, thickness_mm / 2.0):
        (xx, xy), (yx, yy) = (slopes(motion[2 + axis] + z_mm * motion[axis]) for axis in (0, 1))
        mean, shear = (1.0 + nu) * np.abs(xx + yy) / 2.0, (1.0 - nu) * np.hypot((xx - yy) / 2.0, (xy + yx) / 2.0)
        largest = max(largest, float(np.max(mean + shear)))
    return material.young_gpa / (1.0 - nu**2) * largest * 1e3 * 0.5e-3  # GPa to MPa, half a um in mm


def sound_db(design: FeltDesign, speed2_m2_s2: FloatArray) -> float:
    """Return the level at EAR_MM, from the mean squares (M,) of the modes' speeds where they are largest.

    Bending waves faster than sound radiate as a plane does, and 1 / sqrt(1 - (c / c_b)^2) more (L. Cremer and
    M. Heckl, Structure-Borne Sound, ch. 6); the power of one face is spread over a hemisphere.
    """
    plate = design.plate
    rad_m = 1e3 * wave_rad_mm(design.drive_hz, plate.thickness_mm, plate.material)
    bending_m_s = 2.0 * math.pi * design.drive_hz / rad_m
    if bending_m_s <= _SOUND_M_S:
        return -math.inf
    mean = np.array([np.sum(shape.coefficients**2) / 4.0 for shape in design.shapes])
    area_m2 = plate.size_mm[0] * plate.size_mm[1] * 1e-6
    impedance = _AIR_KG_M3 * _SOUND_M_S
    radiated_w = impedance * area_m2 * float(mean @ speed2_m2_s2) / math.sqrt(1.0 - (_SOUND_M_S / bending_m_s) ** 2)
    intensity_w_m2 = radiated_w / (2.0 * math.pi * (EAR_MM * 1e-3) ** 2)
    return 10.0 * math.log10(intensity_w_m2 * impedance / _SILENT_PA**2)


def most(values: FloatArray) -> float:
    """Return what MOST_FRAC of the places need at most."""
    return float(np.quantile(values, MOST_FRAC))
