"""All pads that are known, and their records in files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from ...values import AffineMap
from . import evdev, magic_trackpad_1, magic_trackpad_2, tuio
from .pad import Family, Pad, PadGeometry, ReportDecoder

FAMILIES: Final[tuple[Family, ...]] = (magic_trackpad_2.FAMILY, magic_trackpad_1.FAMILY, evdev.FAMILY, tuio.FAMILY)

PADS: Final = {pad.model: pad for family in FAMILIES for pad in family.pads}
LAYOUTS: Final = {layout: make for family in FAMILIES for layout, make in family.layouts.items()}
DEFAULT_PAD: Final = PADS["mt2-usb"]  # the rig's, and what a pad is taken for until it is connected

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


class Decoder(ReportDecoder):
    """Decoder of the reports of one trackpad. Raises ValueError for an unknown model; a `Pad` need not be known."""

    def __init__(self, model: str | Pad, plate_from_pad: AffineMap = _CENTRED) -> None:
        pad = known(model) if isinstance(model, str) else model
        super().__init__(pad, LAYOUTS[pad.layout](pad.geometry, plate_from_pad))


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
    """The inverse of `to_fields`; earlier recordings have a model alone, which must be known. Raises ValueError."""
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
