"""TUIO 1.1 and 2.0: contacts of optical and other trackers, in datagrams.

Specifications: tuio.org. Positions are shares of the surface, y to the user; its size must be known. Of a tracker's
profiles the first of PROFILES that it sends is taken. A frame may come in several datagrams, down to one message each,
and counts once it is whole: 1.1 ends it by `fseq` (or by `alive`, of a tracker that never sends one), 2.0 by `alv`. An
empty bundle, which no tracker sends, repeats the last frame.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from ...values import AffineMap, Contact, TouchFrame
from .. import osc
from .event_clock import EventClock
from .pad import Family, Layout, Pad, PadGeometry, RefusedError

PROFILES: Final = ("ptr", "2Dcur", "25Dcur", "2Dblb", "bnd")  # fingers first, then whatever touches
MAX_CONTACTS: Final = 16
MODEL: Final = "tuio"
REPEAT: Final = osc.BUNDLE + bytes(8)
SPAN_RAW: Final = 1 << 16  # raw units of a surface's width and height
PERIOD_NS: Final = 16_666_667  # of most cameras, until stamps show it
SILENT_NS: Final = 2_500_000_000  # trackers send once a second, whatever happens: then another source may
_RESTARTED: Final = 100  # frames back: the tracker began again
_SAME_FRAME_NS: Final = 2_000_000  # between datagrams of one frame; later, its number does not count
_MOST_FAR: Final = 2.0  # of the surface from its corner
_HOVER: Final = 0.01  # of the height that a 25D tracker sees: its noise at the surface
_MOST_ID: Final = (1 << 53) - 1  # the largest whole number that every sender has
_LONGEST_SET: Final = 256  # in bytes; only what lists ids is longer

_COUNTED: Final = ("contacts", "outside", "hovering", "other_profiles", "unended")


class _Place(NamedTuple):
    x: float
    y: float
    pressure_frac: float
    touching: bool


class _Packet:
    """One datagram's content of a profile."""

    def __init__(self) -> None:
        self.places: dict[int, _Place] = {}
        self.alive: list[int] | None = None
        self.number = -1  # without one
        self.is_ended = False


class _Profile:
    """A source's contacts of a profile, by session id."""

    def __init__(self) -> None:
        self.places: dict[int, _Place] = {}
        self.alive: list[int] = []
        self.shown: dict[int, _Place] = {}  # of the last whole frame
        self.number, self.said = -1, set[int]()  # of the newest frame, and the contacts that were set for it
        self.t_number_ns = 0  # when its first datagram came
        self.parts, self.expected = 0, 1  # datagrams of this number, and of the one before
        self.is_open = False  # alive was said, and nothing has ended the frame yet
        self.ends_by_alive = False

    def is_late(self, number: int) -> bool:
        """Whether a frame of this number belongs before what is known."""
        return 0 < self.number - number < _RESTARTED and number > 0  # 0 and -1: a frame without one

    def is_more(self, packet: _Packet, t_host_ns: int) -> bool:
        """Whether the datagram is another one of the same frame."""
        return 0 < packet.number == self.number and 0 <= t_host_ns - self.t_number_ns < _SAME_FRAME_NS

    def is_repeated(self, packet: _Packet) -> bool:
        """Whether a datagram says what another one of the same number has said."""
        return 0 < packet.number == self.number and (
            all(number in self.said and self.places.get(number) == place for number, place in packet.places.items())
            and all(number in self.alive for number in packet.alive or ())
        )

    def take(self, packet: _Packet, t_host_ns: int) -> bool:
        """Take a datagram; return whether a frame is whole now."""
        is_more = self.is_more(packet, t_host_ns)
        for number, place in packet.places.items():
            if len(self.places) < 2 * MAX_CONTACTS or number in self.places:
                self.places[number] = place
        if packet.alive is not None:
            before = self.alive if is_more else []
            self.alive = list(dict.fromkeys([*before, *packet.alive]))[: osc.MAX_ARGUMENTS]
            self.ends_by_alive |= self.is_open and not packet.is_ended and len(packet.places) > 0
        if packet.is_ended:
            self.ends_by_alive = False
            if is_more:
                self.parts += 1
            else:
                self.expected, self.parts = max(self.parts, 1), 1
                self.number = packet.number if packet.number >= 0 else self.number
                self.t_number_ns = t_host_ns
                self.said.clear()
            if len(self.said) < osc.MAX_MESSAGES:
                self.said.update(packet.places)
        is_ended = packet.is_ended or (self.ends_by_alive and packet.alive is not None)
        self.is_open = not is_ended and (self.is_open or packet.alive is not None)
        if is_ended:
            self.places = {number: self.places[number] for number in self.alive if number in self.places}
        is_whole = is_ended and (self.ends_by_alive or self.parts >= self.expected)
        if is_whole:
            self.shown = dict(self.places)
        return is_whole


