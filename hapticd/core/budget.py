"""The time budget of a pass: how many fingers take part and how often it may solve for them, before it computes.

A pass must end long before the next report (8 ms), whatever clients ask for. Beyond the budget its reference gets fewer
knots, and where two are too many, fewer fingers take part: those of the lowest priority are left out first, of these
the virtual ones, of these the newest. Figures are ns of machine code with warm caches; cold ones take up to twice as
long. On a slower machine `PassTimes` lowers the share of the budget by what passes took, an input like all others, so
that replay decides the same.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from ..values import FingerKey
from .solver.instant import InstantSolver
from .targets.scene import Scene

BUDGET_NS: Final = 3_500_000.0
OVERRUN_NS: Final = 8_000_000
LONG_NS: Final = 5_000_000  # of a pass: then the share is halved
SHORT_PASSES: Final = 100  # in a row, of less than half of that: then it is doubled
LEAST_FRAC: Final = 1.0 / 64.0
LEAST_SOLVES: Final = 2  # the frame's beginning and its end

_PASS_NS: Final = 40_000.0  # decoding, tracking, gate, frame, status
_FINGER_NS: Final = 35_000.0  # of a finger that takes part: what it perceives, its telemetry
_TOUCHED_NS: Final = 3_000.0  # of a finger that is down: its report and its events
_PLACE_NS: Final = 2_000.0  # of a finger at one instant: its prediction and its own target
_LAYER_WAY_NS: Final = 1_500.0  # of a layer on a finger's way
_LAYER_PLACE_NS: Final = 300.0  # of a layer at one of its places
_EFFECT_NS: Final = 250.0  # of an effect that is felt, at one place, or may start, in a pass


class PassTimes:
    """The share of BUDGET_NS that passes may use on this machine, from the processor time that they took."""

    def __init__(self) -> None:
        self.budget_frac = 1.0
        self._short = 0

    def measured(self, ran_ns: float) -> bool:
        """Take a pass; return whether the share changes."""
        before, self._short = self.budget_frac, self._short + 1 if ran_ns < LONG_NS / 2 else 0
        if ran_ns > LONG_NS:
            self.budget_frac = max(0.5 * before, LEAST_FRAC)
        elif self._short >= SHORT_PASSES:
            self.budget_frac, self._short = min(2.0 * before, 1.0), 0
        return self.budget_frac != before


class Allotment(NamedTuple):
    """The fingers that take part in a pass, in the order in which they came, and how often it may solve for them."""

    keys: list[FingerKey]
    solves: int


def allot(
    scene: Scene,
    solver: InstantSolver,
    keys: list[FingerKey],
    priorities: list[int],
    touched: int,
    budget_ns: float,
    *,
    is_silent: bool,
) -> Allotment:
    """Return what a pass may do for these fingers, while `touched` are down. `is_silent`: the plate has no amplitudes
    that a solve could begin from."""
    layers, effects = float(scene.surfaces.weight), scene.effects
    way_ns = _LAYER_WAY_NS * layers
    fixed_ns = _PASS_NS + touched * (_TOUCHED_NS + way_ns + _EFFECT_NS * len(effects.held))
    places_ns, solve_ns, count = 0.0, 0.0, 0
    ordered = sorted(range(len(keys)), key=lambda n: -priorities[n]) if any(priorities) else list(range(len(keys)))
    for n in ordered:
        place_ns = _PLACE_NS + _EFFECT_NS * len(effects.felt)
        finger_ns = _FINGER_NS + 2.0 * place_ns
        if scene.target_of(keys[n]) is None:
            place_ns += _LAYER_PLACE_NS * layers
            finger_ns += way_ns
        then_solve_ns = places_ns + place_ns + solver.cost_ns(count + 1)
        cold_ns = solver.cold_ns(count + 1) if is_silent else 0.0
        if count > 0 and fixed_ns + finger_ns + cold_ns + LEAST_SOLVES * then_solve_ns > budget_ns:
            break
        fixed_ns, places_ns, solve_ns, count = fixed_ns + finger_ns, places_ns + place_ns, then_solve_ns, count + 1
    solves = int((budget_ns - fixed_ns - (solver.cold_ns(count) if is_silent else 0.0)) / solve_ns)
    kept = keys if count == len(keys) else [keys[n] for n in sorted(ordered[:count])]  # the solver keeps weights by it
    return Allotment(kept, max(solves, LEAST_SOLVES))


def solves_of_request(solver: InstantSolver, fingers: int, budget_ns: float) -> int:
    """Return how many solves for so many fingers a client's request may take: as long as a pass. What each gives is
    judged too, which takes half as long."""
    return int(budget_ns / (1.5 * solver.cost_ns(fingers)))
