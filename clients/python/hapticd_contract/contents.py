"""Contents: what a finger is to feel, as a target of its own or on a surface."""

from __future__ import annotations

from typing import Annotated, Any, Final, TypedDict

from msgspec import Meta

from .base import MAX_ID, AmplitudeUm, AngleRad, Contract, Digest, PeriodMm, Share

__all__ = ["Gradient", "Grating", "Noise"]  # textures that the client library hands on as they are

MAX_MAP_SIDE: Final = 128
MAX_ASSET_SIDE: Final = 1024  # of a map whose levels are an asset

Side = Annotated[int, Meta(ge=1, le=MAX_ASSET_SIDE)]


class Amplitude(Contract, frozen=True):
    """A constant vibration; 0 holds the glass still. A plain number in messages."""

    amplitude_um: AmplitudeUm


class Friction(Contract, frozen=True):
    """A constant friction: 0 is the most slippery that the plate allows, 1 is bare glass. A plain number in
    messages."""

    friction: Share


class Grating(Contract, frozen=True):
    """Stripes across `angle_rad` (anticlockwise from +x), with a crest of `high_um` through the centre.

    A sine between the two amplitudes, or for `duty_frac` above 0 a square wave with that share of the period high.
    """

    period_mm: PeriodMm
    """from crest to crest"""
    high_um: AmplitudeUm
    """on the crests"""
    low_um: AmplitudeUm = 0.0
    """between them"""
    angle_rad: AngleRad = 0.0
    """anticlockwise from +x"""
    duty_frac: Share = 0.0
    """0: a sine, else a square wave with that share of the period high"""


class LevelMap(Contract, frozen=True):
    """An image of amplitudes over the whole plate, or the box of a surface, edge to edge: `levels` are width x height
    bytes by rows from the top (+y) down, 0 is `low_um`, 255 `high_um`; bilinear between pixels.

    At most 128 x 128 pixels. With `asset`, the SHA-256 of an uploaded asset, the levels are that asset's, and at most
    1024 x 1024. With `friction`, those of level 0 and 255, it is an image of frictions, and has no amplitudes.
    """

    width: Side
    """pixels; at most 128 without an asset"""
    height: Side
    levels: bytes = b""
    """width x height bytes, by rows from the top (+y) down"""
    low_um: AmplitudeUm = 0.0
    """at level 0"""
    high_um: AmplitudeUm | None = None
    """at level 255"""
    asset: Digest | None = None
    """instead of `levels`: the SHA-256 of an uploaded asset"""
    friction: tuple[Share, Share] | None = None
    """instead of the amplitudes: the frictions of level 0 and 255"""

    @property
    def amplitudes_um(self) -> tuple[float, float]:
        """The amplitudes of level 0 and 255; zero for an image of frictions."""
        return self.low_um, self.high_um or 0.0

    def problem(self) -> str:
        if self.asset is not None and self.levels:
            return ".levels: a map with an asset has none."
        if self.asset is None and max(self.width, self.height) > MAX_MAP_SIDE:
            return (
                f": has {self.width} x {self.height} pixels, at most {MAX_MAP_SIDE} x {MAX_MAP_SIDE} without an asset."
            )
        size = self.width * self.height
        if self.asset is None and len(self.levels) != size:
            return f".levels: has {len(self.levels)} bytes, it must have {size}."
        if self.friction is None and self.high_um is None:
            return ".high_um: is missing."
        if self.friction is not None and (self.high_um is not None or self.low_um != 0.0):
            return ".friction: a map of frictions has no low_um and no high_um."
        return ""


class Gradient(Contract, frozen=True):
    """An amplitude that changes linearly along `angle_rad` (anticlockwise from +x), from `from_um` to `to_um` over
    `length_mm` with the centre in the middle; constant beyond."""

    length_mm: PeriodMm
    """over which it changes; constant beyond"""
    to_um: AmplitudeUm
    """at its end"""
    from_um: AmplitudeUm = 0.0
    """at its beginning"""
    angle_rad: AngleRad = 0.0
    """anticlockwise from +x"""


class Noise(Contract, frozen=True):
    """A random texture, the same for the same `seed`: waves of wavelengths `shortest_mm` .. `longest_mm`, equally many
    in each octave, in all directions.

    A wave's height is proportional to its wavelength to the power `exponent`: 0 gives all octaves the same height, 1
    looks alike at each scale. `rms_um` is the deviation from `mean_um`, cut at three times as much, and at 0.
    """

    shortest_mm: PeriodMm
    """shortest wavelength"""
    longest_mm: PeriodMm
    """longest wavelength; equally many waves in each octave"""
    rms_um: AmplitudeUm
    """deviation from the mean, clipped at three times that, and at 0"""
    mean_um: AmplitudeUm
    """mean"""
    exponent: Annotated[float, Meta(ge=0.0, le=4.0)] = 0.0
    """a wave's height is proportional to its wavelength to this power"""
    seed: Annotated[int, Meta(ge=0, le=MAX_ID)] = 0
    """the same texture for the same seed"""

    def problem(self) -> str:
        if self.longest_mm >= self.shortest_mm:
            return ""
        return f".longest_mm: {self.longest_mm:g} is out of bounds, it must be {self.shortest_mm:g} .. 1000."


Content = Amplitude | Friction | Grating | LevelMap | Gradient | Noise


class Contents(Contract, frozen=True, kw_only=True):
    """The fields of content, of which a message has exactly one."""

    amplitude_um: AmplitudeUm | None = None
    """constant vibration; 0 holds the glass still. Also limited by the plate"""
    friction: Share | None = None
    """0 is the most slippery that the plate allows, 1 is bare glass; converted by the daemon's friction curve"""
    grating: Grating | None = None
    """stripes, with a crest through the centre"""
    map: LevelMap | None = None
    """an image over the whole plate, edge to edge; bilinear between pixels"""
    gradient: Gradient | None = None
    """linear along a direction, with the centre in the middle"""
    noise: Noise | None = None
    """a random texture"""

    @property
    def content(self) -> Content:
        """The one content."""
        name, value = self._given[0]
        made: Content = _BARE[name](value) if name in _BARE else value
        return made

    @property
    def _given(self) -> list[tuple[str, Any]]:
        return [(name, value) for name in CONTENTS if (value := getattr(self, name)) is not None]

    def problem(self) -> str:
        given = self._given
        if len(given) != 1:
            return f": needs exactly one of {', '.join(CONTENTS)}."
        name, value = given[0]
        problem = "" if name in _BARE else value.problem()
        return f".{name}{problem}" if problem else ""


class GivenContent(TypedDict, total=False):
    """One content, as a program gives it by its name."""

    amplitude_um: float | None
    friction: float | None
    grating: Grating | None
    map: Any  # a LevelMap, or what has one as its `message`
    gradient: Gradient | None
    noise: Noise | None


CONTENTS: Final = Contents.__struct_fields__
_BARE: Final[dict[str, type[Amplitude | Friction]]] = {"amplitude_um": Amplitude, "friction": Friction}
NAMES: Final[dict[type, str]] = {
    Amplitude: "amplitude_um",
    Friction: "friction",
    Grating: "grating",
    LevelMap: "map",
    Gradient: "gradient",
    Noise: "noise",
}  # of the field that has a content, by its class


def content_fields(content: Content) -> dict[str, Any]:
    """Return the one field of a target or a surface with this content."""
    name = NAMES[type(content)]
    return {name: getattr(content, name) if name in _BARE else content}
