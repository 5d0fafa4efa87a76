"""The vocabulary: every value that crosses a module, in the order of the touch path.

Units stand in the names. Instants are integer nanoseconds (`t_..._ns`) on the host's monotonic clock, unless the
name says `board` (the board's wrapped microsecond counter, unwrapped to nanoseconds by `core.board.clock_sync`).
Positions are millimetres in the plate frame: origin at the plate's centre, x to the right, y away from the user.
Amplitudes are peak-to-peak micrometres; a complex amplitude W = W_d + j W_q is a phasor in the rotating frame
w(t) = W_d cos(wt) - W_q sin(wt).

Values are frozen and trusted inside, because they are validated at the rim. Those that every pass makes are
named tuples, which cost a third of a frozen dataclass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum, IntFlag
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

# --- where the trackpad lies ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class AffineMap:
    """Trackpad millimetres to plate millimetres: p = A q + offset, A = (xx xy; yx yy)."""

    xx: float = 1.0
    xy: float = 0.0
    yx: float = 0.0
    yy: float = 1.0
    offset_x_mm: float = 0.0
    offset_y_mm: float = 0.0

    @classmethod
    def from_placement(
        cls,
        offset_mm: tuple[float, float] = (0.0, 0.0),
        rotation_deg: float = 0.0,
        scale: tuple[float, float] = (1.0, 1.0),
    ) -> AffineMap:
        """The pad's centre lies at `offset_mm` on the plate, turned anticlockwise; axes are scaled before turning."""
        cos, sin = math.cos(math.radians(rotation_deg)), math.sin(math.radians(rotation_deg))
        return cls(cos * scale[0], -sin * scale[1], sin * scale[0], cos * scale[1], offset_mm[0], offset_mm[1])

    def apply(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Plate position of a point on the pad."""
        return (
            self.xx * x_mm + self.xy * y_mm + self.offset_x_mm,
            self.yx * x_mm + self.yy * y_mm + self.offset_y_mm,
        )


# --- touch -----------------------------------------------------------------------------------------------------


class RawReport(NamedTuple):
    """One report as the trackpad's driver delivered it (report id first), and when it was read."""

    t_host_ns: int
    data: bytes


class Contact(NamedTuple):
    """One contact record of a trackpad report, converted to the plate frame.

    `contact_id` is the device's: stable while the contact is down, reused afterwards. `angle_rad` is the ellipse's
    major axis, anticlockwise from +x. `state` is the device's own code; `touching` is what it means.
    """

    contact_id: int
    x_mm: float
    y_mm: float
    major_mm: float
    minor_mm: float
    angle_rad: float
    pressure_frac: float
    touching: bool
    state: int
    raw_x: int
    raw_y: int


class TouchFrame(NamedTuple):
    """All contacts of one report. `t_ns` is the device's own time stamp, unwrapped and laid on the host's axis.

    The device clock drifts against the host's: `core.touch.sensor_clock.SensorClock` turns `t_ns` into host time.
    """

    t_ns: int
    contacts: tuple[Contact, ...]
    button: bool


class Finger(NamedTuple):
    """A tracked finger. `finger_id` counts up from 1 and is never used again, whatever ids the device reuses.

    `pressure_frac` is the device's own measure of how hard it presses.
    """

    finger_id: int
    contact_id: int
    x_mm: float
    y_mm: float
    is_new: bool
    pressure_frac: float = 0.0


class FingerFrame(NamedTuple):
    """The fingers down at `t_ns`, ordered by `finger_id`, and the ids of those lifted since the last frame."""

    t_ns: int
    fingers: tuple[Finger, ...]
    lifted: tuple[int, ...]


# --- what a finger should feel ----------------------------------------------------------------------------------

WEBER_FRAC = 0.11  # least relative change of friction that is felt (Gueorguiev et al., J. R. Soc. Interface 2017)


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
    the client requests; None where the client does not say. `surfaces` are in order, the last on top.
    """

    client: str
    ttl_ns: int
    targets: dict[int | str, Target]
    virtuals: dict[str, VirtualPath]
    stamp: int | None = None
    surfaces: dict[str, Surface] = field(default_factory=dict)
    effects: dict[str, Effect] = field(default_factory=dict)


# --- what the plate should do -----------------------------------------------------------------------------------


class Solution(NamedTuple):
    """Modal amplitudes for one instant: `modal_um` (M,), and what they give: `achieved_um` (N,) = |phi @ modal_um|.

    `limited` says that a mode's limit was met and some finger's target is missed for it. `condition` is the
    2-norm condition number of phi, inf where it is singular.
    """

    modal_um: npt.NDArray[np.float64]
    achieved_um: npt.NDArray[np.float64]
    limited: bool
    condition: float


class Knot(NamedTuple):
    """The reference's modal phasors (M,) `dt_ns` after the frame's `t_apply_ns`; in between the board interpolates."""

    dt_ns: int
    modal_um: tuple[complex, ...]


class Drive(NamedTuple):
    """A reference polyline from the solver: not yet checked, so the encoder refuses it."""

    t_apply_ns: int
    knots: tuple[Knot, ...]


class LimitReason(IntFlag):
    """Why the gate changed a drive; 0 is untouched."""

    NONE = 0
    AMPLITUDE = 1  # some |W_k| was above its limit: all modes scaled together
    NOT_FINITE = 2  # NaN or infinity: the whole drive is silence
    MALFORMED = 4  # wrong number of modes or knots, or times out of order: silence


class SafeDrive(NamedTuple):
    """A drive that passed `core.trajectory.gate`: the only thing the encoder takes."""

    t_apply_ns: int
    knots: tuple[Knot, ...]
    reasons: LimitReason


class TouchPoint(NamedTuple):
    """A finger that takes part in the solve, as it will be when the frame's first knot takes effect, and where it
    will be at the last.

    `key` is a finger id, or the name of a virtual finger.
    """

    key: int | str
    x_mm: float
    y_mm: float
    target_um: float
    achieved_um: float
    end_x_mm: float
    end_y_mm: float


class Perceived(NamedTuple):
    """What a person perceives of a finger's target: the contact's friction relative to the target's, minus 1, and the
    share of time in which that is beyond WEBER_FRAC either way."""

    friction_change: float
    weber_frac: float


class Tick(NamedTuple):
    """What one pass decided. `drive` is None where the last reference stands.

    `age_ns` is the newest sample's age when the pass began, `horizon_ns` from that sample to the first knot on the
    plate, the loop's own delay included.
    """

    t_now_ns: int
    age_ns: int
    horizon_ns: int
    drive: SafeDrive | None
    points: tuple[TouchPoint, ...]
    limited: bool


# --- what happened ----------------------------------------------------------------------------------------------


class EventKind(Enum):
    """What happened to a finger or an effect."""

    LANDED = "landed"
    LIFTED = "lifted"
    ENTERED = "entered"
    LEFT = "left"
    CROSSED = "crossed"
    PRESSED = "pressed"
    RELEASED = "released"
    BEGUN = "begun"
    ENDED = "ended"


class PlateEvent(NamedTuple):
    """One event; `seq` counts all of a pipeline. `t_ns` is when its cause occurred, `t_device_ns` the same on the
    trackpad's own clock.

    `client` owns the `surface` (of ENTERED, LEFT and CROSSED) or the `effect` (of PRESSED, RELEASED, BEGUN and ENDED).
    None and "" where there is none.
    """

    seq: int
    kind: EventKind
    t_ns: int
    t_device_ns: int | None
    finger_id: int | None
    place_mm: tuple[float, float] | None
    client: str
    surface: str
    effect: str
