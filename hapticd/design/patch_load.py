"""What a patch asks of its amplifier, and what it gives a preamplifier: capacitance, current, power, charge.

A free patch is a plate capacitor; glued, its planar motion is held, and it has CLAMPED_FRAC of that. An amplifier
drives that capacitance and, on top, the charge that the moving modes bring to the electrodes: by reciprocity as many
coulombs per metre as the patch has newtons per volt (`patch_reach`). All at small fields: permittivity and losses
of soft PZT grow with the field, and a soft or incomplete bond lets the capacitance rise towards the free one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..values import FloatArray
from .glued_plate import Patch
from .mode_shape import ModeShape
from .patch_reach import forces_n_v, most_volts_v

PERMITTIVITY, CLAMPED_FRAC, TAN_DELTA = 1750.0, 0.6, 0.02  # PIC255 (PI Ceramic, material data), at small fields
_VACUUM_F_M = 8.854e-12


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
