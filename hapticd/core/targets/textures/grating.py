"""A grating along a direction: a sine between two amplitudes, or stripes with edges."""

from __future__ import annotations

import math

from hapticd_contract.contents import Grating

from .texture import FAR_MM, NO_DETAIL, PIECES_PER_WAVE, AmplitudeAt, Detail, Texture, TexturePlate


def _amplitude(grating: Grating, _plate: TexturePlate) -> AmplitudeAt:
    return _sine(grating) if grating.duty_frac == 0.0 else _stripes(grating)


def _sine(grating: Grating) -> AmplitudeAt:
    along_x, along_y = math.cos(grating.angle_rad), math.sin(grating.angle_rad)
    mean_um = 0.5 * (grating.low_um + grating.high_um)
    half_um = 0.5 * (grating.high_um - grating.low_um)
    wavenumber = 2.0 * math.pi / grating.period_mm
    low_um, cos = grating.low_um, math.cos

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        along_mm = x_mm * along_x + y_mm * along_y
        if not -FAR_MM <= along_mm <= FAR_MM:
            return low_um
        return mean_um + half_um * cos(wavenumber * along_mm)

    return amplitude_um


def _stripes(grating: Grating) -> AmplitudeAt:
    along_x, along_y = math.cos(grating.angle_rad), math.sin(grating.angle_rad)
    period_mm, half_crest_mm = grating.period_mm, 0.5 * grating.duty_frac * grating.period_mm
    low_um, high_um, remainder = grating.low_um, grating.high_um, math.remainder

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        along_mm = x_mm * along_x + y_mm * along_y
        if not -FAR_MM <= along_mm <= FAR_MM:
            return low_um
        return high_um if abs(remainder(along_mm, period_mm)) <= half_crest_mm else low_um

    return amplitude_um


def _detail(grating: Grating, _size_mm: tuple[float, float]) -> Detail:
    period_mm, duty_frac = grating.period_mm, grating.duty_frac
    if duty_frac == 0.0:
        return Detail(period_mm / PIECES_PER_WAVE, True)
    return NO_DETAIL if duty_frac == 1.0 else Detail(min(duty_frac, 1.0 - duty_frac) * period_mm, False)


TEXTURE = Texture(
    Grating,
    amplitude=_amplitude,
    detail=_detail,
    highest_um=lambda grating, _curve: max(grating.low_um, grating.high_um),
    asks_for_friction=lambda _grating: False,
    fills_shape=False,
)
