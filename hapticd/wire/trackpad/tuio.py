"""TUIO 1.1 (`/tuio/2Dcur`) and 2.0 (`/tuio2/ptr`): contacts of optical and other trackers, one datagram a report.

Specifications: tuio.org. Positions are shares of the surface, y to the user; its size must be known. A frame counts
once it is whole: 1.1 ends it by `fseq`, 2.0 by `alv`. An empty bundle, which no tracker sends, repeats the last frame.
"""

from __future__ import annotations

import math
from typing import Final

from ...values import AffineMap, Contact, TouchFrame
from .. import osc
from .event_clock import EventClock
from .pad import Family, Layout, Pad, PadGeometry, RefusedError

MAX_CONTACTS: Final = 16
MODEL: Final = "tuio"
REPEAT: Final = osc.BUNDLE + bytes(8)
SPAN_RAW: Final = 1 << 16  # raw units of a surface's width and height
PERIOD_NS: Final = 16_666_667  # of most cameras, until stamps show it
_RESTARTED: Final = 100  # frames back: the tracker began again
_FREED_NS: Final = 1_000_000_000  # another source may speak when the first has been silent for so long
_MOST_FAR: Final = 2.0  # of the surface from its corner

_Place = tuple[float, float, float]  # x, y, pressure


class Tuio(Layout):
    """Decoder of one tracker's datagrams; those of other sources and frames that come late are refused.

    Raises HapticdError without the package that reads OSC.
    """

    def __init__(self, geometry: PadGeometry, plate_from_pad: AffineMap) -> None:
        super().__init__(geometry, plate_from_pad)
        osc.require_package()
        self._clock = EventClock()
        self.reset()

    @property
    def clock_steps(self) -> int:
        return self._clock.steps

    def reset(self) -> None:
        self._places: dict[int, _Place] = {}  # by session id
        self._source = ""
        self._frame = 0
        self._t_host_ns: int | None = None
        self._clock.reset()

    def decode(self, report: bytes, t_host_ns: int) -> tuple[TouchFrame, ...]:
        try:
            spoken = osc.messages(report)
        except osc.OscError as error:
            raise RefusedError(error.reason) from None
        if not spoken:
            return (self._touch_frame(t_host_ns),)
        places, alive = dict(self._places), list[int]()
        source, frame, stamp_ns = "", -1, 0
        is_whole = False
        for address, arguments in spoken:
            if address == "/tuio/2Dcur" and arguments:
                match arguments:
                    case ["source", str(name)]:
                        source = name
                    case ["alive", *ids]:
                        alive = _ids(ids)
                    case ["set", int(number), *numbers]:
                        _take(places, number, numbers)
                    case ["fseq", int(number)]:
                        frame, is_whole = number, True
            elif address == "/tuio2/frm":
                match arguments:
                    case [int(number), int(time_ns), int(), str(name), *_]:
                        source, frame, stamp_ns = name, number, time_ns
            elif address == "/tuio2/ptr" and len(arguments) >= 9:
                session = arguments[0]
                if isinstance(session, int):
                    _take(places, session, arguments[3:], pressure_at=5)  # x, y, angle, shear, radius, press
            elif address == "/tuio2/alv":
                alive, is_whole = _ids(arguments), True
        if not is_whole:
            raise RefusedError("foreign")
        self._accept(source, frame, t_host_ns)
        self._places = {number: places[number] for number in alive[:MAX_CONTACTS] if number in places}
        t_ns = self._clock.instant_ns(stamp_ns, None, t_host_ns) if stamp_ns > 1_000_000_000 else t_host_ns
        return (self._touch_frame(t_ns),)

    def _accept(self, source: str, frame: int, t_host_ns: int) -> None:
        """Raise RefusedError for a frame of another source, or one that came late or twice."""
        is_free = self._t_host_ns is None or not 0 <= t_host_ns - self._t_host_ns < _FREED_NS
        if not is_free:
            if source != self._source:
                raise RefusedError("foreign")
            if 0 <= self._frame - frame < _RESTARTED and frame >= 0:  # -1: a frame without a number
                raise RefusedError("duplicate_id")
        self._source, self._t_host_ns = source, t_host_ns
        if frame >= 0:
            self._frame = frame

    def _touch_frame(self, t_ns: int) -> TouchFrame:
        return TouchFrame(t_ns, tuple([self._contact(number, place) for number, place in self._places.items()]), False)

    def _contact(self, number: int, place: _Place) -> Contact:
        x, y, pressure_frac = place
        raw_x, raw_y = round(x * SPAN_RAW), -round(y * SPAN_RAW)
        x_mm, y_mm = self._plate_map.at(raw_x, raw_y)
        return Contact(number, x_mm, y_mm, 0.0, 0.0, 0.0, pressure_frac, True, 1, raw_x, raw_y)


def _take(places: dict[int, _Place], number: int, numbers: list[osc.Argument], pressure_at: int = 99) -> None:
    """Take a contact's place, if its numbers are some."""
    values = [float(one) for one in numbers if not isinstance(one, str)]
    if len(values) < 2 or not all(math.isfinite(one) and abs(one) <= _MOST_FAR for one in values[:2]):
        return
    pressure = values[pressure_at] if len(values) > pressure_at and math.isfinite(values[pressure_at]) else 0.0
    if len(places) < 2 * MAX_CONTACTS or number in places:
        places[number] = (values[0], values[1], min(max(pressure, 0.0), 1.0))


def _ids(arguments: list[osc.Argument]) -> list[int]:
    return list(dict.fromkeys(one for one in arguments if isinstance(one, int)))


def surface(width_mm: float, height_mm: float) -> Pad:
    """Return the pad that a tracked surface of this size is."""
    size = PadGeometry(0, SPAN_RAW, -SPAN_RAW, 0, width_mm, height_mm)
    return Pad(MODEL, "TUIO tracker", "tuio", size, PERIOD_NS, source="tuio")


FAMILY: Final[Family] = Family((), {"tuio": Tuio})
