"""A constant friction, by the amplitude that gives it."""

from __future__ import annotations

from hapticd_contract.contents import Friction

from .texture import NO_DETAIL, Texture, constant

TEXTURE = Texture(
    Friction,
    amplitude=lambda target, plate: constant(min(plate.curve.amplitude_um(target.friction), plate.w_limit_um)),
    detail=lambda _target, _size_mm: NO_DETAIL,
    highest_um=lambda target, curve: curve.amplitude_um(target.friction),
    asks_for_friction=lambda _target: True,
    fills_shape=False,
)
