"""The description of a pad, all that must be known of a touch device, and the decoder of its reports.

Each family of devices has a file here: its pads, and the decoders of their reports. A device whose size and period are
known when it is opened gets its record then: its source makes it with `dataclasses.replace`, or from scratch.
"""

from __future__ import annotations

import math
import struct
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from ...values import AffineMap, Contact, TouchFrame

USB, BLUETOOTH = 1, 2  # hidapi's bus_type
# Apple's record of a contact: a word with x (13 bits, signed), y (13 bits, signed, up) and, not on the Magic Trackpad
# 1, finger (3) and state (3); then major, minor, and three bytes that differ between the models.
RECORD = struct.Struct("<I5B")
MAX_RECORDS = 15
_MOUSE = 0x02
_MOUSE_LENGTHS = range(3, 10)  # what a pad sends before the multitouch enable, or after losing it


@dataclass(frozen=True, slots=True)
class HidIds:
    """By what hidapi lists a device: bus, ids, and the interface that reports touches."""

    bus: int
    vendor_id: int
    product_id: int
    interface: int = -1  # hidapi's for a device that has one


@dataclass(frozen=True, slots=True)
class PadGeometry:
    """The range of positions a pad declares (raw units, y up) and the size in mm that the kernel gives it.

    Of a device whose layout does not say it: the highest pressure, and the orientation of an ellipse along x; 0: none.
    """

    x_min_raw: int
    x_max_raw: int
    y_min_raw: int
    y_max_raw: int
    width_mm: float
    height_mm: float
    pressure_max_raw: int = 0
    quarter_turn_raw: int = 0

    @property
    def reach_raw(self) -> tuple[float, float, float, float]:
        """Lowest and highest x, then y, of a contact: a tenth beyond the range, for pads report a little more."""
        beyond_x, beyond_y = 0.1 * (self.x_max_raw - self.x_min_raw), 0.1 * (self.y_max_raw - self.y_min_raw)
        return (
            *(self.x_min_raw - beyond_x, self.x_max_raw + beyond_x),
            *(self.y_min_raw - beyond_y, self.y_max_raw + beyond_y),
        )

    @property
    def units_per_mm(self) -> tuple[float, float]:
        """Raw units per mm along x and y."""
        return (self.x_max_raw - self.x_min_raw) / self.width_mm, (self.y_max_raw - self.y_min_raw) / self.height_mm

    @property
    def centre_raw(self) -> tuple[float, float]:
        """The raw position of pad (0, 0) mm: the middle of the declared range."""
        return (self.x_min_raw + self.x_max_raw) / 2, (self.y_min_raw + self.y_max_raw) / 2


@dataclass(frozen=True, slots=True)
class Pad:
    """A touch device. `model` names it in configurations and files, `name` is for people.

    `layout` names the decoder of its reports; `period_ns` is the nominal one between them. `source` is the
    `trackpad.source` that reads it; `ids` are for hidapi, None for other sources. `enable` is the feature report that
    switches it to multitouch; empty: it needs none.
    """

    model: str
    name: str
    layout: str
    geometry: PadGeometry
    period_ns: int
    source: str = "hid"
    ids: HidIds | None = None
    enable: bytes = b""


class PlateMap:
    """Raw units to plate mm in one step, and for each orientation code the ellipse's angle and mm per raw count.

    The driver's orientation (its codes negated) turns clockwise from +y by 180 degrees over all codes; anticlockwise
    from +x that is code x 180 degrees / codes. Under a map that shears, the ellipse is taken along the mapped axis.
    """

    def __init__(self, geometry: PadGeometry, affine: AffineMap, *, orientations: int) -> None:
        (units_x, units_y), (centre_x, centre_y) = geometry.units_per_mm, geometry.centre_raw
        self._x_x, self._x_y = affine.xx / units_x, affine.xy / units_y
        self._y_x, self._y_y = affine.yx / units_x, affine.yy / units_y
        self._x_0 = affine.offset_x_mm - self._x_x * centre_x - self._x_y * centre_y
        self._y_0 = affine.offset_y_mm - self._y_x * centre_x - self._y_y * centre_y
        self._affine, self._mm_per_unit = affine, 2 / (units_x + units_y)
        mm_per_count = 4 / ((units_x + units_y) / 2)
        angles_rad = (code * math.pi / orientations for code in range(orientations))
        self.axes = tuple(_mapped_axis(affine, angle_rad, mm_per_count) for angle_rad in angles_rad)

    def position(self, word: int) -> tuple[float, float, int, int]:
        """Decode a record's first word, two 13-bit two's complement numbers: plate x, y in mm, and both raw."""
        raw_x, raw_y = ((word & 0x1FFF) ^ 0x1000) - 0x1000, ((word >> 13 & 0x1FFF) ^ 0x1000) - 0x1000
        return (*self.at(raw_x, raw_y), raw_x, raw_y)

    def at(self, raw_x: float, raw_y: float) -> tuple[float, float]:
        """Plate x, y in mm of a raw position, y up."""
        return (
            self._x_x * raw_x + self._x_y * raw_y + self._x_0,
            self._y_x * raw_x + self._y_y * raw_y + self._y_0,
        )

    def axis(self, angle_rad: float) -> tuple[float, float, float]:
        """Angle on the plate of an axis at `angle_rad` on the pad, and mm per raw unit along it and across."""
        return _mapped_axis(self._affine, angle_rad, self._mm_per_unit)


