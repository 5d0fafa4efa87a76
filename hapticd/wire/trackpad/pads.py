"""All pads that are known, the decoder of the reports of one, and their records in files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from ...values import AffineMap, TouchFrame
from . import evdev, magic_trackpad_1, magic_trackpad_2, tuio
from .pad import Family, Pad, PadGeometry, RefusedError

FAMILIES: Final[tuple[Family, ...]] = (magic_trackpad_2.FAMILY, magic_trackpad_1.FAMILY, evdev.FAMILY, tuio.FAMILY)

PADS: Final = {pad.model: pad for family in FAMILIES for pad in family.pads}
LAYOUTS: Final = {layout: make for family in FAMILIES for layout, make in family.layouts.items()}
DEFAULT_PAD: Final = PADS["mt2-usb"]  # the rig's, and what a pad is taken for until it is connected

_MOUSE = 0x02
_MOUSE_LENGTHS = range(3, 10)  # what a pad sends before the multitouch enable, or after losing it
_CENTRED = AffineMap()

_MOST_TEXT = 100
_MOST_RAW = 1 << 31
_MOST_MM = 1e5
_MOST_NS = 1_000_000_000
_OF_CONTACTS = ("pressure_max_raw", "quarter_turn_raw")  # of files, where a pad has them


def known(model: str) -> Pad:
    """Return a pad by its model. Raises ValueError."""
    if model not in PADS:
        raise ValueError(f"unknown trackpad model {model!r}: use one of {', '.join(PADS)}")
    return PADS[model]


class Decoder:
    """Decode reports of one trackpad to TouchFrames in the plate frame.

    `decode` accepts any bytes: a report that is no whole multitouch report gives no frame, is counted by reason and
    never raises. The constructor raises ValueError for an unknown model; a `Pad` need not be known.

    Every record of a report is in the frame but those of places beyond the pad; `touching` marks those that press the
    glass (Magic Trackpad 2: state 4 or 5, Magic Trackpad 1: any but 0). A contact missing from a Magic Trackpad 2 frame
    has ended. On the Magic Trackpad 1 it stays at its last position until its state is 0 or it is missing for 100 ms.

    `angle_rad` is in [0, pi). Lengths of the contact ellipse follow the kernel (raw byte x 4 in position units);
    their scale is undocumented. `pressure_frac` is raw / 253, on the Magic Trackpad 1 contact size / 63.
    """

    def __init__(self, model: str | Pad, plate_from_pad: AffineMap = _CENTRED) -> None:
        self.pad = known(model) if isinstance(model, str) else model
        self._refused = dict.fromkeys(("foreign", "length", "duplicate_id", "mouse"), 0)
        self._frames = self._off_pad = 0
        self.was_refused = False  # the last report; another one without a frame is part of one
        self._reach_raw = self.pad.geometry.reach_raw
        self.needs_enable = False  # the pad reports as a mouse: it needs the multitouch enable; until a touch frame
        self._layout = LAYOUTS[self.pad.layout](self.pad.geometry, plate_from_pad)

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


def to_fields(pad: Pad) -> dict[str, object]:
    """Return the fields of a pad in files: what the decoder of its reports needs."""
    size = pad.geometry
    return {
        "model": pad.model,
        "layout": pad.layout,
        "period_ns": pad.period_ns,
        "x_raw": [size.x_min_raw, size.x_max_raw],
        "y_raw": [size.y_min_raw, size.y_max_raw],
        "size_mm": [size.width_mm, size.height_mm],
    } | {name: value for name in _OF_CONTACTS if (value := getattr(size, name)) > 0}


def from_fields(fields: Mapping[str, object]) -> Pad:
    """The inverse of `to_fields`; earlier files have a model alone, which must be known. Raises ValueError."""
    model = fields.get("model")
    if not isinstance(model, str) or len(model) > _MOST_TEXT:
        raise ValueError(f"a pad must have a model, such as {', '.join(PADS)}")
    if "layout" not in fields:
        return known(model)
    layout, period_ns = fields["layout"], fields.get("period_ns")
    if not isinstance(layout, str) or layout not in LAYOUTS:
        raise ValueError(f"unknown layout of reports: use one of {', '.join(LAYOUTS)}")
    if type(period_ns) is not int or not 0 < period_ns <= _MOST_NS:
        raise ValueError("a pad's period_ns must be a whole number up to a second")
    x_min, x_max, y_min, y_max = (*_range(fields, "x_raw"), *_range(fields, "y_raw"))
    of_contacts = {name: _whole(fields, name) for name in _OF_CONTACTS}
    size = PadGeometry(x_min, x_max, y_min, y_max, *_size_mm(fields), **of_contacts)
    usual = PADS.get(model, Pad(model, model, layout, size, period_ns, source=""))
    return replace(usual, layout=layout, geometry=size, period_ns=period_ns)


def _whole(fields: Mapping[str, object], name: str) -> int:
    value = fields.get(name, 0)
    if type(value) is not int or not 0 <= value <= _MOST_RAW:
        raise ValueError(f"a pad's {name} must be a whole number, 0 for none")
    return value


def _range(fields: Mapping[str, object], name: str) -> tuple[int, int]:
    match fields.get(name):
        case [int(low), int(high)] if -_MOST_RAW <= low < high <= _MOST_RAW:
            return low, high
    raise ValueError(f"a pad's {name} must be two whole numbers, the second the larger")


def _size_mm(fields: Mapping[str, object]) -> tuple[float, float]:
    match fields.get("size_mm"):
        case [int() | float() as width, int() | float() as height] if (
            1.0 <= width <= _MOST_MM and 1.0 <= height <= _MOST_MM
        ):
            return float(width), float(height)
    raise ValueError("a pad's size_mm must be two numbers, its width and height")
