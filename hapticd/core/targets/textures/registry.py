"""The texture of a target: as amplitude in um over plate mm, friction turned into amplitude, and what it takes.

Each class of `Content` has its texture in the file of its name in messages: Grating's is TEXTURE of `grating.py`. They
are found when this module is imported, which fails where one is missing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from importlib import import_module
from typing import Any, Final

from hapticd_contract.contents import NAMES, Content

from ...friction import FrictionCurve
from .texture import NO_DETAIL, AmplitudeAt, Detail, Texture, TexturePlate

FINEST_MM: Final = 1e-3


class Sliding:
    """Factor by which a friction needs more amplitude at the speed of the finger that is looked up next."""

    def __init__(self) -> None:
        self.gain = 1.0


def found(names: Mapping[type, str]) -> dict[type, Texture[Any]]:
    """Return the texture of each class of target. Raises ImportError where a file, or the right TEXTURE in it, is
    missing."""
    textures: dict[type, Texture[Any]] = {}
    for kind, name in names.items():
        module = import_module(f"{__package__}.{name.removesuffix('_um')}")
        texture = getattr(module, "TEXTURE", None)
        if not isinstance(texture, Texture) or texture.target is not kind:
            raise ImportError(f"{module.__name__}: TEXTURE must be the Texture of {kind.__name__}.")
        textures[kind] = texture
    return textures


_TEXTURES: Final = found(NAMES)


def detail(target: Content | None, size_mm: tuple[float, float]) -> Detail:
    """Return how finely a target's texture must be sampled; what is finer than FINEST_MM is not felt."""
    if target is None:
        return NO_DETAIL
    fine = _TEXTURES[type(target)].detail(target, size_mm)
    return fine if fine.finest_mm >= FINEST_MM else Detail(FINEST_MM, fine.smooth)


def highest_um(target: Content, curve: FrictionCurve) -> float:
    """The largest amplitude that a target can ask for anywhere."""
    return _TEXTURES[type(target)].highest_um(target, curve)


def fills_shape(target: Content) -> bool:
    """Return whether a texture is spread over the shape of its surface."""
    return _TEXTURES[type(target)].fills_shape


def refusal(target: Content, curve: FrictionCurve, w_limit_um: float) -> str:
    """Return why a target asks for too much; empty if it does not. A friction asks for as much as the plate can do."""
    texture = _TEXTURES[type(target)]
    asked_um = texture.highest_um(target, curve)
    if asked_um <= w_limit_um or texture.asks_for_friction(target):
        return ""
    return f"cannot have {asked_um:g} um: ask for at most {w_limit_um:g} um."


def amplitude(
    target: Content,
    curve: FrictionCurve,
    size_mm: tuple[float, float],
    w_limit_um: float = math.inf,
    sliding: Sliding | None = None,
) -> AmplitudeAt:
    """The target as amplitude in um over plate position in mm; frictions that need more than the limit get that.

    Where the curve depends on speed, frictions get the amplitude for that of `sliding`.
    """
    texture = _TEXTURES[type(target)]
    at_rest = texture.amplitude(target, TexturePlate(curve, size_mm, w_limit_um))
    if sliding is None or curve.speed_mm_s == math.inf or not texture.asks_for_friction(target):
        return at_rest
    return lambda x_mm, y_mm: min(at_rest(x_mm, y_mm) * sliding.gain, w_limit_um)
