"""Scenarios: motion and targets of the simulated fingers, built from a seed.

`hapticd simulate` and the simulated rig of `hapticd run` and `hapticd demo` play the same scenarios.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from hapticd_contract.simulated import USUAL_PRESSURE_FRAC, SimulatedTouch
from hapticd_contract.surfaces import VirtualPath

from .paths import CirclePath, Line, Path, Rest, Touch, Touches, with_strokes
from .pressing import Repeated, SampledFinger, Tip
from .real_strokes import RealStrokes
from .strokes import strokes_pair

SLIPPERY_UM = 1.0  # the paper's W1
STICKY_UM = 0.0
HALF_UM = 0.5
LAND_S = 0.4  # fingers land, and virtual ones get targets, after the handshake
LIFT_S, LAND_AGAIN_S = 2.5, 3.0  # one finger of "swap" is lifted in between
SWAP_S = 4.0  # when the fingers of "swap" exchange their targets
SPEED_MM_S = 100.0  # the paper's 10 cm/s
RING_MM = 38.0  # from the plate's centre: where three to five fingers circle
PRESSED_FRAC = 0.6  # of the pad's highest: a resting finger presses with 0.1, a firm one beyond a third
STEP_S = 1.0
STEP_POINT_MM = (44.1, 0.0)  # the inner plate's strongest antinode of mode X on the node line of mode Y
STEP_TARGET_UM = 0.518  # |phi_X| there, so that the mode's own amplitude steps to 1 um
REAL, SMOOTH = MOTIONS = ("real", "smooth")  # of strokes: as of recorded hands, or straight between ramps of speed


@dataclass(frozen=True, slots=True)
class Actor:
    """One finger: its path (or that of a virtual finger), its targets, and its contact, where it has one of its own.

    `steps_um` holds (start_s, amplitude_um) in order of time.
    """

    steps_um: tuple[tuple[float, float], ...]
    path: Path | None = None
    virtual: VirtualPath | None = None
    fingertip: Tip | None = None

    def target_um(self, t_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the target at each instant (T,); NaN before the first."""
        starts = np.array([start_s for start_s, _ in self.steps_um])
        levels = np.array([np.nan, *(level_um for _, level_um in self.steps_um)])
        return levels[np.searchsorted(starts, t_s, side="right")]

    def target_at_um(self, t_s: float) -> float | None:
        """Return the target at one instant; None before the first."""
        target_um = None
        for start_s, level_um in self.steps_um:
            if start_s <= t_s:
                target_um = level_um
        return target_um


@dataclass(frozen=True, slots=True)
class Scenario:
    """A named set of actors, made by `build(seed, speed_mm_s)`."""

    name: str
    summary: str
    seconds: float
    build: Callable[[int, float], tuple[Actor, ...]]


def paths_of(actors: Sequence[Actor]) -> list[Path]:
    """Return the paths of the actors that touch the plate."""
    return [actor.path for actor in actors if actor.path is not None]


def with_motion(actors: Sequence[Actor], motion: str) -> tuple[Actor, ...]:
    """Return the same actors with strokes of this motion: each lands at the same place, and keeps its targets."""
    if motion == SMOOTH:
        return tuple(actors)
    return tuple(
        actor if actor.path is None else replace(actor, path=with_strokes(actor.path, RealStrokes.like))
        for actor in actors
    )


def _touching(path: Path, amplitude_um: float) -> Actor:
    """Return a finger that lands with the others and keeps its target."""
    return Actor(((LAND_S, amplitude_um),), path=Touch(path, LAND_S))


def _virtual(path: VirtualPath, amplitude_um: float) -> Actor:
    return Actor(((LAND_S, amplitude_um),), virtual=path)


def strokes(
    seed: int, speed_mm_s: float, targets_um: tuple[float, ...] = (SLIPPERY_UM, STICKY_UM)
) -> tuple[Actor, ...]:
    """Return two fingers; the one that lands further left is the slippery one, as in the examples in `clients/`."""
    landing_s = np.array([LAND_S])
    pair = strokes_pair(seed, speed_mm_s=speed_mm_s)
    slippery, sticky = sorted(pair, key=lambda path: float(path.position_mm(landing_s)[0, 0]))
    return _touching(slippery, targets_um[0]), _touching(sticky, targets_um[1])


def _half_strokes(seed: int, speed_mm_s: float) -> tuple[Actor, ...]:
    return strokes(seed, speed_mm_s, (HALF_UM, STICKY_UM))


