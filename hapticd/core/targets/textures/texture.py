"""What everybody must know of a texture: the interface of the files in this folder.

The amplitude is a function that is made once per request and called at every knot: plain arithmetic, about a
microsecond. It is finite and within the target's two amplitudes for every finite position; NaN and positions far from
any plate give what silence would.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, Generic, NamedTuple, TypeVar

from hapticd_contract.contents import Content

from ...friction import FrictionCurve

FAR_MM: Final = 1e6  # no plate is that large: beyond, a wave's phase is rounding noise
PIECES_PER_WAVE: Final = 4.0  # a smooth wave shows its curvature in the middle of a quarter of it

AmplitudeAt = Callable[[float, float], float]  # um over plate mm
T = TypeVar("T", bound=Content)


class Detail(NamedTuple):
    """How finely a texture must be sampled along a path: its corners lie at least `finest_mm` apart; a `smooth` one has
    none."""

    finest_mm: float
    smooth: bool


NO_DETAIL = Detail(math.inf, True)


class TexturePlate:
    """The plate under a texture: its friction, over which size a map is spread, and the largest amplitude."""

    def __init__(self, curve: FrictionCurve, size_mm: tuple[float, float], w_limit_um: float) -> None:
        self.curve: Final = curve
        self.size_mm: Final = size_mm
        self.w_limit_um: Final = w_limit_um


class Texture(Generic[T]):
    """A texture for one class of target; all is asked for, so that none is forgotten.

    `highest_um` is the largest amplitude anywhere. A target that asks for a friction gets at most the plate's limit,
    and more amplitude as a finger slides; one that asks for more amplitude than the limit is refused. `fills_shape`: on
    a surface it is spread over the shape, not the plate.
    """

    def __init__(
        self,
        target: type[T],
        *,
        amplitude: Callable[[T, TexturePlate], AmplitudeAt],
        detail: Callable[[T, tuple[float, float]], Detail],
        highest_um: Callable[[T, FrictionCurve], float],
        asks_for_friction: Callable[[T], bool],
        fills_shape: bool,
    ) -> None:
        self.target: Final = target
        self.amplitude: Final = amplitude
        self.detail: Final = detail
        self.highest_um: Final = highest_um
        self.asks_for_friction: Final = asks_for_friction
        self.fills_shape: Final = fills_shape


def constant(amplitude_um: float) -> AmplitudeAt:
    """Return the same amplitude everywhere."""
    return lambda _x_mm, _y_mm: amplitude_um
