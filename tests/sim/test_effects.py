"""Effects on the simulated plate: what the firmware's own code makes of them under a finger."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hapticd.sim.fingers.scenarios import SCENARIOS
from hapticd.sim.lockstep import T_START_NS, Simulation
from hapticd.sim.settings import Settings
from hapticd_contract.contents import Amplitude
from hapticd_contract.effects import At, Effect, Modulation
from hapticd_contract.surfaces import Surface
from hapticd_contract.targets import ClientTargets


@pytest.mark.parametrize("frequency_hz", [40.0, pytest.param(250.0, marks=pytest.mark.long)])
def test_a_modulation_is_under_the_finger_in_depth_and_phase(frequency_hz: float) -> None:
    simulation = Simulation(
        tuple(replace(one, steps_um=()) for one in SCENARIOS["rest"].build(1, 100.0)), Settings(), 1
    )
    hum = Effect.of(Modulation(frequency_hz, 0.8), start=At(t_ns=T_START_NS + 500_000_000))
    plate = Surface.of(Amplitude(1.0))
    message = ClientTargets.of("test", 5_000_000_000, {}, {}, None, {"plate": plate}, {"hum": hum})
    simulation.machine.set_targets(message, T_START_NS)
    simulation.run(1.2)
    played = simulation.result("rest")
    late = played.t_s > 0.7
    felt_um, t_s = np.abs(played.truth_um[late, 0]), played.t_s[late] - 0.5
    wave = 2.0 * np.mean(felt_um * np.exp(-2j * np.pi * frequency_hz * t_s))
    assert felt_um.mean() == pytest.approx(0.6, abs=0.03)
    assert 2.0 * abs(wave) == pytest.approx(0.8, rel=0.06)
    assert abs(np.angle(wave)) / (2 * np.pi * frequency_hz) < 0.2e-3
    assert played.status["board"]["late_frames"] == 0