class Tuio(Layout):
    """Decoder of one tracker's datagrams; those of other sources and frames that come late are refused.

    Raises HapticdError without the package that reads OSC.
    """

    def __init__(self, geometry: PadGeometry, plate_from_pad: AffineMap) -> None:
        super().__init__(geometry, plate_from_pad)
        osc.require_package()
        self._clock = EventClock()
        self._counts = dict.fromkeys(_COUNTED, 0)
        self.reset()

    @property
    def clock_steps(self) -> int:
        return self._clock.steps

    @property
    def counts(self) -> dict[str, int]:
        return self._counts

    def reset(self) -> None:
        self._t_host_ns: int | None = None
        self._clock.reset()
        self._change_source("")

    def _change_source(self, source: str) -> None:
        self._source = source
        self._profiles: dict[str, _Profile] = {}
        self._tokens: set[int] = set()
        self._frame_2, self._stamp_ns = -1, 0  # of TUIO 2.0: the number and the time of the frame that is sent
        self._t_stamp_ns = 0  # of the last frame

    def decode(self, report: bytes, t_host_ns: int) -> tuple[TouchFrame, ...]:
        try:
            elements = osc.elements(report)
            if not elements and len(report) == len(REPEAT):
                return (self._touch_frame(t_host_ns),)
            source = self._require_source(elements, t_host_ns)
            packets = self._packets(elements)
        except osc.OscError as error:
            raise RefusedError(error.reason) from None
        if not packets:
            raise RefusedError("foreign")
        known = {name: self._profiles.get(name) or _Profile() for name in packets}
        if not self._is_free(t_host_ns):
            for name, packet in packets.items():
                if known[name].is_late(packet.number) or known[name].is_repeated(packet):
                    raise RefusedError("duplicate_id")
        self._source, self._t_host_ns = source or self._source, t_host_ns
        self._profiles |= known
        is_whole = {name: self._taken(known[name], packet, t_host_ns) for name, packet in packets.items()}
        chosen = self._chosen()
        if chosen not in packets and not (chosen == "ptr" and "bnd" in packets):
            raise RefusedError("foreign")
        if not is_whole.get(chosen, False):
            return ()
        return (self._touch_frame(self._instant_ns(chosen, t_host_ns)),)

    def _require_source(self, elements: list[bytes], t_host_ns: int) -> str:
        """Return the source that a datagram names, before anything else of it is decoded. Raises RefusedError."""
        source = ""
        for element in elements:
            if element.startswith(b"/tuio2/frm\0") and len(element) <= _LONGEST_SET:
                source = next((one for one in osc.decoded(element).arguments if isinstance(one, str)), source)
            elif element.startswith(b"/tuio/") and b"\0,ss\0source\0" in element[:40]:
                match osc.decoded(element).arguments:
                    case ["source", str(name)]:
                        source = name
        if source and self._source and source != self._source:
            if not self._is_free(t_host_ns):
                raise RefusedError("foreign")
            self._change_source(source)
        return source

    def _is_free(self, t_host_ns: int) -> bool:
        """Whether another source may send."""
        return self._t_host_ns is None or not 0 <= t_host_ns - self._t_host_ns < SILENT_NS

    def _packets(self, elements: list[bytes]) -> dict[str, _Packet]:
        """Return what a datagram says, by profile. Raises OscError."""
        packets: dict[str, _Packet] = {}
        for element in elements:
            version, _, profile = element[: element.find(b"\0")].rpartition(b"/")
            name = profile.decode("ascii", "replace")
            is_list = name == "alv" or b"\0alive\0" in element
            if version == b"/tuio2" and name in ("frm", "ptr", "bnd", "tok", "alv"):
                if is_list or len(element) <= _LONGEST_SET:
                    self._take_2(packets, name, osc.decoded(element).arguments, has_time=element[14:15] == b"t")
            elif version == b"/tuio" and name in PROFILES[1:4]:
                if is_list or len(element) <= _LONGEST_SET:
                    self._take_1(packets, name, osc.decoded(element).arguments)
            elif version in (b"/tuio", b"/tuio2"):
                self._counts["other_profiles"] += 1
        return packets

    def _take_1(self, packets: dict[str, _Packet], name: str, arguments: list[osc.Argument]) -> None:
        """Take a message of TUIO 1.1."""
        packet = packets.get(name) or _Packet()
        match arguments:
            case ["alive", *ids]:
                packet.alive = _ids(ids)
            case ["set", session, *numbers]:
                height = _number(numbers[2]) if name == "25Dcur" and len(numbers) > 2 else 0.0
                self._set(packet, session, numbers, touching=height <= _HOVER)
            case ["fseq", number] if (whole := _whole(number)) is not None:
                packet.number, packet.is_ended = whole, True
            case ["source", *_]:
                pass
            case _:
                return
        packets[name] = packet

    def _take_2(self, packets: dict[str, _Packet], name: str, arguments: list[osc.Argument], *, has_time: bool) -> None:
        """Take a message of TUIO 2.0."""
        session = _whole(arguments[0]) if arguments else None
        if name == "alv":
            alive = _ids(arguments)
            self._tokens &= set(alive)
            for profile in ("ptr", "bnd"):
                if profile == "bnd" or profile in packets or profile in self._profiles:
                    packet = packets.setdefault(profile, _Packet())
                    packet.alive, packet.number, packet.is_ended = alive, self._frame_2, True
            return
        if session is None or len(arguments) < 2:
            return
        packet = packets.setdefault("bnd", _Packet())
        if name == "frm":
            self._frame_2 = session or -1  # 0: out of order
            self._stamp_ns = stamp_ns if has_time and isinstance(stamp_ns := arguments[1], int) else 0
        elif name == "tok":
            self._counts["other_profiles"] += 1
            if len(self._tokens) < osc.MAX_ARGUMENTS:
                self._tokens.add(session)
        elif name == "bnd" and session not in self._tokens:
            self._set(packet, session, arguments[1:])
        elif name == "ptr" and len(arguments) >= 9:  # x, y, angle, shear, radius, press
            pressure = _number(arguments[8])
            packet = packets.setdefault("ptr", _Packet())
            self._set(packet, session, arguments[3:], pressure, touching=not pressure < 0.0)

    def _set(
        self,
        packet: _Packet,
        session: osc.Argument,
        numbers: list[osc.Argument],
        pressure: float = 0.0,
        *,
        touching: bool = True,
    ) -> None:
        """Take a contact's place, if its numbers are some."""
        number = _whole(session)
        x, y = (_number(numbers[0]), _number(numbers[1])) if len(numbers) > 1 else (math.nan, math.nan)
        if number is None or not (abs(x) <= _MOST_FAR and abs(y) <= _MOST_FAR):
            self._counts["outside"] += 1
            return
        self._counts["hovering"] += not touching
        pressure_frac = min(max(pressure, 0.0), 1.0) if math.isfinite(pressure) else 0.0
        packet.places[number] = _Place(x, y, pressure_frac, touching)

    def _taken(self, known: _Profile, packet: _Packet, t_host_ns: int) -> bool:
        self._counts["unended"] += known.is_open and packet.alive is not None and not known.ends_by_alive
        return known.take(packet, t_host_ns)

    def _chosen(self) -> str:
        """Return the profile that the contacts are of: the first one that the source sends."""
        return next((name for name in PROFILES if name in self._profiles), "")

    def _instant_ns(self, chosen: str, t_host_ns: int) -> int:
        """Return when a frame was sampled: as its own time says, if that goes on, or when its first datagram came."""
        stamp_ns, last_ns = self._stamp_ns, self._t_stamp_ns
        if chosen in ("ptr", "bnd") and stamp_ns > 1_000_000_000 and stamp_ns != last_ns:
            self._t_stamp_ns = stamp_ns
            return self._clock.instant_ns(stamp_ns, None, t_host_ns)
        known = self._profiles[chosen]
        return known.t_number_ns if known.parts > 1 else t_host_ns

    def _touch_frame(self, t_ns: int) -> TouchFrame:
        known = self._profiles.get(self._chosen())
        shown = [] if known is None else list(known.shown.items())[:MAX_CONTACTS]
        self._counts["contacts"] += sum([place.touching for _, place in shown])
        return TouchFrame(t_ns, tuple([self._contact(number, place) for number, place in shown]), False)

    def _contact(self, number: int, place: _Place) -> Contact:
        raw_x, raw_y = round(place.x * SPAN_RAW), -round(place.y * SPAN_RAW)
        x_mm, y_mm = self._plate_map.at(raw_x, raw_y)
        return Contact(number, x_mm, y_mm, 0.0, 0.0, 0.0, place.pressure_frac, place.touching, 1, raw_x, raw_y)


def _whole(argument: osc.Argument) -> int | None:
    """Return an id or a frame's number, which some senders give as a float; None for what is none."""
    if isinstance(argument, float) and argument.is_integer():
        argument = int(argument)
    if not isinstance(argument, int):
        return None
    return argument if abs(argument) <= _MOST_ID else argument & _MOST_ID


def _number(argument: osc.Argument) -> float:
    return math.nan if isinstance(argument, str) else float(argument)


def _ids(arguments: list[osc.Argument]) -> list[int]:
    return list(dict.fromkeys(number for one in arguments if (number := _whole(one)) is not None))


def surface(width_mm: float, height_mm: float) -> Pad:
    """Return the pad that a tracked surface of this size is."""
    size = PadGeometry(0, SPAN_RAW, -SPAN_RAW, 0, width_mm, height_mm)
    return Pad(MODEL, "TUIO tracker", "tuio", size, PERIOD_NS, source="tuio")


FAMILY: Final[Family] = Family((), {"tuio": Tuio})
