"""A constant amplitude."""

from __future__ import annotations

from ....content_values import AmplitudeTarget
from .texture import NO_DETAIL, Texture, constant

TEXTURE = Texture(
    AmplitudeTarget,
    amplitude=lambda target, plate: constant(min(target.amplitude_um, plate.w_limit_um)),
    detail=lambda _target, _size_mm: NO_DETAIL,
    highest_um=lambda target, _curve: target.amplitude_um,
    cost_ns=lambda _target: 60.0,
    asks_for_friction=lambda _target: False,
    fills_shape=False,
)
