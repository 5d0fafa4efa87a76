"""A constant friction, by the amplitude that gives it."""

from __future__ import annotations

from ....content_values import FrictionTarget
from .texture import NO_DETAIL, Texture, constant

TEXTURE = Texture(
    FrictionTarget,
    amplitude=lambda target, plate: constant(min(plate.curve.amplitude_um(target.friction_frac), plate.w_limit_um)),
    detail=lambda _target, _size_mm: NO_DETAIL,
    highest_um=lambda target, curve: curve.amplitude_um(target.friction_frac),
    cost_ns=lambda _target: 60.0,
    asks_for_friction=lambda _target: True,
    fills_shape=False,
)
