"""Long walks of the solver for friction as asked: step after step from the last amplitudes, on two to eight modes.

Walk N is always the same: contacts follow closed ways over the plate and beyond its edge, some on top of each other, a
knot each millisecond. A number that is not finite, a mode beyond its limit by the last bit and a step longer than the
slew allows are failures. The drift is the change of the mean error from the second time around to the last: errors that
add up over the steps would show in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from soak.harness import Findings, judged

from hapticd.bench.tables import Table
from hapticd.core.friction import DEFAULT_FRICTION_CURVE
from hapticd.core.perception import ContactPerception
from hapticd.core.solver.instant import LEAST_STEP_UM, SLEW_UM_NS, AskedPlace, InstantSolver
from hapticd.design.campaign import TaskRunner, one_by_one
from hapticd.sim.plate.glasses import WIDE, find_glass
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.score import CONTACT_RADIUS_MM
from hapticd.values import WEBER_FRAC

MODES: Final = range(2, 9)
MOST_CONTACTS: Final = 5
AROUND_STEPS: Final = 2000  # once around the closed ways
WALK_STEPS: Final = 200_000
STEP_NS: Final = 1_000_000
SAMPLED_STEPS: Final = 50  # between two whose error is taken
BEYOND_FRAC: Final = 0.52  # of the plate's edges: contacts reach 0.02 of them over the edge
VARIANCE_MM2: Final = 0.05
TARGETS_UM: Final = (0.0, 0.0, 0.3, 0.5, 1.0)
MOST_STEP_UM: Final = (LEAST_STEP_UM + SLEW_UM_NS * STEP_NS) * (1.0 + 1e-12)


class Walk(NamedTuple):
    """A task of a campaign."""

    seed: int
    modes: int
    steps: int


def run(steps: int = 1_000_000, campaign: TaskRunner = one_by_one) -> Table:
    """Walk at least so many steps, equally many on each number of modes. Raises HapticdError with the failures if
    there are any."""
    each = math.ceil(steps / len(MODES) / WALK_STEPS)
    walks = [Walk(seed, modes, WALK_STEPS) for seed in range(each) for modes in MODES]
    return judged(
        campaign("walk", walked, walks),
        name="walk",
        title="friction as asked, step after step on closed ways over the wide plate, by modes",
        notes=(
            f"1 to {MOST_CONTACTS} contacts, some on top of each other, over the edge; a knot each millisecond",
            "drift: of the mean error along a closed way, in just noticeable differences",
        ),
    )


class _Walker:
    """One walk in progress: the amplitudes, and what is found on the way."""

    def __init__(self, walk: Walk) -> None:
        plate = GroundTruth(PlateSettings.of(WIDE, walk.modes))
        self._map: Final = plate.true_mode_map()
        self._limits_um: Final = plate.w_limit_um
        self._ways: Final = closed_ways(walk.seed, find_glass(WIDE).size_mm)
        self._solver: Final = InstantSolver(self._map, self._limits_um, contact_radius_mm=CONTACT_RADIUS_MM)
        self._perception: Final = ContactPerception(DEFAULT_FRICTION_CURVE, CONTACT_RADIUS_MM)
        self._modal_um: tuple[complex, ...] = (0j,) * walk.modes
        self.longest_um = self.peak_frac = 0.0

    def step(self, step: int) -> Iterator[str]:
        """Take a step; return a sentence for each violation."""
        places, before_um = self._ways[step % AROUND_STEPS], self._modal_um
        solution = self._solver.solve(places, before_um, STEP_NS, [VARIANCE_MM2] * len(places))
        self._modal_um = tuple(map(complex, solution.modal_um))
        peak_frac = longest_um = 0.0
        for um, old_um, limit_um in zip(self._modal_um, before_um, self._limits_um, strict=True):
            peak_frac, longest_um = max(peak_frac, abs(um) / limit_um), max(longest_um, abs(um - old_um))
            if not abs(um) <= limit_um:  # True for NaN
                yield f"a mode is at {um} um, {abs(um) - limit_um} beyond its limit."
        if not all(map(math.isfinite, solution.achieved_um)):
            yield "what a contact gets is not finite."
        if not longest_um <= MOST_STEP_UM:
            yield f"a step of {longest_um:.6f} um is longer than the slew."
        self.longest_um, self.peak_frac = max(self.longest_um, longest_um), max(self.peak_frac, peak_frac)

    def errors_jnd(self, step: int) -> list[float]:
        """Return how far each contact is from what is asked of it, now, in just noticeable differences."""
        errors = []
        for x_mm, y_mm, target_um in self._ways[step % AROUND_STEPS]:
            felt = self._perception.felt(self._map, x_mm, y_mm, self._modal_um, 1.0).friction
            errors.append(abs(felt / self._perception.asked(target_um, 1.0) - 1.0) / WEBER_FRAC)
        return errors


def walked(walk: Walk) -> Findings:
    """Play one walk."""
    walker, failures = _Walker(walk), list[str]()
    rounds_jnd: list[list[float]] = []
    for step in range(walk.steps):
        failures += [f"walk {walk.seed} on {walk.modes} modes, step {step}: {what}" for what in walker.step(step)]
        if step % AROUND_STEPS == 0:
            rounds_jnd.append([])
        if step % SAMPLED_STEPS == 0:
            rounds_jnd[-1] += walker.errors_jnd(step)
    second, last = rounds_jnd[min(1, len(rounds_jnd) - 1)], rounds_jnd[-1]
    figures = {
        "steps_count": float(walk.steps),
        "longest_step_um": walker.longest_um,
        "peak_limit_frac": walker.peak_frac,
        "drift_jnd": abs(float(np.mean(last) - np.mean(second))),
    }
    return Findings({f"{walk.modes} modes": figures}, failures)


def closed_ways(seed: int, size_mm: tuple[float, float]) -> list[list[AskedPlace]]:
    """Return the places of all contacts, step by step once around: one slippery at least, of three and more two on top
    of each other for a third of the way."""
    random = np.random.default_rng(seed)
    count = 1 + seed % MOST_CONTACTS
    turns, phases_rad = random.integers(1, 4, (count, 2)), random.uniform(0.0, 2.0 * math.pi, (count, 2))
    angles_rad = 2.0 * math.pi * np.arange(AROUND_STEPS)[:, None, None] / AROUND_STEPS * turns + phases_rad
    points_mm = BEYOND_FRAC * np.array(size_mm) * np.sin(angles_rad)
    if count > 2:
        points_mm[: AROUND_STEPS // 3, 2] = points_mm[: AROUND_STEPS // 3, 1]
    targets_um = [1.0, *random.choice(TARGETS_UM, count - 1).tolist()]
    return [
        [(x_mm, y_mm, target_um) for (x_mm, y_mm), target_um in zip(each, targets_um, strict=True)]
        for each in points_mm.tolist()
    ]
