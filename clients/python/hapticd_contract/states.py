"""Telemetry: the state of the plate, its fingers, and what happened.

Numbers that are not finite are sent as nil, which every language can read. Readers ignore unknown fields, and have the
defaults where an older daemon sends none.
"""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct, field

from .base import PROTOCOL_VERSION


class Perceived(Struct, frozen=True, kw_only=True):
    """What a person perceives at a finger, when the newest sample of it was taken: there its place is measured and the
    plate follows its reference, or moves as the board measures where its voltage ends. What the daemon does not know of
    its mode map, sensors and pad is expected, in quadrature, by section `uncertainty` of its configuration; `_low` and
    `_high` are where the value lies in nine of ten cases, by the same and by how much persons' frictions differ from
    the daemon's curve. Not in it: what the amplifiers put into undriven modes."""

    friction_change: float | None = None
    """its friction over that of its target, both relative to bare glass, minus 1: -0.3 is 30 % more slippery than
    asked. A target's amplitude stands for the friction of an even vibration"""
    contact_um: float | None = None
    """RMS amplitude over its contact"""
    felt_friction: float | None = None
    """mean friction over its contact, on the scale of targets"""
    error_jnd: float | None = None
    """`friction_change` in just noticeable differences of 0.11; nil also on a plate that is driven for points
    (`contact_radius_mm` of `plate` is 0)"""
    bias_jnd: float | None = None
    """mean of `friction_change` / 0.11 since the finger had a target and the daemon a subscriber"""
    median_jnd: float | None = None
    """median and 95 % of its size over that time, up to 20"""
    error_95_jnd: float | None = None
    felt_frac: float | None = None
    """shares of that time within one and two just noticeable differences"""
    within_two_frac: float | None = None
    contact_um_low: float | None = None
    """intervals of nine in ten cases"""
    contact_um_high: float | None = None
    felt_friction_low: float | None = None
    felt_friction_high: float | None = None
    achieved_um_low: float | None = None
    achieved_um_high: float | None = None
    error_jnd_low: float | None = None
    error_jnd_high: float | None = None
    misses_target: bool | None = None
    """it gets less than 0.9 of its target's amplitude, or a friction that is off by more than one just noticeable
    difference: over its contact, on a plate that is driven for points at its centre"""
    contact_major_mm: float | None = None
    """whole axes of its contact, an ellipse; nil where the pad's ellipses are not used: then it is a disc"""
    contact_minor_mm: float | None = None
    contact_angle_rad: float | None = None
    """of the longer axis to the plate's x, anticlockwise"""
    pressure_frac: float | None = None
    """its pressure by the pad's own measure, 0 .. 1: 0 on a pad without one, nil for a virtual finger"""
    area_mm2: float | None = None
    """area of the ellipse that the pad reports, uncalibrated; nil without one"""


class FingerState(Perceived, frozen=True):
    """One finger; nil (None) where nothing was computed, as for a finger without a target."""

    id: int | str
    """as targets name it: a name if `virtual`"""
    x_mm: float
    """its last position"""
    y_mm: float
    predicted_x_mm: float | None
    """its position at the end of the prediction horizon"""
    predicted_y_mm: float | None
    target_um: float | None
    """its target there"""
    achieved_um: float | None
    """the expected amplitude there, by the reference's first knot: RMS over its contact, on a plate that is driven for
    points at its centre"""
    virtual: bool
    """true for a virtual finger"""
    owner: str | None = None
    """the client that owns it"""


class Marker(Struct, frozen=True, omit_defaults=True):
    """A client's label for an instant of its experiment."""

    t_ns: int
    """its arrival at the daemon"""
    client: str
    text: str
    fields: dict[str, bool | int | float | str] = field(default_factory=dict)
    """the same as values by name; omitted if there are none"""


class EventKind(StrEnum):
    """Kind of an event of a finger or an effect."""

    LANDED = "landed"
    LIFTED = "lifted"
    ENTERED = "entered"
    LEFT = "left"
    CROSSED = "crossed"
    PRESSED = "pressed"
    RELEASED = "released"
    BEGUN = "begun"
    ENDED = "ended"


class PlateEvent(Struct, frozen=True, omit_defaults=True):
    """Event of a finger or an effect; what it does not have is omitted."""

    seq: int
    """number of the event: a gap is a lost one"""
    kind: str
    """an EventKind; a newer daemon may have more"""
    t_ns: int
    """instant of its cause"""
    t_device_ns: int | None = None
    """the same on the trackpad's own clock; omitted where no finger is the cause"""
    finger: int | None = None
    """its id"""
    x_mm: float | None = None
    """its place in the newest report"""
    y_mm: float | None = None
    client: str = ""
    """owner of the surface or effect"""
    surface: str = ""
    """its name, of `entered`, `left` and `crossed`"""
    effect: str = ""
    """its name, of `pressed`, `released`, `begun` and `ended`"""


class PlateState(
    Struct,
    frozen=True,
    omit_defaults=True,
    tag_field="v",
    tag=PROTOCOL_VERSION,
    rename={"measured_d_q_um": "measured_um"},
):
    """The state of the plate and all fingers at one instant."""

    instance: int
    """changes when the daemon restarts"""
    seq: int
    """counts the states of one instance"""
    t_ns: int
    """instant on the host's monotonic clock"""
    state: str
    """of the daemon: `IDLE` (board or trackpad missing), `ARMED`, `ACTIVE`, `FAULT` (latched), `STOPPED`"""
    fingers: tuple[FingerState, ...]
    """all fingers down and all virtual ones"""
    modal_um: tuple[float, ...]
    """real part of each mode's reference phasor"""
    limited: bool
    """a mode reached its limit, so some finger misses its target by calculation"""
    age_ms: float
    """age of the newest touch sample"""
    horizon_ms: float
    """prediction horizon from that sample"""
    markers: tuple[Marker, ...] = ()
    """markers since the previous state; omitted if empty"""
    modal_q_um: tuple[float, ...] = ()
    """imaginary part of each mode's reference phasor: 0 unless several fingers slip"""
    measured_d_q_um: tuple[tuple[float, float], ...] | None = None
    """the board's last measurement of each mode, `[real, imaginary]`; empty before the first"""
    misses_target: bool | None = None
    """`misses_target` of any finger"""
    surfaces_version: int | None = None
    """counts changes of the surfaces in force, without refreshes and motion: request `surfaces` when it changes"""
    events: tuple[PlateEvent, ...] = ()
    """events since the previous state, in order; omitted if empty"""
    tick_late_ms: float | None = None
    """delay of the daemon's newest timer tick"""
    missed_ticks: int | None = None
    """timer ticks skipped since the start"""
    pauses: int | None = None
    """garbage collections above 1 ms since the start"""

    @property
    def measured_um(self) -> tuple[complex, ...]:
        """The board's last measurement as phasors; empty before the first."""
        return tuple(complex(d_um, q_um) for d_um, q_um in self.measured_d_q_um or ())
