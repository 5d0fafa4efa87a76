"""The request for what a finger can feel beside the others."""

from __future__ import annotations

from typing import Any

import msgpack
import pytest
from machine_bench import SLIPPERY, STICKY, Bench

from hapticd.daemon.machine import Machine
from hapticd.sim.fingers.scenarios import SCENARIOS
from hapticd.sim.lockstep import T_START_NS, Simulation
from hapticd.sim.plate.glasses import FINGERTIP
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.settings import Settings

SECONDS = 0.5


@pytest.fixture(scope="module")
def machine() -> Machine:
    """A plate for fingertips that two fingers touch."""
    settings = Settings(plate=PlateSettings.of(FINGERTIP))
    simulation = Simulation(SCENARIOS["strokes"].build(1, settings.speed_mm_s), settings, 1)
    simulation.run(SECONDS)
    assert len(simulation.machine.pipeline.fingers) == 2
    return simulation.machine


def asked(machine: Machine, **body: object) -> Any:
    """The reply's friction, or its error."""
    request = {"v": 1, "id": 1, "op": "reach", "body": body}
    reply = msgpack.unpackb(machine.request(msgpack.packb(request), T_START_NS + round(SECONDS * 1e9)))
    return reply["body"]["friction"] if reply["ok"] else reply["error"]


def test_a_finger_and_its_place_have_the_same_reach_but_for_the_finger_itself(machine: Machine) -> None:
    first, second = machine.pipeline.fingers
    low, high = asked(machine, finger=first.finger_id)
    assert 0.0 <= low < high <= 1.0
    crowded = asked(machine, x_mm=second.x_mm, y_mm=second.y_mm)  # where one feels something else already
    assert crowded is None or crowded[1] - crowded[0] < high - low


def test_a_request_changes_nothing_that_is_driven(machine: Machine) -> None:
    before = machine.pipeline.modal_um, machine.pipeline.counters.solves
    first = machine.pipeline.fingers[0].finger_id
    assert asked(machine, finger=first) == asked(machine, finger=first)
    assert (machine.pipeline.modal_um, machine.pipeline.counters.solves) == before


def test_what_is_not_on_the_plate_is_refused_with_a_sentence(machine: Machine) -> None:
    assert asked(machine, finger=77) == "finger 77 does not touch the plate."
    assert asked(machine, finger="ghost") == "there is no virtual finger 'ghost'."
    assert asked(machine, x_mm=500.0, y_mm=0.0) == "x_mm and y_mm: the place must lie on the plate."


def test_a_plate_driven_for_points_refuses_a_reach_query() -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    assert "over contacts" in asked(bench.machine, finger=1)
