"""What telemetry says that fingers feel, against what they feel on the simulated plate when their sample was taken.

In laboratories (`sim.world_tolerances`), where the daemon does not know what is wrong, but how much may be; and in an
ideal world.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import msgpack
import numpy as np
import numpy.typing as npt

from ..sim.fingers.scenarios import SCENARIOS
from ..sim.lockstep import T_START_NS, Run, Simulation
from ..sim.plate.glasses import FINGERTIP, REFERENCE, WIDE
from ..sim.plate.ground_truth import PlateSettings
from ..sim.score import felt, forms_mm, rms, settled, speeds_mm_s
from ..sim.settings import Measured, Settings, in_world
from ..sim.world_tolerances import draw
from ..values import WEBER_FRAC, FloatArray
from . import touching
from .tables import Table, finite_rows

SEEDS = (1, 2, 3, 4, 5, 6)
SECONDS = 3.0
LABORATORY = "laboratory"
_Column = npt.NDArray[Any]
CASES = (
    *((FINGERTIP, 4, scenario) for scenario in ("strokes", "two-of-three", "two-of-four", "two-of-five")),
    (WIDE, 8, "strokes"),
    (WIDE, 8, "two-of-five"),
    (REFERENCE, 2, "strokes"),
    (REFERENCE, 2, "two-of-three"),
)


class FeltReport(NamedTuple):
    """Fingers in states that telemetry reported, (n,) each: what it said, and what is true of the same finger.

    Frictions are counted as targets are; `is_limited` is that of the state.
    """

    target_um: _Column
    contact_um: _Column
    contact_um_low: _Column
    contact_um_high: _Column
    felt_friction: _Column
    felt_friction_low: _Column
    felt_friction_high: _Column
    friction_change: _Column
    misses_target: _Column
    is_limited: _Column
    true_um: _Column
    true_friction: _Column
    true_change: _Column
    truly_misses: _Column

    def of(self, chosen: npt.NDArray[np.bool_]) -> FeltReport:
        """Return some of them."""
        return FeltReport(*[column[chosen] for column in self])


_SAID = FeltReport._fields[1:8]


def reported(
    scenario: str, settings: Settings, seed: int, seconds: float, measured: Measured
) -> tuple[Run, FeltReport]:
    """Play a scenario with a subscriber, and return each finger of each state whose target was constant for a while."""
    simulation = Simulation(SCENARIOS[scenario].build(seed, settings.speed_mm_s), settings, seed, measured)
    sent: list[bytes] = []
    simulation.machine.watch(sent.append, T_START_NS)
    simulation.run(seconds)
    run = simulation.result(scenario)
    counts = settled(run.t_s, run.target_um)
    states, ticks, shares = [], [], []
    for state in map(msgpack.unpackb, sent):
        t_s = (state["t_ns"] - T_START_NS) * 1e-9 - state["age_ms"] * 1e-3
        tick = int(np.searchsorted(run.t_s, t_s))
        if 0 < tick < len(run.t_s):
            states.append(state)
            ticks.append(tick)
            shares.append((t_s - run.t_s[tick - 1]) / (run.t_s[tick] - run.t_s[tick - 1]))
    rms_um, frictions, centres_um = _true(run, simulation, np.array(ticks), np.array(shares))
    curve = simulation.machine.scene.friction_curve
    rows = []
    for index, (state, tick) in enumerate(zip(states, ticks, strict=True)):
        for finger in state["fingers"]:
            places = np.argwhere(run.finger_id == finger["id"])
            if not (len(places) and counts[tick, places[0, 1]] and finger["friction_change"] is not None):
                continue
            actor = int(places[0, 1])
            target_um, friction = float(run.target_um[tick, actor]), float(frictions[index, actor])
            asked = curve.friction(target_um)
            gets_um, gets = float(rms_um[index, actor]), friction
            if not run.has_contacts:
                gets_um = float(centres_um[index, actor])
                gets = curve.friction(gets_um)
            said = [finger[name] for name in _SAID]
            misses = gets_um < 0.9 * target_um or abs(gets / asked - 1.0) > WEBER_FRAC
            is_said = (finger["misses_target"], state["limited"])
            true = (float(rms_um[index, actor]), curve.friction_frac(friction), friction / asked - 1.0, misses)
            rows.append((target_um, *said, *is_said, *true))
    return run, FeltReport(*map(np.array, zip(*rows, strict=True)))


def _true(
    run: Run, simulation: Simulation, ticks: npt.NDArray[np.int_], shares: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return RMS and friction over each contact (T, N), and the amplitude at its centre, between two control ticks."""

    def between(values: _Column) -> _Column:
        share = shares.reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray(values[ticks - 1] * (1.0 - share) + values[ticks] * share)

    fingers_mm, plates_um, t_s = between(run.finger_true_mm), between(run.plate_um), between(run.t_s)
    speeds = speeds_mm_s(run.t_s, run.finger_true_mm)[ticks]
    friction, shapes = simulation.machine.scene.friction_curve.frictions, simulation.world.plate.shapes
    rms_um, frictions = felt(fingers_mm, plates_um, shapes, friction, speeds, forms_mm(run.fingertips, t_s))
    return rms_um, frictions, np.abs(np.einsum("tnp,tp->tn", shapes(fingers_mm), plates_um))


