"""What telemetry says that fingers feel, against what they truly feel on the simulated plate."""

from __future__ import annotations

from dataclasses import replace

import msgpack
import numpy as np
import pytest

from hapticd.bench.sweeps import swept
from hapticd.core.friction import DEFAULT_FRICTION_CURVE
from hapticd.sim.fingers.scenarios import SCENARIOS
from hapticd.sim.lockstep import T_START_NS, Settings, Simulation
from hapticd.sim.plate.glasses import FINGERTIP
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.score import felt, settled
from hapticd.values import WEBER_FRAC

HONEST_JND = 0.2
IDEAL = {"map_noise_frac": 0.0, "parasitic_coupling": 0.0}  # amplifiers drive their own modes only


def errors_jnd(seed: int, seconds: float, plate: dict[str, float]) -> np.ndarray:
    """What telemetry says (n, 2), and what is true of the same finger when its newest sample was taken."""
    glass = replace(PlateSettings.of(FINGERTIP), **plate)
    settings = Settings(plate=glass)
    actors = SCENARIOS["strokes"].build(seed, settings.speed_mm_s)
    simulation = Simulation(actors, settings, seed, swept(glass, seed))
    sent: list[bytes] = []
    simulation.machine.watch(sent.append, T_START_NS)
    simulation.run(seconds)
    run = simulation.result("strokes")
    counts = settled(run.t_s, run.target_um)
    states, fingers_mm, plates_um = [], [], []
    for state in map(msgpack.unpackb, sent):
        t_s = (state["t_ns"] - T_START_NS) * 1e-9 - state["age_ms"] * 1e-3
        tick = int(np.searchsorted(run.t_s, t_s))
        if 0 < tick < len(run.t_s):
            share = (t_s - run.t_s[tick - 1]) / (run.t_s[tick] - run.t_s[tick - 1])
            states.append((tick, state["fingers"]))
            fingers_mm.append(run.finger_true_mm[tick - 1] * (1.0 - share) + run.finger_true_mm[tick] * share)
            plates_um.append(run.plate_um[tick - 1] * (1.0 - share) + run.plate_um[tick] * share)
    _, frictions = felt(np.array(fingers_mm), np.array(plates_um), simulation.world.plate.shapes)
    found = []
    for (tick, fingers), true in zip(states, frictions, strict=True):
        for finger in fingers:
            actor = int(np.argwhere(run.finger_id == finger["id"])[0, 1])
            if counts[tick, actor]:
                asked = DEFAULT_FRICTION_CURVE.friction(run.target_um[tick, actor])
                found.append((finger["error_jnd"], (true[actor] - asked) / (WEBER_FRAC * asked)))
                relative = asked * (1.0 + WEBER_FRAC * finger["error_jnd"])
                assert finger["felt_friction"] == pytest.approx(DEFAULT_FRICTION_CURVE.friction_frac(relative))
    return np.array(found)


def honest_frac(plate: dict[str, float], seeds: tuple[int, ...], seconds: float) -> float:
    said, true = np.concatenate([errors_jnd(seed, seconds, plate) for seed in seeds]).T
    assert np.abs(true).max() > 1.0 > np.abs(true).min()  # at some places it is felt as asked, at others not
    return float(np.mean(np.abs(said - true) <= HONEST_JND))


def test_on_an_ideal_plate_telemetry_says_what_fingers_feel() -> None:
    frac = honest_frac(IDEAL, (1, 2), 4.0)
    print(f"error_jnd within {HONEST_JND} JND of the truth in {frac:.1%} of the fingers' passes")
    assert frac >= 0.95
