"""Effects: forms in time, where they are, and what starts them."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Final, Literal

from msgspec import Meta

from .base import Contract, FingerId, Name, Share, SignedUm, Whole, problem_of_name

MIN_LENGTH_S: Final = 0.001
MAX_LENGTH_S: Final = 60.0
MAX_ENVELOPE_POINTS: Final = 256
MAX_FACTOR: Final = 10.0
DEFAULT_RISE_S: Final = 0.002
RELEASE_SHARE: Final = 0.75  # of the threshold, where no release is named

LengthS = Annotated[float, Meta(ge=MIN_LENGTH_S, le=MAX_LENGTH_S)]
InstantS = Annotated[float, Meta(ge=0.0, le=MAX_LENGTH_S)]

# --- forms ------------------------------------------------------------------------------------------------------


class Pulse(Contract, frozen=True):
    """`height_um` added for `length_s`, with a linear rise and fall of `rise_s` each within it; a negative height is a
    dip.

    `rise_s` is at most half of the length, by default 2 ms, or half of the length if that is less.
    """

    height_um: SignedUm
    """added"""
    length_s: LengthS
    rise_s: InstantS | None = None
    """linear rise and fall within the length, at most half of it; default 0.002, if that fits"""

    @property
    def ramp_s(self) -> float:
        """Duration of the rise."""
        return min(DEFAULT_RISE_S, 0.5 * self.length_s) if self.rise_s is None else self.rise_s

    def problem(self) -> str:
        most_s = 0.5 * self.length_s
        if self.ramp_s <= most_s:
            return ""
        return f".rise_s: {self.ramp_s:g} is out of bounds, it must be 0 .. {most_s:g}."


class Envelope(Contract, frozen=True):
    """2 .. 256 points (t_s, value) from 0 s on, for 0.001 s or more, none earlier than the one before it; linear in
    between, two at one instant are a step.

    Values are um that are added, or with `is_factor` factors 0 .. 10 of what the finger feels.
    """

    points: Annotated[tuple[tuple[InstantS, SignedUm], ...], Meta(min_length=2, max_length=MAX_ENVELOPE_POINTS)]
    """`[t_s, value]` in order of time, the first at 0, the last at 0.001 or later; 1024 in all of a message. Linear in
    between, two at one instant are a step"""
    is_factor: bool = False
    """multiplies by values of 0 .. 10; else adds um"""

    def problem(self) -> str:
        points = self.points
        if points[0][0] != 0.0 or points[-1][0] < MIN_LENGTH_S:
            return f".points: must begin at 0 s and last {MIN_LENGTH_S:g} s or more."
        for index, (before, point) in enumerate(pairwise(points), 1):
            if point[0] < before[0]:
                return f".points[{index}]: is earlier than the point before it."
        if self.is_factor:
            for index, (_, value) in enumerate(points):
                if not 0.0 <= value <= MAX_FACTOR:
                    return f".points[{index}]: {value:g} is out of bounds, it must be 0 .. {MAX_FACTOR:g}."
        return ""


class Modulation(Contract, frozen=True):
    """What the finger feels, times 1 - depth/2 + depth/2 * wave. The wave begins at 1 and is within -1 .. 1: a cosine,
    or 1 and -1 for half a period each. Without `length_s` it plays until it is ended."""

    frequency_hz: Annotated[float, Meta(ge=1.0, le=300.0)]
    depth: Share = 1.0
    """multiplies by 1 - depth/2 + depth/2 · wave"""
    shape: Literal["sine", "square"] = "sine"
    """a cosine, or 1 and -1 for half a period each"""
    length_s: LengthS | None = None
    """default: until it is ended"""


Form = Pulse | Envelope | Modulation

# --- starts -----------------------------------------------------------------------------------------------------


class Now(Contract, frozen=True, tag_field="cause", tag="now"):
    """When the message arrives; with another `id` once more."""

    id: Whole = 0
    """another one starts it again; an effect with a length starts once per id above 0, also after it expired"""


class At(Contract, frozen=True, tag_field="cause", tag="at"):
    """At an instant of the daemon's monotonic clock (ns); a late message plays what is left."""

    t_ns: Whole
    """on the daemon's monotonic clock"""


class OnLanding(Contract, frozen=True, tag_field="cause", tag="landing"):
    """Each time a finger lands; that finger feels it."""


class OnLifting(Contract, frozen=True, tag_field="cause", tag="lifting"):
    """Each time a finger lifts; the others feel it."""


