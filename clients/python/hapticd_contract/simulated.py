"""Fingers on a simulated plate: what a page, or `hapticd_client.sim`, sends to the simulated rig."""

from __future__ import annotations

from typing import Annotated, Final

from msgspec import Meta

from .base import AngleRad, Contract, Mm, Name, Share, problem_of_name

MAX_TOUCHES: Final = 5  # one hand
USUAL_PRESSURE_FRAC: Final = 0.11  # of a resting index finger: 28 of a Magic Trackpad's 253
MOST_AXIS_MM: Final = 40.0

AxisMm = Annotated[float, Meta(ge=0.0, le=MOST_AXIS_MM)]


class SimulatedTouch(Contract, frozen=True, array_like=True):
    """One finger, as a list of its first two to all six numbers: where it is, how hard it presses, and its contact.

    `major_mm` and `minor_mm` are the whole axes of the contact, the major one at `angle_rad` to x; both 0: a disc, as
    the pressure makes it.
    """

    x_mm: Mm
    y_mm: Mm
    pressure_frac: Share = USUAL_PRESSURE_FRAC
    major_mm: AxisMm = 0.0
    minor_mm: AxisMm = 0.0
    angle_rad: AngleRad = 0.0

    def problem(self) -> str:
        return "" if (self.major_mm > 0.0) == (self.minor_mm > 0.0) else ": give both axes of the contact, or none."


class SimulatedTouches(Contract, frozen=True):
    """All fingers of one sender that are down, by name; nil: the scenario's fingers are to lift."""

    fingers: Annotated[dict[Name, SimulatedTouch], Meta(max_length=MAX_TOUCHES)] | None
    sender: Annotated[str, Meta(max_length=32)] = ""

    def problem(self) -> str:
        return problem_of_touches(self.fingers or {})


def problem_of_touches(touches: dict[str, SimulatedTouch]) -> str:
    """Return what is wrong with fingers by name, empty for nothing, as `Contract.problem`."""
    for name, touch in touches.items():
        if problem := problem_of_name(name, ".fingers"):
            return problem
        if problem := touch.problem():
            return f".fingers{problem}"
    return ""