def _mapped_axis(affine: AffineMap, angle_rad: float, mm_per_count: float) -> tuple[float, float, float]:
    """Angle on the plate, and mm per raw count along the major axis and along the minor."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    major_x, major_y = affine.xx * cos + affine.xy * sin, affine.yx * cos + affine.yy * sin
    minor_x, minor_y = affine.xy * cos - affine.xx * sin, affine.yy * cos - affine.yx * sin
    folded = math.atan2(major_y, major_x) % math.pi
    return (
        folded if folded < math.pi else 0.0,  # a tiny negative angle rounds up to pi itself
        math.hypot(major_x, major_y) * mm_per_count,
        math.hypot(minor_x, minor_y) * mm_per_count,
    )


class RefusedError(Exception):
    """A report is no touch report, for `reason`. Never leaves this package."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class Layout(ABC):
    """The decoder of one pad's reports, which count `orientations` angles in half a turn."""

    def __init__(self, geometry: PadGeometry, plate_from_pad: AffineMap, orientations: int = 1) -> None:
        self._geometry = geometry
        self._plate_map = PlateMap(geometry, plate_from_pad, orientations=orientations)

    @property
    @abstractmethod
    def clock_steps(self) -> int:
        """Return how often the pad's own clock was stopped or set."""

    @property
    def counts(self) -> dict[str, int]:
        """Return what else a layout counts."""
        return {}

    @abstractmethod
    def decode(self, report: bytes, t_host_ns: int) -> tuple[TouchFrame, ...]:
        """Return the report's frames on the plate. Raises RefusedError and no other."""

    @abstractmethod
    def reset(self) -> None:
        """Discard contacts and clock state."""


class ReportDecoder:
    """Decode reports of one trackpad to TouchFrames in the plate frame.

    `decode` accepts any bytes: a report that is no whole multitouch report gives no frame, is counted by reason and
    never raises.

    Every record of a report is in the frame but those of places beyond the pad; `touching` marks those that press the
    glass (Magic Trackpad 2: state 4 or 5, Magic Trackpad 1: any but 0). A contact missing from a Magic Trackpad 2 frame
    has ended. On the Magic Trackpad 1 it stays at its last position until its state is 0 or it is missing for 100 ms.

    `angle_rad` is in [0, pi). Lengths of the contact ellipse follow the kernel (raw byte x 4 in position units);
    their scale is undocumented. `pressure_frac` is raw / 253, on the Magic Trackpad 1 contact size / 63.
    """

    def __init__(self, pad: Pad, layout: Layout) -> None:
        self.pad = pad
        self._refused = dict.fromkeys(("foreign", "length", "duplicate_id", "mouse"), 0)
        self._frames = self._off_pad = 0
        self.was_refused = False  # the last report; another one without a frame is part of one
        self._reach_raw = self.pad.geometry.reach_raw
        self.needs_enable = False  # the pad reports as a mouse: it needs the multitouch enable; until a touch frame
        self._layout = layout

    @property
    def counters(self) -> dict[str, int]:
        """Counts since construction: frames decoded, reports refused by reason, contacts beyond the pad, steps of the
        device's clock."""
        counts = {"frames": self._frames, **self._refused, "off_pad": self._off_pad}
        return counts | {"clock_steps": self._layout.clock_steps} | self._layout.counts

    def reset(self) -> None:
        """Discard contacts and clock state, as after a reconnect. Counters stay."""
        self.needs_enable = False
        self._layout.reset()

    def decode(self, report: bytes, t_host_ns: int) -> tuple[TouchFrame, ...]:
        """Return the frames of one report (report id first, as from hidraw): one, two from a 0xF7, none if refused.

        `t_ns` of a frame is the device's millisecond stamp, unwrapped and anchored to the host time of the first
        report; on the Magic Trackpad 1, whose stamp is not understood, it is `t_host_ns`, less one period for the
        first of a pair.
        """
        self.was_refused = False
        try:
            frames = self._layout.decode(report, t_host_ns)
        except RefusedError as refused:
            is_mouse = len(self.pad.enable) > 0 and len(report) in _MOUSE_LENGTHS and report[0] == _MOUSE
            self.needs_enable = self.needs_enable or is_mouse
            self.was_refused = True
            self._refused["mouse" if is_mouse else refused.reason] += 1
            return ()
        self.needs_enable = False
        self._frames += len(frames)
        return tuple([self._on_pad(frame) for frame in frames])

    def _on_pad(self, frame: TouchFrame) -> TouchFrame:
        """Return the frame without contacts beyond the pad."""
        x_min, x_max, y_min, y_max = self._reach_raw
        on_pad = [one for one in frame.contacts if x_min <= one.raw_x <= x_max and y_min <= one.raw_y <= y_max]
        off_pad = len(frame.contacts) - len(on_pad)
        self._off_pad += off_pad
        return TouchFrame(frame.t_ns, tuple(on_pad), frame.button) if off_pad else frame


class Family(NamedTuple):
    """Pads that report alike, and how each of their layouts is made from a pad's size and its place on the plate."""

    pads: tuple[Pad, ...]
    layouts: dict[str, Callable[[PadGeometry, AffineMap], Layout]]


def records(report: bytes, report_id: int, header_bytes: int) -> Iterator[tuple[int, ...]]:
    """Split a report into its records. Raises RefusedError for another report id or a fraction of a record."""
    if not report or report[0] != report_id:
        raise RefusedError("foreign" if report else "length")
    count, rest = divmod(len(report) - header_bytes, RECORD.size)
    if rest != 0 or not 0 <= count <= MAX_RECORDS:
        raise RefusedError("length")
    return RECORD.iter_unpack(report[header_bytes:])


def require_distinct_ids(contacts: tuple[Contact, ...]) -> None:
    """Raise RefusedError for a repeated id: no pad sends one, so the report is torn."""
    if len({contact.contact_id for contact in contacts}) != len(contacts):
        raise RefusedError("duplicate_id")
