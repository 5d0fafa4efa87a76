"""Effects and events in the machine: from a client's message to the board, to status and to telemetry."""

from __future__ import annotations

from typing import Any

import pytest
from machine_bench import MS, SLIPPERY, Bench

from hapticd_client.messages import decode_state
from hapticd_contract.states import PlateEvent

CLICK = {"name": "click", "pulse": {"height_um": 1.0, "length_s": 0.05}}


def publish(bench: Bench, *effects: dict[str, Any], ttl_s: float = 5.0, **more: object) -> None:
    bench.send(ttl_s=ttl_s, effects=effects, **more)


def events(published: list[bytes]) -> list[PlateEvent]:
    return [event for state in map(decode_state, published) for event in state.events]


def test_events_are_each_in_one_state_and_carry_the_instant_of_their_cause() -> None:
    bench = Bench(SLIPPERY)
    published: list[bytes] = []
    bench.machine.watch(published.append, bench.t_ns)
    publish(bench, CLICK | {"start": {"cause": "landing"}})
    bench.run(600)
    bench.pad_speaks = False
    bench.run(200)
    landed, begun, ended, lifted = events(published)
    assert [event.kind for event in (landed, begun, ended, lifted)] == ["landed", "begun", "ended", "lifted"]
    assert [event.seq for event in (landed, begun, ended, lifted)] == [1, 2, 3, 4]
    first = next(state for state in map(decode_state, published) if state.events)
    assert landed.t_ns == begun.t_ns == pytest.approx(first.t_ns - first.age_ms * 1e6, abs=2)
    assert (landed.finger, landed.x_mm, landed.y_mm) == (
        1,
        pytest.approx(-30.2, abs=0.02),
        pytest.approx(5.1, abs=0.02),
    )
    assert 50 * MS <= ended.t_ns - begun.t_ns <= 80 * MS
    assert b"events" not in published[-1]


def test_status_lists_effects_and_counts_what_they_did() -> None:
    bench = Bench(SLIPPERY)
    bench.run(600)
    publish(bench, CLICK, {"name": "bye", "pulse": {"height_um": 1, "length_s": 9}, "start": {"cause": "lifting"}})
    bench.run(30)
    body = bench.ask("status")["body"]
    assert body["effects"] == {
        "in_force": [
            {"client": "test", "name": "click", "cause": "now"},
            {"client": "test", "name": "bye", "cause": "lifting"},
        ],
        "playing": 1,
        "begun": 1,
        "skipped": 0,
    }
    assert body["events"] == {"count": 2, "lost": 0}
    assert bench.ask("release", client="test")["body"] == {"released": True}
    assert bench.ask("status")["body"]["effects"]["in_force"] == []
