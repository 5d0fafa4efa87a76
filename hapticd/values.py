"""The vocabulary: every value that crosses a module, in the order of the touch path.

What fingers should feel and what is reported of them is in `hapticd_contract`, what goes to and comes from the board in
`board_values`.

Units stand in the names. Instants are integer nanoseconds (`t_..._ns`) on the host's monotonic clock, unless the
name says `board` (the board's wrapped microsecond counter, unwrapped to nanoseconds by `core.board.link`).
Positions are millimetres in the plate frame: origin at the plate's centre, x to the right, y away from the user.
Amplitudes are peak-to-peak micrometres; a complex amplitude W = W_d + j W_q is a phasor in the rotating frame
w(t) = W_d cos(wt) - W_q sin(wt).

Values are frozen and trusted inside, because they are validated at the rim. Those that every pass makes are
named tuples, which cost a third of a frozen dataclass.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntFlag
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

WEBER_FRAC = 0.11  # least relative change of friction that is felt (Gueorguiev et al., J. R. Soc. Interface 2017)

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
FingerKey = int | str  # a finger's id, or a virtual finger's name
OnProgress = Callable[[float], None]  # called with the share of the work that is done, 0 .. 1

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

    `pressure_frac` is the device's own measure of how hard it presses; axes and angle are those of the ellipse that it
    reports, in its own scale, 0 where there is none.
    """

    finger_id: int
    contact_id: int
    x_mm: float
    y_mm: float
    is_new: bool
    pressure_frac: float = 0.0
    major_mm: float = 0.0
    minor_mm: float = 0.0
    angle_rad: float = 0.0


class FingerFrame(NamedTuple):
    """The fingers down at `t_ns`, ordered by `finger_id`, and the ids of those lifted since the last frame."""

    t_ns: int
    fingers: tuple[Finger, ...]
    lifted: tuple[int, ...]


# --- what the plate should do -----------------------------------------------------------------------------------


class LinkTiming(NamedTuple):
    """Timing of a pass by the board: how far ahead its reference takes effect, whether one other than zero may go
    out, and whether the board has the last one (else it is sent again, however still the fingers are); and
    `holdable_frac` as in `board_values.BoardStatus`.
    """

    ahead_ns: int
    may_drive: bool = True
    is_followed: bool = True
    holdable_frac: tuple[float, ...] = ()


class Solution(NamedTuple):
    """Modal amplitudes for one instant: `modal_um` (M,), and what they give: `achieved_um` (N,) = |phi @ modal_um|.

    `limited` says that a mode's limit was met and some finger's target is missed for it. `condition` is the
    2-norm condition number of phi, inf where it is singular.
    """

    modal_um: FloatArray
    achieved_um: FloatArray
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


class Tick(NamedTuple):
    """Decision of one pass. `drive` is None where the last reference stands.

    `age_ns` is the newest sample's age when the pass began, `horizon_ns` from that sample to the first knot on the
    plate, the loop's own delay included.
    """

    t_now_ns: int
    age_ns: int
    horizon_ns: int
    drive: SafeDrive | None
    points: tuple[TouchPoint, ...]
    limited: bool


class LedgerLine(NamedTuple):
    """One reference frame's life: when the report it was made from was sampled, that sample's age when the pass
    began, the horizon it aimed at, the way over the link, when the board applied it, and by how much that was later
    than intended."""

    seq: int
    t_sample_ns: int
    t_sent_ns: int
    t_applied_ns: int
    age_ns: int
    horizon_ns: int
    link_ns: int
    late_ns: int
