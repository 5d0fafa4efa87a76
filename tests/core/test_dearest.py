"""The dearest scenes that clients may ask for, searched for: no pass and no message of them takes the processor 8 ms.

`-s` prints what each situation's dearest scene costs, beside the estimate that decides what a pass leaves out. Scenes
are drawn at random (`dear_scenes`), and the dearest so far are changed in one place again and again, since
what is dear seldom comes together by chance. Each is played to a machine of its own, which measures no slowness: its
budget is that of machine code on the machine of the estimates. Figures are of the processor time of passes in a row,
with warm caches, of which the second longest counts: one may be the host's.
"""

from __future__ import annotations

import random
import time
from typing import Final, NamedTuple

import msgpack
import pytest
from dear_scenes import Scene, changed, scene

from hapticd.bench.recording import RecordedCalls, new_machine, record
from hapticd.bench.timing import no_garbage_collection
from hapticd.config.sections import Config
from hapticd.daemon.machine import Machine
from hapticd.sim.fingers.paths import CirclePath, Touch
from hapticd.sim.fingers.scenarios import LAND_S, Actor
from hapticd.sim.plate.glasses import FINGERTIP, REFERENCE
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.settings import Settings, scheme_config

MOST_MS: Final = 8.0
SCENES: Final = 400
PASSES: Final = 12  # of a scene: 0.13 s
REPEAT_EVERY: Final = 2  # passes between two messages of a client, which changes its surfaces each time
FINGERS: Final = (0, 2, 11)
USERS: Final = (1, 4)
_WARM_PASSES: Final = 2


class Situation(NamedTuple):
    """Fingers on a plate, as a recording, and the configuration of the machine that replays it."""

    recording: RecordedCalls
    config: Config


class Played(NamedTuple):
    """What a scene costs: the second longest pass, the second longest message, and how many knots and fingers passes
    left out."""

    pass_ms: float
    message_ms: float
    left_out: int

    @property
    def cost_ms(self) -> float:
        """The longer of a pass and a message: a pass waits for either."""
        return max(self.pass_ms, self.message_ms)


@pytest.mark.long
@pytest.mark.alone
@pytest.mark.timeout(900)
def test_no_scene_of_one_user_or_four_takes_a_pass_or_a_message_beyond_its_time() -> None:
    """Half of the scenes are drawn, half are changes of the dearest so far."""
    rng, found = random.Random(1), dict[str, tuple[Played, Scene]]()
    situations = {(name, users): one for name, one in _situations().items() for users in USERS}
    with no_garbage_collection():
        for index in range(SCENES):
            name, users = list(situations)[index % len(situations)]
            key, situation = f"{name}, {users} users", situations[name, users]
            known = found.get(key)
            one = scene(rng, users) if known is None or 2 * index < SCENES else changed(rng, known[1])
            played = play_scene(one, situation)
            if known is None or played.cost_ms > known[0].cost_ms:
                again = play_scene(one, situation)  # a busy host makes no scene dear twice
                played = min(played, again, key=lambda one: one.cost_ms)
            if known is None or played.cost_ms > known[0].cost_ms:
                found[key] = played, one
    for key, (played, _) in sorted(found.items()):
        print(f"\n{key:28} {played}", end="")
        assert played.cost_ms <= MOST_MS, key


def play_scene(one: Scene, situation: Situation) -> Played:
    """Play a scene to a new machine, whose telemetry somebody reads. Raises AssertionError where a pass fails."""
    recording, config = situation
    machine = new_machine(recording, config, publish=lambda _: None)
    payloads = [msgpack.packb(message) for message in one.messages]
    passes_ns: list[int] = []
    messages_ns: list[int] = []
    clock_ns = time.thread_time_ns
    for call in recording.calls:
        is_pass = recording.is_timed(call)
        if call.name == "want":
            continue
        if is_pass and len(passes_ns) == PASSES:
            break
        if is_pass and len(passes_ns) % REPEAT_EVERY == 0:
            for index, payload in enumerate(payloads):
                t_ns = clock_ns()
                machine.targets(payload, call.t_ns, f"uid {index % one.users}")
                messages_ns.append(clock_ns() - t_ns)
        t_ns = clock_ns()
        getattr(machine, call.name)(*call.arguments)
        if is_pass:
            passes_ns.append(clock_ns() - t_ns)
    assert not machine.is_failing, "a pass failed"
    pass_ns, message_ns = sorted(passes_ns[_WARM_PASSES:])[-2], sorted(messages_ns)[-2]
    return Played(pass_ns * 1e-6, message_ns * 1e-6, _left_out(machine))


def _left_out(machine: Machine) -> int:
    counters = machine.pipeline.counters
    return counters.left_out_knots + counters.left_out_fingers


def _situations() -> dict[str, Situation]:
    """Return what pad and board say: fingers as points on two modes, and as contacts on four."""
    found = {}
    for fingers in FINGERS:
        actors = tuple(_finger(index) for index in range(fingers))
        for plate in (REFERENCE, FINGERTIP):
            settings = Settings(plate=PlateSettings.of(plate))
            timed = "reports" if fingers else "timer"
            recording = record(actors, settings=settings, seconds=LAND_S + 0.9, timed=timed)
            found[f"{fingers} fingers, {plate}"] = Situation(recording, scheme_config(settings))
    return found


def _finger(index: int) -> Actor:
    centre_mm = (-40.0 + 20.0 * (index % 5), -35.0 + 32.0 * (index // 5))
    return Actor((), path=Touch(CirclePath(centre_mm, 9.0, 300.0, float(index)), LAND_S))
