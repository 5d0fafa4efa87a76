"""A constant amplitude."""

from __future__ import annotations

from hapticd_contract.contents import Amplitude

from .texture import NO_DETAIL, Texture, constant

TEXTURE = Texture(
    Amplitude,
    amplitude=lambda target, plate: constant(min(target.amplitude_um, plate.w_limit_um)),
    detail=lambda _target, _size_mm: NO_DETAIL,
    highest_um=lambda target, _curve: target.amplitude_um,
    asks_for_friction=lambda _target: False,
    fills_shape=False,
)
