"""Scenes at every cap of the protocol: no pass and no message of them takes the processor 8 ms. `-s` prints the costs.

Each is played to a machine of its own with its whole budget. Figures are of the processor time of passes in a row, with
warm caches, of which the second longest counts: one may be the host's.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from functools import partial
from typing import Final

import msgpack
import pytest
from expensive_scenes import scene

from hapticd.bench.recording import new_machine, record
from hapticd.bench.timing import no_garbage_collection
from hapticd.core.targets.scene import MAX_VIRTUALS
from hapticd.core.targets.surfaces import MAX_CORNERS, MAX_EXPENSIVE, MAX_SURFACES
from hapticd.daemon.machine import Machine
from hapticd.sim.fingers.paths import CirclePath, Touch
from hapticd.sim.fingers.scenarios import LAND_S, Actor
from hapticd.sim.plate.glasses import FINGERTIP, REFERENCE
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.settings import Settings, scheme_config

MOST_MS: Final = 12.0  # 8 on an idle core of 3 GHz; a shared one takes up to half more
SCENES: Final = 12
PASSES: Final = 14  # of a scene: 0.16 s


@pytest.mark.long
@pytest.mark.alone
@pytest.mark.timeout(600)
@pytest.mark.parametrize("plate", [REFERENCE, FINGERTIP])  # points on two modes, contacts on four
@pytest.mark.parametrize("fingers", [0, 2, 11])
def test_no_pass_and_no_message_of_a_scene_at_all_caps_overruns(fingers: int, plate: str) -> None:
    settings = Settings(plate=PlateSettings.of(plate))
    actors = tuple(_finger(index) for index in range(fingers))
    recording = record(actors, settings=settings, seconds=LAND_S + 0.9, timed="reports" if fingers else "timer")
    worst_ms = 0.0
    with no_garbage_collection():
        for seed in range(SCENES):
            machine = new_machine(recording, scheme_config(settings), publish=lambda _: None)
            payloads = [msgpack.packb(message) for message in scene(random.Random(seed))]
            passes_ms, messages_ms = list[float](), list[float]()
            for call in recording.calls:
                if call.name == "set_targets" or len(passes_ms) == PASSES:
                    continue
                if recording.is_timed(call) and len(passes_ms) % 2 == 0:  # clients change their surfaces all the time
                    messages_ms += [_ran_ms(partial(machine.targets, one, call.t_ns)) for one in payloads]
                ran_ms = _ran_ms(partial(getattr(machine, call.name), *call.arguments))
                passes_ms += [ran_ms] if recording.is_timed(call) else []
            worst_ms = max(worst_ms, sorted(passes_ms)[-2], sorted(messages_ms)[-2])
            assert not machine.is_failing
            _assert_full(machine)
    print(f"\n{fingers} fingers, {plate}: {worst_ms:.2f} ms", end="")
    assert worst_ms <= MOST_MS


def _assert_full(machine: Machine) -> None:
    """All that there may be is in force."""
    layers = machine.scene.surfaces.layers
    assert len(layers) == MAX_SURFACES
    assert sum(layer.corners for layer in layers) == MAX_CORNERS
    assert sum(layer.is_expensive for layer in layers) == MAX_EXPENSIVE
    assert len(machine.scene.virtual_names(machine.scene.surfaces.t_expires_ns - 1)) == MAX_VIRTUALS


def _ran_ms(call: Callable[[], object]) -> float:
    t_ns = time.thread_time_ns()
    call()
    return (time.thread_time_ns() - t_ns) * 1e-6


def _finger(index: int) -> Actor:
    centre_mm = (-40.0 + 20.0 * (index % 5), -35.0 + 32.0 * (index // 5))
    return Actor((), path=Touch(CirclePath(centre_mm, 9.0, 300.0, float(index)), LAND_S))
