"""What one user may take of what all have: another user always finds room."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.targets.scene import Scene
from hapticd.core.targets.shares import HOST, USER_SHARE, left
from hapticd.core.triggers import MAX_CROSSINGS, Events
from hapticd_contract.contents import Amplitude, Noise
from hapticd_contract.effects import Effect, Modulation, OnLanding, Pulse
from hapticd_contract.states import EventKind
from hapticd_contract.surfaces import Circle, Polygon, Surface, VirtualPath
from hapticd_contract.targets import ClientTargets

T0_NS, TTL_NS = 10**15, 10**9
ONE, REST = Amplitude(1.0), VirtualPath(((0.0, 0.0),), 50.0, loop=True)
RING = Polygon(tuple((10.0, 0.1 * k * k) for k in range(16)))
NOISE = Noise(seed=1, shortest_mm=0.5, longest_mm=50.0, exponent=1.0, mean_um=0.5, rms_um=0.1)
ZIGZAG = VirtualPath(tuple((float(k % 2), float(k)) for k in range(64)), 2000.0, loop=True)
DEAR = Surface.of(NOISE, RING, turning_rad_s=6.0, path=ZIGZAG)


def user_of(client: str) -> str:
    """`a.1` and `a.2` are two clients of the user a."""
    return client.split(".")[0]


def apply(scene: Scene, client: str, **content: object) -> tuple[str, ...]:
    fields: dict[str, object] = {"targets": {}, "virtuals": {}, **content}
    return scene.apply(ClientTargets.of(client, TTL_NS, **fields), T0_NS)  # type: ignore[arg-type]


@given(st.floats(1.0, 1e6), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_what_one_user_takes_leaves_a_quarter_for_another(most: float, used: float, own: float) -> None:
    taken = used * own * USER_SHARE * most
    assert left(most, "one", taken, taken) == pytest.approx(USER_SHARE * most - taken)
    assert left(most, "other", USER_SHARE * most, 0.0) == pytest.approx((1.0 - USER_SHARE) * most)
    assert left(most, HOST, taken, taken) == pytest.approx(most - taken)


def test_one_user_with_many_names_leaves_surfaces_effects_and_virtual_fingers_to_another() -> None:
    scene = Scene(w_limit_um=4.0, user_of=user_of)
    refusals: list[str] = []
    for client in range(6):
        refusals += apply(
            scene,
            f"greedy.{client}",
            virtuals={f"v{client}.{n}": REST for n in range(16)},
            surfaces={f"s{n}": Surface.of(ONE, Circle(1.0)) for n in range(16)},
            effects={f"e{n}": Effect.of(Pulse(0.5, 0.1), start=OnLanding()) for n in range(16)},
        )
    assert len(scene.virtuals(T0_NS)) == 12
    assert len(scene.surfaces.layers) == len(scene.effects.held) == 48
    assert all("one user has" in refusal for refusal in refusals)
    other = {"virtuals": {f"w{n}": REST for n in range(4)}, "surfaces": {f"t{n}": Surface.of(ONE) for n in range(16)}}
    assert apply(scene, "other", **other, effects={f"e{n}": Effect.of(Modulation(10.0, 0.5)) for n in range(16)}) == ()


def test_dear_surfaces_of_one_user_leave_time_of_a_pass_to_another_and_the_refusal_says_how_much() -> None:
    scene = Scene(w_limit_um=4.0, user_of=user_of)
    refusals = apply(scene, "greedy.1", surfaces={f"s{n}": DEAR for n in range(16)})
    assert 0 < len(scene.surfaces.layers) < 16
    assert "is too dear: it takes" in refusals[0]
    assert "us are left of 256 us of surfaces at once, one user has 192 of them" in refusals[0]
    assert apply(scene, "greedy.2", surfaces={"s": DEAR}) != ()
    cheap = {f"t{n}": Surface.of(ONE, Circle(5.0)) for n in range(16)}
    assert apply(scene, "other", surfaces=cheap) == ()


def test_a_refreshed_scene_costs_no_more_than_it_did() -> None:
    scene = Scene(w_limit_um=4.0, user_of=user_of)
    apply(scene, "greedy", surfaces={f"s{n}": DEAR for n in range(16)})
    kept = len(scene.surfaces.layers)
    for _ in range(3):
        apply(scene, "greedy", surfaces={f"s{n}": DEAR for n in range(16)})
        assert len(scene.surfaces.layers) == kept
    scene.release_client("greedy")
    assert scene.surfaces.way_ns == scene.surfaces.place_ns == 0.0


def test_one_users_waves_leave_knots_to_another() -> None:
    scene = Scene(w_limit_um=4.0, user_of=user_of)
    apply(scene, "greedy", effects={f"e{n}": Effect.of(Modulation(40.0, 0.5)) for n in range(16)})
    apply(scene, "other", effects={"hum": Effect.of(Modulation(40.0, 0.5))})
    effects = scene.effects
    for held in effects.held:
        effects.start(held, 1, T0_NS)
    playing = [one.held.owner for one in effects.playing]
    assert playing.count("other") == 1
    assert playing.count("greedy") >= 3


def test_crossings_of_one_user_are_lost_before_those_of_another_and_begun_never() -> None:
    events = Events(user_of)
    for n in range(500):
        events.add(EventKind.CROSSED, n, client=f"greedy.{n % 3}")
    for n in range(8):
        events.add(EventKind.ENTERED, n, client="other")
        events.add(EventKind.BEGUN, n, client="other")
        events.add(EventKind.PRESSED, n, client="greedy.1")
        events.add(EventKind.LANDED, n)
    taken = events.take()
    kinds = [(event.kind, event.client.split(".")[0]) for event in taken]
    assert kinds.count((EventKind.CROSSED, "greedy")) == USER_SHARE * MAX_CROSSINGS
    assert kinds.count((EventKind.ENTERED, "other")) == kinds.count((EventKind.BEGUN, "other")) == 8
    assert kinds.count((EventKind.PRESSED, "greedy")) == kinds.count((EventKind.LANDED, "")) == 8
    assert events.lost == 500 - 48
    assert [event.seq for event in taken] == sorted(event.seq for event in taken)
    events.add(EventKind.CROSSED, 1, client="greedy.1")
    assert len(events.take()) == 1


def test_more_events_than_one_state_carries_come_with_the_next() -> None:
    events = Events()
    for n in range(600):
        events.add(EventKind.PRESSED, n)
    taken = [events.take() for _ in range(4)]
    assert [len(some) for some in taken] == [256, 256, 88, 0]
    assert events.lost == 0