def run(
    *,
    cases: Sequence[tuple[str, int, str]] = CASES,
    seeds: Sequence[int] = SEEDS,
    seconds: float = SECONDS,
    world: str = LABORATORY,
) -> Table:
    """Compare what is said and what is felt, by plate and fingers, in laboratories."""
    rows, everything = [], []
    for plate, modes, scenario in cases:
        found = []
        for seed in seeds:
            settings = in_world(Settings(plate=PlateSettings.of(plate, modes)), draw(world, seed))
            found.append(reported(scenario, settings, seed, seconds, touching.measured(settings, seed))[1])
        both = joined(found)
        everything.append(both)
        for name, chosen in (("sticky", both.target_um == 0.0), ("others", both.target_um > 0.0)):
            rows.append((f"{plate}, {modes} modes, {scenario}: {name}", figures(both.of(chosen))))
    rows.append(("all", figures(joined(everything))))
    return Table(
        name="telemetry",
        title=f"telemetry: what it says against what fingers feel, {world} worlds, seeds {', '.join(map(str, seeds))}",
        default="all",
        rows=finite_rows(rows),
        compared=("ratio", "within_frac"),
        notes=(
            "contact: RMS of `contact_um` as said and as it is; ratio: of both in each state, the median",
            "within: share of the states in which the true one is in the said interval; friction: the same of it",
            "misses: share of the fingers' states in which the finger misses its target; said, and of these that do",
            "(found), of those that do not (false); limited: share in which `limited` was true as a finger missed it",
        ),
    )


def joined(found: Sequence[FeltReport]) -> FeltReport:
    """Return the fingers of all."""
    return FeltReport(*[np.concatenate(columns) for columns in zip(*found, strict=True)])


def figures(found: FeltReport) -> dict[str, float]:
    """Return how well what is said fits what is felt; NaN where there is no such finger."""
    within = (found.contact_um_low <= found.true_um) & (found.true_um <= found.contact_um_high)
    friction = found.true_friction
    misses = found.truly_misses
    return {
        "contact_um": rms(found.contact_um),
        "true_um": rms(found.true_um),
        "ratio": float(np.median(found.contact_um / found.true_um)) if len(within) else float("nan"),
        "within_frac": _share(within),
        "friction_frac": _share((found.felt_friction_low <= friction) & (friction <= found.felt_friction_high)),
        "misses_frac": _share(misses),
        "found_frac": _share(found.misses_target[misses]),
        "false_frac": _share(found.misses_target[~misses]),
        "limited_frac": _share(found.is_limited[misses]),
    }


def _share(are: npt.NDArray[np.bool_]) -> float:
    return float(np.mean(are)) if len(are) else float("nan")
