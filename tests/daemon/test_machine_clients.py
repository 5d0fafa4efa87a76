"""What the worst client can cause: nothing on fingers that others hold, and at most the plate's limit anywhere."""

from __future__ import annotations

import math
from typing import Any

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_bench import SLIPPERY, STICKY, Bench, Received, references

from hapticd.daemon.client_gateway import MAX_MARKERS

VICTIM, ATTACKER = "uid 1000", "uid 666"
FINGERS = st.integers(1, 4) | st.sampled_from(["ghost", "walker"])
AMPLITUDES_UM = st.sampled_from([0.0, 1e-300, 4.0, math.nextafter(4.0, 5.0), 1000.0]) | st.floats(0.0, 1000.0)
WISHES = st.one_of(
    st.fixed_dictionaries({"amplitude_um": AMPLITUDES_UM}),
    st.fixed_dictionaries({"friction": st.floats(0.0, 1.0)}),
    st.builds(lambda high: {"grating": {"period_mm": 0.1, "high_um": high}}, AMPLITUDES_UM),
    st.builds(lambda high: {"map": {"width": 1, "height": 1, "levels": b"\xff", "high_um": high}}, AMPLITUDES_UM),
)
ATTACKS = st.fixed_dictionaries(
    {
        "client": st.sampled_from(["study", "attacker", "other"]),
        "ttl_s": st.sampled_from([0.02, 5.0]),
        "targets": st.dictionaries(FINGERS, WISHES, max_size=4).map(
            lambda targets: [{"finger": finger, **target} for finger, target in targets.items()]
        ),
        "virtuals": st.sets(st.sampled_from(["ghost", "walker"])).map(
            lambda names: [{"name": name, "path_mm": [[-30.0, 0.0], [30.0, 0.0]]} for name in sorted(names)]
        ),
        "stamp": st.integers(0, 2**63 - 1),
    }
)


def held(*, is_running: bool = False) -> Bench:
    """The victim holds finger 1 at 1 um and finger 2 at 0 um."""
    bench = Bench(SLIPPERY, STICKY)
    if is_running:
        bench.run(400)
    while len(bench.machine.pipeline.fingers) < 2:
        bench.run(10)
    items = [{"finger": 1, "amplitude_um": 1.0}, {"finger": 2, "amplitude_um": 0.0}]
    bench.send(by=VICTIM, client="study", stamp=100, targets=items)
    assert bench.machine.clients.refused == 0
    return bench


@given(attacks=st.lists(ATTACKS, min_size=1, max_size=4))
@settings(max_examples=8, deadline=None)
def test_no_message_of_another_user_changes_what_a_held_finger_is_to_get(attacks: list[dict[str, Any]]) -> None:
    bench = held()
    before = [bench.machine.scene.target_of(finger) for finger in (1, 2)]
    for attack in attacks:
        bench.send(by=ATTACKER, **attack)
        bench.ask("set", by=ATTACKER, **attack)
        bench.ask("release", by=ATTACKER, client=attack["client"])
        bench.ask("release", by=ATTACKER, client="study", finger=1)
        bench.send(by=ATTACKER, **attack)
    assert [bench.machine.scene.target_of(finger) for finger in (1, 2)] == before
    assert [bench.machine.scene.owner_of(finger) for finger in (1, 2)] == ["study", "study"]


def attacked(bench: Bench, amplitude_um: float) -> list[Received]:
    """What the board receives while virtual fingers of forty clients, of which 15 have room, cross the plate."""
    for n in range(40):
        path = {"name": f"v{n}", "path_mm": [[-60.0 + 3.0 * n, -60.0], [60.0, 60.0 - 3.0 * n]], "speed_mm_s": 2000.0}
        target = {"finger": f"v{n}", "amplitude_um": amplitude_um}
        bench.send(by=ATTACKER, client=f"attacker-{n}", targets=[target], virtuals=[path])
    assert bench.machine.clients.refused == 40 - 15
    return references(bench.run(200))


def test_a_crowd_of_slipping_fingers_gets_at_most_the_plate_s_limit() -> None:
    bench = held(is_running=True)
    limit_um = max(bench.machine.config.limits.w_limit_um)
    said = attacked(bench, limit_um)
    assert len(said) >= 10
    assert 0.0 < max(received.peak_um for received in said) <= limit_um
    still = next(point for point in bench.machine.last_tick.points if point.key == 2)  # type: ignore[union-attr]
    assert still.achieved_um == pytest.approx(0.0, abs=1e-9)


def test_a_crowd_of_still_fingers_can_silence_the_plate_and_no_more() -> None:
    bench = held(is_running=True)
    assert [received.peak_um for received in attacked(bench, 0.0)][-1] == 0.0


def test_a_marker_under_another_user_s_name_is_refused_and_a_free_name_is_taken() -> None:
    bench = held()
    refused = bench.ask("marker", by=ATTACKER, client="study", text="trial 7 begins")
    assert refused["error"] == "The client name 'study' is in use by uid 1000: choose another."
    assert bench.machine.clients.markers == []
    assert bench.ask("marker", by=VICTIM, client="study", text="trial 7 begins")["ok"]
    assert bench.ask("marker", by=VICTIM, client="notes", text="a dog barks")["ok"]
    assert "in use by uid 1000" in bench.ask("marker", by=ATTACKER, client="notes", text="trial 8 begins")["error"]


def test_a_finger_that_has_not_touched_yet_has_no_owner() -> None:
    bench = held()
    future = [{"finger": finger, "amplitude_um": 0.0} for finger in range(3, 19)]
    bench.send(by=ATTACKER, client="greedy", targets=future)
    assert bench.machine.clients.last_refusal == "finger 3 has not touched the plate: use an id from the newest state."
    reply = bench.ask("set", by=ATTACKER, client="greedy", targets=[{"finger": 77, "amplitude_um": 1.0}])
    assert reply["error"] == "finger 77 has not touched the plate: use an id from the newest state."
    assert [bench.machine.scene.owner_of(finger) for finger in (3, 18, 77)] == [None] * 3


@pytest.mark.parametrize("op", ["targets", "set"])
@pytest.mark.parametrize(("waited_ms", "left_ms"), [(0, 500), (300, 200), (500, 0), (9000, 0)])
def test_a_message_that_waited_holds_for_what_is_left_of_its_ttl(op: str, waited_ms: int, left_ms: int) -> None:
    bench = held()
    body = {"client": "study", "ttl_s": 0.5, "stamp": 101, "targets": [{"finger": 2, "amplitude_um": 0.5}]}
    if op == "targets":
        bench.machine.targets(msgpack.packb({"v": 1, **body}), bench.t_ns, VICTIM, waited_ms * 1_000_000)
    else:
        request = {"v": 1, "id": 3, "op": "set", "body": body}
        bench.machine.request(msgpack.packb(request), bench.t_ns, VICTIM, waited_ms * 1_000_000)
    expiry_ns = bench.machine.scene.next_expiry_ns
    assert bench.machine.scene.owner_of(1) is None
    assert (0 if expiry_ns is None else expiry_ns - bench.t_ns) == left_ms * 1_000_000


def test_markers_that_no_state_takes_do_not_pile_up() -> None:
    bench = Bench(SLIPPERY)
    for _ in range(2 * MAX_MARKERS):
        bench.ask("marker", client="study", text="again")
    assert len(bench.machine.clients.markers) == MAX_MARKERS
    bench.run(60)
    assert bench.machine.clients.markers == []
