"""An amplitude that changes linearly along a direction, and is constant beyond."""

from __future__ import annotations

import math

from hapticd_contract.contents import Gradient

from .texture import AmplitudeAt, Detail, Texture, TexturePlate


def _amplitude(gradient: Gradient, _plate: TexturePlate) -> AmplitudeAt:
    along_x, along_y = math.cos(gradient.angle_rad), math.sin(gradient.angle_rad)
    length_mm, from_um, to_um = gradient.length_mm, gradient.from_um, gradient.to_um

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        share = (x_mm * along_x + y_mm * along_y) / length_mm + 0.5
        if not share > 0.0:  # NaN too
            return from_um
        return from_um * (1.0 - share) + to_um * share if share < 1.0 else to_um

    return amplitude_um


TEXTURE = Texture(
    Gradient,
    amplitude=_amplitude,
    detail=lambda gradient, _size_mm: Detail(gradient.length_mm, False),
    highest_um=lambda gradient, _curve: max(gradient.from_um, gradient.to_um),
    asks_for_friction=lambda _gradient: False,
    fills_shape=False,
)