class OnEntering(Contract, frozen=True, tag_field="cause", tag="entering"):
    """Each time a finger is predicted to enter one of this client's surfaces; that finger feels it."""

    surface: Name
    """one of the message's own"""


class OnLeaving(Contract, frozen=True, tag_field="cause", tag="leaving"):
    """Each time a finger is predicted to leave one of this client's surfaces; that finger feels it."""

    surface: Name
    """one of the message's own"""


class OnCrossing(Contract, frozen=True, tag_field="cause", tag="crossing"):
    """Each time a finger is predicted to cross the edge of one of this client's surfaces; that finger feels it."""

    surface: Name
    """one of the message's own"""


class OnPressure(Contract, frozen=True, tag_field="cause", tag="pressure"):
    """Each time a finger's pressure (0 .. 1) reaches `threshold`, after it was `release` or less; that finger feels it.

    `release` is by default three quarters of the threshold.
    """

    threshold: Annotated[float, Meta(ge=0.01, le=1.0)]
    release: Share | None = None
    """below the threshold; default three quarters of it"""

    @property
    def release_frac(self) -> float:
        """At which pressure it counts as released."""
        return RELEASE_SHARE * self.threshold if self.release is None else self.release

    def problem(self) -> str:
        return "" if self.release_frac < self.threshold else ".release: must be below the threshold."


Start = Now | At | OnLanding | OnLifting | OnEntering | OnLeaving | OnCrossing | OnPressure
OnEdge = OnEntering | OnLeaving | OnCrossing
NOW: Final = Now()


def cause_of(start: Start) -> str:
    """Return the cause of a start, as messages name it."""
    return str(type(start).__struct_config__.tag)


# --- effects ----------------------------------------------------------------------------------------------------


class Effect(Contract, frozen=True, kw_only=True):
    """A form in time on a finger, on one of the client's surfaces, or on the whole plate; once, or again and again with
    `loops`."""

    name: Name
    """unique in its message"""
    pulse: Pulse | None = None
    """adds a height, with a linear rise and fall"""
    envelope: Envelope | None = None
    """adds a polyline, or multiplies by it"""
    modulation: Modulation | None = None
    """multiplies by a wave"""
    finger: FingerId | None = None
    """where the effect is: a finger, by its id,"""
    surface: Name | None = None
    """or one of the message's own surfaces; default: the whole plate"""
    start: Start = NOW
    """what starts it, see below"""
    loops: bool = False
    """restarts at its end"""

    @classmethod
    def of(cls, form: Form, on: int | str | None = None, start: Start = NOW, *, name: str = "", **more: Any) -> Effect:
        """Return an effect of parts; `on` is a finger's id, the name of a surface, or None for the whole plate."""
        more[_FORMS[type(form)]] = form
        if on is not None:
            more["surface" if isinstance(on, str) else "finger"] = on
        return cls(name=name, start=start, **more)

    @property
    def form(self) -> Form:
        """The one form."""
        form = self.pulse or self.envelope or self.modulation
        assert form is not None
        return form

    @property
    def on(self) -> int | str | None:
        """Its place: a finger's id, the name of a surface, or None for the whole plate."""
        return self.surface if self.finger is None else self.finger

    @property
    def is_endless(self) -> bool:
        """Whether it plays until something ends it."""
        return self.loops or (self.modulation is not None and self.modulation.length_s is None)

    @property
    def surfaces(self) -> list[str]:
        """The names of the surfaces on which it is and which start it."""
        named = [] if self.surface is None else [self.surface]
        return [*named, self.start.surface] if isinstance(self.start, OnEdge) else named

    def problem(self) -> str:
        forms = [(name, form) for name in FORMS if (form := getattr(self, name)) is not None]
        if len(forms) != 1:
            return f": needs exactly one of {', '.join(FORMS)}."
        name, form = forms[0]
        for place, part in ((name, form), ("start", self.start)):
            if problem := part.problem():
                return f".{place}{problem}"
        if self.finger is not None and self.surface is not None:
            return ": is on a finger or on a surface, not on both."
        if self.is_endless and isinstance(self.start, OnLifting | OnCrossing):
            return f": would never end: an effect that starts by {cause_of(self.start)} needs a length."
        return problem_of_name(self.name, ".name")


_FORMS: Final = {Pulse: "pulse", Envelope: "envelope", Modulation: "modulation"}
FORMS: Final = tuple(_FORMS.values())
