"""Effect of patches on the modes: force, modal mass, volts, reach, and current of their amplifiers.

A patch pulls at its edges with the force N V per length (Crawley and de Luis, AIAA J. 25 (1987) 1373), so it drives a
mode by N V times the stretch of its area (`patch_places.couplings`), with N = |d31| Y / (1 - nu). In the rotating frame
a mode's amplitude (peak to peak) follows

    dW/dt = (-sigma + j delta) W - j sum_p g_p V_p,    g_p = 2 force per volt / (2 m omega),    sigma = pi f / Q

with m the mode's mass, patches included. The board has an amplifier and a patch for each
mode, so one combination of volts moves a mode and leaves the others at rest: columns of the inverse of g. *The reach
of a mode* is its amplitude when the patch that needs most for it has its largest voltage. Modes that move together
share the patches, whose volts add up: `patch_volts_v`.

A free patch is a plate capacitor; glued, its planar motion is held, and it has CLAMPED_FRAC of that. An amplifier
drives that capacitance and, on top, the charge that the moving modes bring to the electrodes: by reciprocity as many
coulombs per metre as the patch has newtons per volt. All at small fields: permittivity and losses of soft PZT grow with
the field, and a soft or incomplete bond lets the capacitance rise towards the free one.

Left out: the glue, hysteresis (real amplitudes per volt are larger at high fields), and the change of d31 with field.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..values import ComplexArray, FloatArray
from .glued_plate import Patch
from .mode_shape import ModeShape
from .patch_places import couplings

D31_M_V = 180e-12  # PIC255 (PI Ceramic, material data), at small fields
FIELD_V_MM = 300.0  # across soft PZT, driven to both sides: a third of its coercive field
AMPLIFIER_V = 150.0
PERMITTIVITY, CLAMPED_FRAC, TAN_DELTA = 1750.0, 0.6, 0.02  # PIC255 (PI Ceramic, material data), at small fields
_VACUUM_F_M = 8.854e-12


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
    patches: Sequence[Patch],
    modes: Sequence[tuple[float, ModeShape]],
    q_factor: float,
) -> PatchDrive:
    """Return what the patches do to the plate's `modes`, (frequency_hz, shape) each."""
    frequency_hz = np.array([hz for hz, _ in modes])
    shapes = [shape for _, shape in modes]
    mass_kg = np.array([shape.mass_kg for shape in shapes])
    gain = 2e6 * forces_n_v(thickness_mm, patches, shapes) / (2.0 * mass_kg * 2.0 * math.pi * frequency_hz)[:, None]
    most_v = np.array([most_volts_v(patch) for patch in patches])
    return PatchDrive(frequency_hz, math.pi * frequency_hz / q_factor, gain, most_v)


def forces_n_v(thickness_mm: float, patches: Sequence[Patch], shapes: Sequence[ModeShape]) -> FloatArray:
    """Return the force (M, P) by which a volt on each patch drives each mode, and the coulombs per m that it gives."""
    along_n_m_v = np.array([D31_M_V * one.material.young_gpa * 1e9 / (1.0 - one.material.poisson) for one in patches])
    height_mm = [(thickness_mm + one.thickness_mm) / 2.0 for one in patches]
    places_mm, sizes_mm = (np.array(of) for of in ([(p.x_mm, p.y_mm) for p in patches], [p.size_mm for p in patches]))
    return np.asarray(along_n_m_v * couplings(shapes, places_mm, sizes_mm, height_mm) * 1e-3)


def most_volts_v(patch: Patch) -> float:
    """Return the voltage to which a patch may be driven, peak: by the amplifier, or by its field."""
    return min(AMPLIFIER_V, FIELD_V_MM * patch.thickness_mm)


@dataclass(frozen=True, slots=True)
class PatchLoad:
    """A glued patch that is driven by a sine of `volts_v`, peak, at `drive_hz`; the modes at rest."""

    free_nf: float
    glued_nf: float
    volts_v: float
    peak_ma: float
    rms_ma: float
    apparent_va: float
    loss_w: float
    slew_v_us: float


def patch_load(patch: Patch, drive_hz: float, volts_v: float | None = None) -> PatchLoad:
    """Return what a patch asks of its amplifier; without `volts_v` at the most that it may have."""
    most_v = most_volts_v(patch) if volts_v is None else volts_v
    omega = 2.0 * math.pi * drive_hz
    peak_a = omega * capacitance_f(patch) * most_v
    apparent_va = peak_a * most_v / 2.0
    return PatchLoad(
        free_nf=1e9 * capacitance_f(patch) / CLAMPED_FRAC,
        glued_nf=1e9 * capacitance_f(patch),
        volts_v=most_v,
        peak_ma=1e3 * peak_a,
        rms_ma=1e3 * peak_a / math.sqrt(2.0),
        apparent_va=apparent_va,
        loss_w=apparent_va * TAN_DELTA,
        slew_v_us=omega * most_v * 1e-6,
    )


def capacitance_f(patch: Patch) -> float:
    """Return a glued patch's capacitance."""
    area_m2 = patch.size_mm[0] * patch.size_mm[1] * 1e-6
    return CLAMPED_FRAC * PERMITTIVITY * _VACUUM_F_M * area_m2 / (patch.thickness_mm * 1e-3)


def charge_nc_um(thickness_mm: float, patches: Sequence[Patch], shapes: Sequence[ModeShape]) -> FloatArray:
    """Return the charge (M modes, P patches), peak, that 1 um peak to peak of each mode brings to each patch, in nC."""
    return np.asarray(0.5e3 * np.abs(forces_n_v(thickness_mm, patches, shapes)))


def moving_ma(charge: FloatArray, drive_hz: float, amplitudes_um: FloatArray) -> FloatArray:
    """Return the most current, peak, that moving modes bring to each patch (P,), all at their amplitudes (M,)."""
    return np.asarray(2e-6 * math.pi * drive_hz * (amplitudes_um @ charge))
