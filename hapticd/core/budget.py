"""The time budget of a pass: what it will cost is estimated before it computes, and what is too much is left out.

A pass must end long before the next report (8 ms), whatever clients ask for. Its estimate is a sum over what takes
part: fingers, the contents under them, edges on their ways, effects that are felt, and the solves, one or two for a
knot. Where that exceeds the budget the reference gets fewer knots, and where two are too many, fewer fingers take
part: those of the lowest priority are left out first, of these the virtual ones, of these the newest.

Estimates are in ns of machine code on the machine of `tests/core/test_dearest`. `slowness` is how much longer passes
take on this machine, as measured and handed in: it is an input like all others, so that replay decides the same.
"""

from __future__ import annotations

from typing import Final

from ..values import FingerKey
from .solver.instant import InstantSolver
from .targets.scene import Scene
from .targets.surfaces import MAX_REFINED

BUDGET_NS: Final = 3_500_000.0  # of machine code with warm caches; cold ones take up to twice as long
MOST_SLOWNESS: Final = 64.0
OVERRUN_NS: Final = 8_000_000  # of a pass
JUDGED_NS: Final = 1_000_000.0
MEAN_PASSES: Final = 16
LEAST_CHANGE: Final = 1.25
LEAST_SOLVES: Final = 2  # the frame's beginning and its end

_PASS_NS: Final = 40_000.0  # decoding, tracking, gate, frame, status
_FINGER_NS: Final = 35_000.0  # of a finger that takes part, apart from its places: what it perceives, its telemetry
_TOUCHED_NS: Final = 3_000.0  # of a finger that is down: its report and its events
_PREDICTED_NS: Final = 1_000.0
_EFFECT_NS: Final = 250.0  # of an effect that is felt, for a finger's place
_HELD_NS: Final = 150.0  # of an effect that may start, for a finger's pass
_REFINED_NS: Final = 9_000.0  # of a crossing: bisection to a grain of time


class Slowness:
    """How much longer passes take than estimated: a running mean, and at once whatever overran.

    Passes of less than JUDGED_NS say more about cold caches than about a machine.
    """

    def __init__(self) -> None:
        self.adopted = 1.0
        self._mean = 1.0

    def measured(self, ran_ns: float, estimated_ns: float) -> float | None:
        """Take a pass: the processor time that it took, and its estimate. Return what is to be adopted, None for as it
        is."""
        if estimated_ns * self.adopted < JUDGED_NS and ran_ns < OVERRUN_NS:
            return None
        ratio = min(ran_ns / max(estimated_ns, JUDGED_NS), MOST_SLOWNESS)
        self._mean += (ratio - self._mean) / MEAN_PASSES
        if ran_ns >= OVERRUN_NS:
            self._mean = max(self._mean, ratio)
        now = max(self._mean, 1.0)
        if LEAST_CHANGE * self.adopted > now > self.adopted / LEAST_CHANGE:
            return None
        self.adopted = now
        return now


class Allotment:
    """What a pass may do: the fingers that take part in it, and how often it may solve for them."""

    __slots__ = ("fixed_ns", "keys", "solve_ns", "solves")

    def __init__(self, keys: list[FingerKey], solves: int, fixed_ns: float, solve_ns: float) -> None:
        self.keys: Final = keys
        self.solves: Final = solves
        self.fixed_ns: Final = fixed_ns
        self.solve_ns: Final = solve_ns


class PassBudget:
    """Estimates passes of one scene, and says what they may do."""

    def __init__(self, scene: Scene, solver: InstantSolver) -> None:
        self.slowness = 1.0
        self._scene: Final = scene
        self._surfaces: Final = scene.surfaces
        self._effects: Final = scene.effects
        self._solver: Final = solver

    def allot(self, keys: list[FingerKey], priorities: list[int], touched: int, *, is_silent: bool) -> Allotment:
        """Return what a pass may do for these fingers, while `touched` are down. Those of a higher priority come first,
        of equal ones in the order in which they are given.

        `is_silent`: the plate has no amplitudes that a solve could begin from.
        """
        budget_ns = BUDGET_NS / self.slowness
        held_ns = _HELD_NS * len(self._effects.held)
        base_ns = _PASS_NS + touched * (_TOUCHED_NS + self._surfaces.way_ns + held_ns)
        if self._surfaces.has_edges:
            base_ns += MAX_REFINED * (_REFINED_NS + 2.0 * self._surfaces.place_ns)
        fixed_ns, solve_ns, places_ns, count = base_ns, 0.0, 0.0, 0
        felt_ns = _EFFECT_NS * len(self._effects.felt)
        ordered = _by_priority(keys, priorities)
        for key in ordered:
            place_ns = _PREDICTED_NS + self._scene.place_ns(key) + (felt_ns if isinstance(key, int) else 0.0)
            with_it_ns = places_ns + place_ns
            then_fixed_ns = fixed_ns + _FINGER_NS + self._way_ns(key) + 2.0 * place_ns
            then_solve_ns = with_it_ns + self._solver.cost_ns(count + 1)
            cold_ns = self._solver.cold_ns(count + 1) if is_silent else 0.0
            if count > 0 and then_fixed_ns + cold_ns + LEAST_SOLVES * then_solve_ns > budget_ns:
                break
            fixed_ns, solve_ns, places_ns, count = then_fixed_ns, then_solve_ns, with_it_ns, count + 1
        if is_silent and count > 0:
            fixed_ns += self._solver.cold_ns(count)
        solves = max(int((budget_ns - fixed_ns) / solve_ns), LEAST_SOLVES) if solve_ns > 0.0 else LEAST_SOLVES
        allotted = keys
        if count < len(keys):
            kept = ordered[:count]
            allotted = [key for key in keys if key in kept]  # in their order: the solver keeps weights by it
        return Allotment(allotted, solves, fixed_ns, solve_ns)

    def solves_of_request(self, fingers: int) -> int:
        """Return how many solves for so many fingers a client's request may take: as long as a pass. What each
        gives is judged too, which takes half as long."""
        return int(BUDGET_NS / self.slowness / (1.5 * self._solver.cost_ns(fingers)))

    def _way_ns(self, key: FingerKey) -> float:
        """Return what the edges on a finger's way cost: those of surfaces, where it has no target of its own."""
        return self._surfaces.way_ns if isinstance(key, int) and self._scene.target_of(key) is None else 0.0


def _by_priority(keys: list[FingerKey], priorities: list[int]) -> list[FingerKey]:
    """Return the fingers by falling priority, those of equal ones in their order."""
    if not any(priorities):
        return keys
    ordered: list[FingerKey] = []
    for priority in sorted(set(priorities), reverse=True):
        ordered += [keys[n] for n in range(len(keys)) if priorities[n] == priority]
    return ordered