def _guided(seed: int, _speed_mm_s: float) -> tuple[Actor, ...]:
    """Two hands in different places at any time."""
    from .guided import HALF_SIZE_MM, GuidedPath  # a service that plays other scenarios loads nothing of the fits

    paths = (
        GuidedPath(RealStrokes(2 * seed + is_second, t_start_s=LAND_S, half_size_mm=HALF_SIZE_MM), is_second, LAND_S)
        for is_second in (False, True)
    )
    return tuple(_touching(path, target_um) for path, target_um in zip(paths, (SLIPPERY_UM, STICKY_UM), strict=True))


def _circles(seed: int, speed_mm_s: float) -> tuple[Actor, ...]:
    phase_rad = 0.7 * seed
    return (
        _touching(CirclePath((-28.0, 4.0), 20.0, speed_mm_s, phase_rad), SLIPPERY_UM),
        _touching(CirclePath((30.0, -6.0), 15.0, -speed_mm_s, 2 * phase_rad), STICKY_UM),
    )


def _rest(seed: int, _speed_mm_s: float) -> tuple[Actor, ...]:
    x_mm, y_mm = np.random.default_rng(seed).uniform(-50, 50, (2, 2))
    return (
        _touching(Rest((-abs(x_mm[0]) - 5.0, y_mm[0])), SLIPPERY_UM),
        _touching(Rest((abs(x_mm[1]) + 5.0, y_mm[1])), STICKY_UM),
    )


def _swap(_seed: int, speed_mm_s: float) -> tuple[Actor, ...]:
    """The fingers pass each other as closely as fingertips can; one lifts and lands again; targets are exchanged."""
    over = Line((-45.0, -12.0), (45.0, -9.0), speed_mm_s)
    under = Line((45.0, -30.0), (-45.0, -27.0), speed_mm_s)
    return (
        Actor(((LAND_S, SLIPPERY_UM), (SWAP_S, STICKY_UM)), path=Touch(over, LAND_S)),
        Actor(
            ((LAND_S, STICKY_UM), (SWAP_S, SLIPPERY_UM)),
            path=Touches((Touch(under, LAND_S, LIFT_S), Touch(under, LAND_AGAIN_S))),
        ),
    )


def _virtual_finger(seed: int, speed_mm_s: float) -> tuple[Actor, ...]:
    """The paper's study: one finger explores, a virtual one moves along a line."""
    slippery, _ = strokes_pair(seed, speed_mm_s=speed_mm_s)
    line = VirtualPath(((-40.0, 25.0), (40.0, -15.0)), 40.0, loop=True)
    return _touching(slippery, SLIPPERY_UM), _virtual(line, STICKY_UM)


def _two_virtual(
    first: tuple[tuple[float, float], ...], second: tuple[tuple[float, float], ...], speed_mm_s: float
) -> tuple[Actor, ...]:
    return (
        _virtual(VirtualPath(first, speed_mm_s, loop=True), SLIPPERY_UM),
        _virtual(VirtualPath(second, speed_mm_s, loop=True), STICKY_UM),
    )


def _paper_figure_10(_seed: int, speed_mm_s: float) -> tuple[Actor, ...]:
    """Two imposed paths that avoid singular positions: no reference approaches its limit."""
    return _two_virtual(((6.0, -47.0), (-47.0, -1.0)), ((36.0, 17.0), (-14.0, -32.0)), 0.3 * speed_mm_s)


def _paper_figure_11(_seed: int, speed_mm_s: float) -> tuple[Actor, ...]:
    """Two imposed paths through seven singular positions each way, a quarter of the time at the limits."""
    return _two_virtual(((-46.0, 9.0), (21.0, -24.0)), ((-41.0, 30.0), (-40.0, -45.0)), 0.3 * speed_mm_s)


def _step(_seed: int, _speed_mm_s: float) -> tuple[Actor, ...]:
    """Figure 7: no load; at 1 s a virtual finger where only mode X moves gets the target that makes W_X 1 um."""
    steps = ((0.0, 0.0), (STEP_S, STEP_TARGET_UM))
    return (Actor(steps, virtual=VirtualPath((STEP_POINT_MM,), 0.0, loop=False)),)


def _both_slip(seed: int, speed_mm_s: float) -> tuple[Actor, ...]:
    """Two slippery fingers on independent strokes, which pass singular positions often."""
    first, second = strokes_pair(seed, speed_mm_s=speed_mm_s)
    return _touching(first, SLIPPERY_UM), _touching(second, SLIPPERY_UM)


