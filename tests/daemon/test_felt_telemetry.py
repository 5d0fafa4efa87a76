"""What telemetry says that fingers feel, against what they truly feel on the simulated plate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import msgpack
import numpy as np
import numpy.typing as npt
import pytest

from hapticd.bench.loop import measured
from hapticd.sim.fingers.scenarios import SCENARIOS
from hapticd.sim.lockstep import T_START_NS, Run, Simulation
from hapticd.sim.plate.glasses import FINGERTIP, REFERENCE, WIDE
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.score import ellipses_mm, felt, needed_gains, settled
from hapticd.sim.settings import Measured, Settings, in_world
from hapticd.sim.world_tolerances import draw
from hapticd.values import WEBER_FRAC

HONEST_JND = 0.2
IDEAL = {"parasitic_coupling": 0.0, "sensor_crosstalk": 0.0}  # amplifiers and sensors have their own modes only
SAID = (
    *("contact_um", "contact_um_low", "contact_um_high", "felt_friction", "felt_friction_low", "felt_friction_high"),
    *("friction_change", "misses_target"),
)
Columns = dict[str, npt.NDArray[Any]]


def reported(scenario: str, settings: Settings, seed: int, seconds: float, known: Measured) -> Columns:
    """Play a scenario with a subscriber: what each state said of each finger whose target had been constant, and what
    is true of it; frictions are counted as targets are."""
    simulation = Simulation(SCENARIOS[scenario].build(seed, settings.speed_mm_s), settings, seed, known)
    sent: list[bytes] = []
    simulation.machine.watch(sent.append, T_START_NS)
    simulation.run(seconds)
    run, curve = simulation.result(scenario), simulation.machine.scene.friction_curve
    counts, rows = settled(run.t_s, run.target_um), []
    has_contacts = simulation.machine.pipeline.contact_radius_mm > 0.0
    states = [*map(msgpack.unpackb, sent)]
    at_s = np.array([(state["t_ns"] - T_START_NS) * 1e-9 - state["age_ms"] * 1e-3 for state in states])
    ticks = np.searchsorted(run.t_s, at_s)
    inside = np.flatnonzero((ticks > 0) & (ticks < len(run.t_s)))
    all_um, all_frictions, all_centres_um = felt_at(run, simulation, ticks[inside], at_s[inside])
    for place, index in enumerate(inside):
        state, tick = states[index], ticks[index]
        contacts_um, frictions, centres_um = all_um[place], all_frictions[place], all_centres_um[place]
        for finger in state["fingers"]:
            actors = np.flatnonzero(np.any(run.finger_id == finger["id"], axis=0))
            if not (len(actors) and counts[tick, actors[0]] and finger["friction_change"] is not None):
                continue
            actor = actors[0]
            target_um, friction = run.target_um[tick, actor], float(frictions[actor])
            gets_um = contacts_um[actor] if has_contacts else centres_um[actor]
            gets = friction if has_contacts else curve.friction(gets_um)
            asked = curve.friction(target_um)
            misses = gets_um < 0.9 * target_um or abs(gets / asked - 1.0) > WEBER_FRAC
            true = {"true_um": contacts_um[actor], "true_friction": curve.friction_frac(friction)}
            true |= {"true_change": friction / asked - 1.0, "truly_misses": misses, "limited": state["limited"]}
            rows.append({name: finger[name] for name in SAID} | true)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def felt_at(
    run: Run, simulation: Simulation, ticks: npt.NDArray[np.int64], at_s: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], ...]:
    """RMS and friction over each contact, and the amplitude at its centre, at instants before control ticks."""
    share = ((at_s - run.t_s[ticks - 1]) / (run.t_s[ticks] - run.t_s[ticks - 1]))[:, None]
    plates_um = run.plate_um[ticks - 1] * (1.0 - share) + run.plate_um[ticks] * share
    places_mm = run.finger_true_mm
    fingers_mm = places_mm[ticks - 1] * (1.0 - share[..., None]) + places_mm[ticks] * share[..., None]
    curve, shapes = simulation.machine.scene.friction_curve, simulation.world.plate.shapes
    gains = needed_gains(run.t_s, places_mm, curve)[ticks]
    rms_um, frictions = felt(fingers_mm, plates_um, shapes, curve, gains, ellipses_mm(run.fingertips, at_s))
    return rms_um, frictions, np.abs(np.einsum("tnp,tp->tn", shapes(fingers_mm), plates_um))


def joined(found: Sequence[Columns]) -> Columns:
    return {name: np.concatenate([one[name] for one in found]) for name in found[0]}


def within(found: Columns, said: str, true: str) -> float:
    """Share of what is true that is in the said interval."""
    return float(np.mean((found[f"{said}_low"] <= found[true]) & (found[true] <= found[f"{said}_high"])))


def test_on_an_ideal_plate_telemetry_says_what_fingers_feel() -> None:
    settings = Settings(plate=replace(PlateSettings.of(FINGERTIP), **IDEAL))
    modes = GroundTruth(settings.plate).true_mode_map()  # a scan without noise errs by 0.2 % where patches are
    found = joined(
        [reported("strokes", settings, seed, 4.0, measured(settings, seed)._replace(modes=modes)) for seed in (1, 2)]
    )
    said, true = found["friction_change"] / WEBER_FRAC, found["true_change"] / WEBER_FRAC
    assert np.abs(true).max() > 1.0 > np.abs(true).min()  # at some places it is felt as asked, at others not
    assert float(np.mean(np.abs(said - true) <= HONEST_JND)) >= 0.93
    assert within(found, "contact_um", "true_um") >= 0.9


@pytest.mark.long
@pytest.mark.parametrize(
    ("plate", "modes", "scenario", "seeds"),
    [
        (FINGERTIP, 4, "strokes", (1, 2, 3)),
        (FINGERTIP, 4, "two-of-five", (1, 2)),
        (WIDE, 8, "strokes", (1,)),  # half a minute each
        (REFERENCE, 2, "strokes", (1, 2, 3)),
    ],
)
def test_in_laboratories_what_is_felt_is_in_the_interval_that_telemetry_says(
    plate: str, modes: int, scenario: str, seeds: tuple[int, ...]
) -> None:
    settings = [in_world(Settings(plate=PlateSettings.of(plate, modes)), draw("laboratory", seed)) for seed in seeds]
    found = joined(
        [reported(scenario, one, seed, 2.0, measured(one, seed)) for seed, one in zip(seeds, settings, strict=True)]
    )
    assert 0.8 <= np.median(found["contact_um"] / found["true_um"]) <= 1.25
    assert within(found, "contact_um", "true_um") >= 0.85  # of few laboratories; of many 0.9
    assert within(found, "felt_friction", "true_friction") >= 0.85
    misses = found["truly_misses"]
    assert found["misses_target"][misses].mean() > found["limited"][misses].mean() + 0.05  # what `limited` does not say
