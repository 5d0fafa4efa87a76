"""The vocabulary of clients: what fingers should feel, at places and in time.

Units as in `hapticd.values`. Values are frozen, and validated where a message is decoded (`wire`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

# --- what a finger should feel ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class AmplitudeTarget:
    """A constant vibration amplitude under the finger; 0 makes it stick."""

    amplitude_um: float


@dataclass(frozen=True, slots=True)
class FrictionTarget:
    """A constant friction: 0 is the most slippery the plate can do, 1 is bare glass."""

    friction_frac: float


@dataclass(frozen=True, slots=True)
class GratingTarget:
    """A grating along `angle_rad` (anticlockwise from +x) with a crest through the plate's centre.

    `duty_frac` in (0, 1) is the share of `high_um` in a square wave; 0 asks for a sine between low and high.
    """

    period_mm: float
    angle_rad: float
    low_um: float
    high_um: float
    duty_frac: float


@dataclass(frozen=True, slots=True)
class MapTarget:
    """An image of amplitudes: `levels` holds rows of bytes from the top (+y) down, 0 is `low_um`, 255 `high_um`.

    Pixel centres are spread over the whole plate edge to edge; between them the amplitude is bilinear. With `asset`,
    the SHA-256 of an uploaded asset, the levels are that asset's. With `frictions`, those of level 0 and 255, it is an
    image of frictions, and has no amplitudes.
    """

    width: int
    height: int
    levels: bytes
    low_um: float
    high_um: float
    asset: bytes = b""
    frictions: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class GradientTarget:
    """An amplitude that changes linearly along `angle_rad` (anticlockwise from +x), from `from_um` to `to_um` over
    `length_mm`, with the origin in the middle, and is constant beyond."""

    length_mm: float
    angle_rad: float
    from_um: float
    to_um: float


@dataclass(frozen=True, slots=True)
class NoiseTarget:
    """A random texture, the same for the same `seed`: waves of wavelengths `shortest_mm` .. `longest_mm`, equally many
    in each octave, in all directions.

    A wave's height is proportional to its wavelength to the power `exponent`: 0 gives all octaves the same height, 1
    a surface that looks alike at each scale. `rms_um` is the deviation from `mean_um`, cut at three times as much, and
    at 0.
    """

    seed: int
    shortest_mm: float
    longest_mm: float
    exponent: float
    mean_um: float
    rms_um: float


Target = AmplitudeTarget | FrictionTarget | GratingTarget | MapTarget | GradientTarget | NoiseTarget


@dataclass(frozen=True, slots=True)
class VirtualPath:
    """The way of a virtual finger or of a surface: a polyline walked at constant speed, back and forth when `loop` is
    set.

    One point is a place of rest.
    """

    points_mm: tuple[tuple[float, float], ...]
    speed_mm_s: float
    loop: bool


class Blend(Enum):
    """What a layer does with the amplitude of the layers below it."""

    REPLACE = "replace"
    ADD = "add"
    MAX = "max"


@dataclass(frozen=True, slots=True)
class Circle:
    """A disc around the layer's origin."""

    radius_mm: float


@dataclass(frozen=True, slots=True)
class Polygon:
    """Corners (3 or more) in the layer's frame. Inside is where a ray outwards crosses the sides an odd number of
    times, so that sides may cross each other."""

    points_mm: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Surface:
    """A layer on the plate: content within a shape, felt by any finger that has no target of its own.

    Content and `shape` (None: everywhere) are in the layer's frame, which is scaled, turned anticlockwise and moved to
    `position_mm` at `t_pose_ns` (None: when it arrives), and moves on from there with its velocity, or instead along
    `path`, from its first point on. Of two layers the one with the larger `z` is on top.
    """

    content: Target
    shape: Circle | Polygon | None = None
    position_mm: tuple[float, float] = (0.0, 0.0)
    angle_rad: float = 0.0
    scale: float = 1.0
    velocity_mm_s: tuple[float, float] = (0.0, 0.0)
    turning_rad_s: float = 0.0
    t_pose_ns: int | None = None
    z: int = 0
    blend: Blend = Blend.REPLACE
    path: VirtualPath | None = None


# --- effects in time --------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Pulse:
    """`height_um` (also negative) added for `length_s`, with a linear rise and fall of `rise_s` each within it."""

    height_um: float
    length_s: float
    rise_s: float = 0.002


@dataclass(frozen=True, slots=True)
class Envelope:
    """Points (t_s, value) from 0 s on, linear in between; two at one instant are a step.

    Values are um that are added, or with `is_factor` factors of what is felt.
    """

    points: tuple[tuple[float, float], ...]
    is_factor: bool = False


class Wave(Enum):
    """The wave of a modulation: 1 at its start, mean 0, within -1 .. 1."""

    SINE = "sine"
    SQUARE = "square"


@dataclass(frozen=True, slots=True)
class Modulation:
    """What is felt times 1 - depth/2 + depth/2 * wave: from 1 down to 1 - depth. `length_s` None: until it is ended."""

    frequency_hz: float
    depth_frac: float
    wave: Wave = Wave.SINE
    length_s: float | None = None


Form = Pulse | Envelope | Modulation


class Cause(Enum):
    """What starts an effect: a message, an instant, or a finger."""

    NOW = "now"
    AT = "at"
    LANDING = "landing"
    LIFTING = "lifting"
    ENTERING = "entering"
    LEAVING = "leaving"
    CROSSING = "crossing"
    PRESSURE = "pressure"


@dataclass(frozen=True, slots=True)
class Start:
    """When an effect starts, and what the cause needs: AT `t_ns`; ENTERING, LEAVING and CROSSING the client's
    `surface`; PRESSURE that reaches `threshold_frac` and has meanwhile been at `release_frac` or less.

    NOW with another `start_id` starts once more.
    """

    cause: Cause = Cause.NOW
    start_id: int = 0
    t_ns: int = 0
    surface: str = ""
    threshold_frac: float = 0.0
    release_frac: float = 0.0


@dataclass(frozen=True, slots=True)
class Effect:
    """A form in time on a finger (its id), on one of the client's surfaces (its name), or on the whole plate (None)."""

    form: Form
    on: int | str | None = None
    start: Start = Start()
    loops: bool = False


@dataclass(frozen=True, slots=True)
class ClientTargets:
    """All present targets of one client; they replace that client's earlier ones.

    Keys of `targets` are finger ids (int) or names of virtual fingers (str). `stamp` grows with each change of what
    the client requests; None where the client does not say. `surfaces` are in order, the last on top. `priorities` has
    those of targets that are not 0.
    """

    client: str
    ttl_ns: int
    targets: dict[int | str, Target]
    virtuals: dict[str, VirtualPath]
    stamp: int | None = None
    surfaces: dict[str, Surface] = field(default_factory=dict)
    effects: dict[str, Effect] = field(default_factory=dict)
    priorities: dict[int | str, int] = field(default_factory=dict)