def _three(seed: int, speed_mm_s: float) -> tuple[Actor, ...]:
    """One slippery finger, one sticky and one in between, on circles at least 25 mm apart: six modes' worth."""
    centres_mm, amplitudes_um = ((-34.0, -20.0), (34.0, -20.0), (0.0, 34.0)), (SLIPPERY_UM, STICKY_UM, HALF_UM)
    return tuple(
        _touching(CirclePath(centre_mm, 14.0, speed_mm_s, 0.7 * seed + 2.0 * index), amplitude_um)
        for index, (centre_mm, amplitude_um) in enumerate(zip(centres_mm, amplitudes_um, strict=True))
    )


def _mixed(slippery: int, fingers: int) -> Callable[[int, float], tuple[Actor, ...]]:
    """Fingers on circles about the corners of a polygon, at least 21 mm apart; the first are slippery, the others
    sticky."""

    def build(seed: int, speed_mm_s: float) -> tuple[Actor, ...]:
        corners_rad = 2.0 * math.pi * np.arange(fingers) / fingers + 0.5
        centres_mm = RING_MM * np.column_stack((np.cos(corners_rad), np.sin(corners_rad)))
        return tuple(
            _touching(
                CirclePath((x_mm, y_mm), 12.0, speed_mm_s, 0.7 * seed + 2.0 * index),
                SLIPPERY_UM if index < slippery else STICKY_UM,
            )
            for index, (x_mm, y_mm) in enumerate(centres_mm.tolist())
        )

    return build


def _press(_seed: int, _speed_mm_s: float) -> tuple[Actor, ...]:
    """A finger rests in the middle, and presses harder for a third of each second."""
    light, hard = (SimulatedTouch(0.0, 0.0, pressure_frac) for pressure_frac in (USUAL_PRESSURE_FRAC, PRESSED_FRAC))
    at_s = np.array([0.0, 0.4, 0.5, 0.8, 0.9, 1.0])
    touches = (light, light, hard, hard, light, light)
    pressing = Repeated(SampledFinger.of(at_s, touches), period_s=1.0)
    return (replace(_touching(Rest((0.0, 0.0)), SLIPPERY_UM), fingertip=pressing),)


def _hands(_seed: int, _speed_mm_s: float) -> tuple[Actor, ...]:
    return ()


SCENARIOS: dict[str, Scenario] = {
    scenario.name: scenario
    for scenario in (
        Scenario("strokes", "two fingers on random strokes, one slippery, one sticky", 10.0, strokes),
        Scenario("guided", "the same, led over the plate as by `hapticd calibrate touch --guided`", 60.0, _guided),
        Scenario("circles", "the same on circles", 10.0, _circles),
        Scenario("rest", "the same at rest", 5.0, _rest),
        Scenario("swap", "fingers cross, lift, land again and exchange targets", 8.0, _swap),
        Scenario(
            "virtual-finger", "the paper's study: a finger explores, a virtual one is sticky", 10.0, _virtual_finger
        ),
        Scenario("paper-figure-10", "two virtual fingers, references within the limits", 5.0, _paper_figure_10),
        Scenario("paper-figure-11", "two virtual fingers, references at the limits", 5.0, _paper_figure_11),
        Scenario("step", "figure 7: a step of 1 um on one axis, no load", 2.0, _step),
        Scenario("half-strokes", "two fingers on strokes, 0.5 um and 0: what four modes give", 10.0, _half_strokes),
        Scenario("both-slip", "two fingers on random strokes, both slippery", 10.0, _both_slip),
        Scenario("three", "three fingers on circles: slippery, sticky, and half of it", 10.0, _three),
        Scenario("one-of-three", "three fingers on circles, one slippery, two sticky", 10.0, _mixed(1, 3)),
        Scenario("two-of-three", "three fingers on circles, two slippery, one sticky", 10.0, _mixed(2, 3)),
        Scenario("two-of-four", "four fingers on circles, two slippery, two sticky", 10.0, _mixed(2, 4)),
        Scenario("two-of-five", "five fingers on circles, two slippery, three sticky", 10.0, _mixed(2, 5)),
        Scenario("press", "a finger in the middle that presses harder once a second", 5.0, _press),
        Scenario("hands", "no fingers until a user moves some in `hapticd view --sim`", 1.0, _hands),
    )
}
