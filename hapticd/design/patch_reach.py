"""Reach of each mode by the patches that drive it: force, modal mass, volts.

A patch bends the plate by a moment N V that is uniform over it (Crawley and de Luis, AIAA J. 25 (1987) 1373), so it
drives a mode of shape phi by the force

    N V integral of (phi_xx + phi_yy) over the patch,    N = |d31| Y / (1 - nu) z

where z is from the neutral axis of plate and patch to the middle of the patch, nearly half the plate's thickness: N
hardly depends on that of the patch. In the rotating frame a mode's amplitude (peak to peak) follows

    dW/dt = (-sigma + j delta) W - j sum_p g_p V_p,    g_p = 2 force per volt / (2 m omega),    sigma = pi f / Q

with m the integral of the mass per area times phi^2, patches included. The board has an amplifier and a patch for each
mode, so one combination of volts moves a mode and leaves the others at rest: columns of the inverse of g. *The reach
of a mode* is its amplitude when the patch that needs most for it has its largest voltage. Modes that move together
share the patches, whose volts add up: `patch_volts_v`.

Left out: the glue, hysteresis (real amplitudes per volt are larger at high fields), and the change of d31 with field.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..values import ComplexArray, FloatArray
from .free_plate import ModeShape
from .glued_plate import Patch, neutral_axis_mm
from .materials import Material
from .patch_places import couplings

D31_M_V = 180e-12  # PIC255 (PI Ceramic, material data), at small fields
FIELD_V_MM = 300.0  # across soft PZT, driven to both sides: a third of its coercive field
AMPLIFIER_V = 150.0
_GAUSS_POINTS = 12


class UndrivenError(ValueError):
    """Some combination of modes is out of the patches' reach."""


@dataclass(frozen=True, slots=True)
class PatchDrive:
    """Modes (M,) driven by as many patches: `gain_um_per_v_s` (M modes, M patches), `decay_1_s` and `frequency_hz`
    (M,), `most_v` (M patches)."""

    frequency_hz: FloatArray
    decay_1_s: FloatArray
    gain_um_per_v_s: FloatArray
    most_v: FloatArray

    def of(self, modes: npt.NDArray[np.intp]) -> PatchDrive:
        """Return the same modes in another order."""
        return PatchDrive(self.frequency_hz[modes], self.decay_1_s[modes], self.gain_um_per_v_s[modes], self.most_v)

    @property
    def volts_per_um_s(self) -> FloatArray:
        """Return the volts (M patches, M modes) for a mode alone, per um and 1/s of its `stiffness_1_s`."""
        return np.asarray(np.linalg.inv(self.gain_um_per_v_s))

    def stiffness_1_s(self, drive_hz: float) -> ComplexArray:
        """Return sigma - j delta of each mode (M,)."""
        return np.asarray(self.decay_1_s - 2j * math.pi * (self.frequency_hz - drive_hz))

    def reach_um(self, drive_hz: float) -> FloatArray:
        """Return the reach of each mode (M,), in um peak to peak, at this drive frequency."""
        volts_per_um = np.abs(self.volts_per_um_s) * np.abs(self.stiffness_1_s(drive_hz))
        return np.asarray(1.0 / (volts_per_um / self.most_v[:, None]).max(axis=0))

    def patch_volts_v(
        self, modal_um: ComplexArray, drive_hz: float, rates_um_s: ComplexArray | float = 0.0
    ) -> FloatArray:
        """Return the voltage (M patches, n) that holds the amplitudes (M modes, n) of all modes together, or changes
        them at `rates_um_s`."""
        needed = self.stiffness_1_s(drive_hz)[:, None] * modal_um + rates_um_s
        return np.asarray(np.abs(self.volts_per_um_s @ needed))


def patch_drive(
    thickness_mm: float,
    material: Material,
    patches: Sequence[Patch],
    modes: Sequence[tuple[float, ModeShape]],
    q_factor: float,
) -> PatchDrive:
    """Return what the patches do to the plate's `modes`, (frequency_hz, shape) each."""
    frequency_hz = np.array([hz for hz, _ in modes])
    shapes = [shape for _, shape in modes]
    areal_kg_m2 = material.density_kg_m3 * thickness_mm * 1e-3
    mass_kg = np.array([modal_mass_kg(shape, areal_kg_m2, patches) for shape in shapes])
    bending_n_v = np.array([moment_n_v(thickness_mm, material, patch) for patch in patches])
    places_mm = np.array([(patch.x_mm, patch.y_mm) for patch in patches])
    curvature = couplings(shapes, places_mm, np.array([patch.size_mm for patch in patches]))
    gain = 2e6 * bending_n_v * curvature / (2.0 * mass_kg * 2.0 * math.pi * frequency_hz)[:, None]
    most_v = np.array([most_volts_v(patch) for patch in patches])
    return PatchDrive(frequency_hz, math.pi * frequency_hz / q_factor, gain, most_v)


def moment_n_v(thickness_mm: float, material: Material, patch: Patch) -> float:
    """Return N, the moment per length and volt: 25.4 mN/V for PIC255 on 3 mm of glass."""
    ceramic = patch.material
    z_mm = thickness_mm + patch.thickness_mm / 2.0 - neutral_axis_mm(material, thickness_mm, patch)
    return D31_M_V * ceramic.young_gpa * 1e9 / (1.0 - ceramic.poisson) * z_mm * 1e-3


def most_volts_v(patch: Patch) -> float:
    """Return the voltage to which a patch may be driven, peak: by the amplifier, or by its field."""
    return min(AMPLIFIER_V, FIELD_V_MM * patch.thickness_mm)


def modal_mass_kg(shape: ModeShape, areal_kg_m2: float, patches: Sequence[Patch]) -> float:
    """Return the mass of a mode whose largest displacement is its coordinate, patches included."""
    width_mm, depth_mm = shape.size_mm
    plate_mm2 = width_mm * depth_mm / 4.0 * float(np.sum(shape.coefficients**2))  # the polynomials are orthonormal
    added = sum(p.material.density_kg_m3 * p.thickness_mm * 1e-3 * _square_mm2(shape, p) for p in patches)
    return (areal_kg_m2 * plate_mm2 + added) * 1e-6


def _square_mm2(shape: ModeShape, patch: Patch) -> float:
    """Return the integral of the shape's square over a patch."""
    points, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    x_mm, y_mm = (
        middle_mm + side_mm / 2.0 * points
        for middle_mm, side_mm in zip((patch.x_mm, patch.y_mm), patch.size_mm, strict=True)
    )
    mean = weights @ shape.on_grid(x_mm, y_mm) ** 2 @ weights / 4.0
    return float(mean) * patch.size_mm[0] * patch.size_mm[1]
