"""Who may decide what a finger feels, and until when."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.friction import FrictionCurve
from hapticd.core.targets.scene import MAX_VIRTUALS, Scene
from hapticd_contract.contents import Amplitude, Content, Grating, LevelMap
from hapticd_contract.surfaces import VirtualPath
from hapticd_contract.targets import ClientTargets

T0_NS = 1_234_567_890_123
TTL_NS = 500_000_000
SLIPPERY, STILL = Amplitude(1.0), Amplitude(0.0)
LINE = VirtualPath(((-40.0, 0.0), (40.0, 0.0)), 50.0, loop=True)
OTHER_LINE = VirtualPath(((0.0, -40.0), (0.0, 40.0)), 50.0, loop=True)


def a_scene(w_limit_um: float = 4.0) -> Scene:
    return Scene(w_limit_um, FrictionCurve.exponential(), (137.5, 137.5))


@pytest.fixture
def scene() -> Scene:
    return a_scene()


def wants(
    client: str, targets: dict[int | str, Content] | None = None, virtuals: dict[str, VirtualPath] | None = None
) -> ClientTargets:
    return ClientTargets.of(client, TTL_NS, targets or {}, virtuals or {})


# --- one client -------------------------------------------------------------------------------------------------


def test_a_message_replaces_all_earlier_targets_of_its_client(scene: Scene) -> None:
    scene.set_targets(wants("a", {1: SLIPPERY, 2: STILL}), T0_NS)
    scene.set_targets(wants("a", {2: SLIPPERY}), T0_NS + 1)
    assert scene.amplitude_um(1, 0.0, 0.0) is None
    assert scene.amplitude_um(2, 0.0, 0.0) == 1.0
    assert scene.expire(T0_NS + 1) == (1,)


@pytest.mark.parametrize(
    "target",
    [
        Amplitude(4.001),
        Grating(5.0, angle_rad=0.0, low_um=0.0, high_um=4.001, duty_frac=0.5),
        Grating(5.0, angle_rad=0.0, low_um=4.001, high_um=0.0, duty_frac=0.0),
        LevelMap(1, 1, b"\x00", 0.0, 4.001),
        Amplitude(float("nan")),
    ],
)
def test_a_target_beyond_the_plate_is_refused_and_the_other_fingers_keep_theirs(target: Content) -> None:
    scene = a_scene()
    (refusal,) = scene.set_targets(wants("a", {1: target, 2: SLIPPERY}), T0_NS)
    assert refusal.startswith("finger 1 cannot have ")
    assert refusal.endswith("ask for at most 4 um.")
    assert scene.amplitude_um(1, 0.0, 0.0) is None
    assert scene.amplitude_um(2, 0.0, 0.0) == 1.0


# --- time to live -----------------------------------------------------------------------------------------------


def test_a_silent_client_loses_its_fingers_when_its_time_is_up_and_not_before(scene: Scene) -> None:
    scene.set_targets(wants("a", {1: SLIPPERY, "ghost": STILL}, {"ghost": LINE}), T0_NS)
    assert scene.next_expiry_ns == T0_NS + TTL_NS
    assert scene.expire(T0_NS + TTL_NS - 1) == ()
    assert scene.amplitude_um(1, 0.0, 0.0) == 1.0
    assert set(scene.expire(T0_NS + TTL_NS)) == {1, "ghost"}
    assert scene.amplitude_um(1, 0.0, 0.0) is None
    assert scene.next_expiry_ns is None
    assert scene.expire(T0_NS + TTL_NS) == ()


def test_released_fingers_are_reported_once_however_they_were_released(scene: Scene) -> None:
    scene.set_targets(wants("a", {1: SLIPPERY, 2: SLIPPERY, 3: SLIPPERY}), T0_NS)
    scene.set_targets(wants("b", {4: SLIPPERY}), T0_NS)
    assert scene.release("a", 1)
    assert not scene.release("a", 4)  # another's
    scene.set_targets(wants("a", {2: SLIPPERY}), T0_NS)
    scene.release_client("b")
    assert scene.expire(T0_NS) == (1, 3, 4)
    assert scene.expire(T0_NS) == ()


# --- several clients --------------------------------------------------------------------------------------------


def test_a_second_client_is_refused_a_finger_by_the_owners_name(scene: Scene) -> None:
    scene.set_targets(wants("first", {1: SLIPPERY}), T0_NS)
    refusals = scene.set_targets(wants("second", {1: STILL, 2: STILL}), T0_NS)
    assert refusals == ("finger 1 is held by 'first': wait until that client releases it.",)
    assert scene.amplitude_um(1, 0.0, 0.0) == 1.0
    assert scene.amplitude_um(2, 0.0, 0.0) == 0.0


# --- virtual fingers --------------------------------------------------------------------------------------------


def test_a_virtual_finger_walks_and_feels(scene: Scene) -> None:
    scene.set_targets(wants("a", {"ghost": STILL}, {"ghost": LINE}), T0_NS)
    assert scene.virtual_names(T0_NS + TTL_NS - 1) == ("ghost",)
    assert scene.virtual_names(T0_NS + TTL_NS) == ()  # though no sweep came yet
    assert scene.virtual_position_mm("ghost", T0_NS + 800_000_000) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert scene.amplitude_um("ghost", 0.0, 0.0) == 0.0


def test_refreshing_a_path_does_not_start_it_anew_but_another_path_does(scene: Scene) -> None:
    scene.set_targets(wants("a", {}, {"ghost": LINE}), T0_NS)
    scene.set_targets(wants("a", {"ghost": STILL}, {"ghost": LINE}), T0_NS + 100)
    assert scene.virtual_position_mm("ghost", T0_NS + 800_000_000) == pytest.approx((0.0, 0.0), abs=1e-9)
    scene.set_targets(wants("a", {"ghost": STILL}, {"ghost": OTHER_LINE}), T0_NS + 200)
    assert scene.virtual_position_mm("ghost", T0_NS + 200) == OTHER_LINE.path_mm[0]


def test_virtual_fingers_are_bounded_and_refreshing_them_needs_no_room(scene: Scene) -> None:
    mine = {f"a{n}": LINE for n in range(MAX_VIRTUALS - 1)}
    assert scene.set_targets(wants("a", {}, mine), T0_NS) == ()
    (refusal,) = scene.set_targets(wants("b", {}, {"b0": LINE, "b1": LINE}), T0_NS)
    assert refusal.startswith("virtual finger 'b1' is one too many")
    assert scene.set_targets(wants("a", {}, mine), T0_NS) == ()
    assert len(scene.virtual_names(T0_NS)) == MAX_VIRTUALS


def test_a_scene_names_whom_to_solve_for_and_how_closely_each_must_be_looked_at(scene: Scene) -> None:
    square = Grating(period_mm=4.0, angle_rad=0.0, low_um=0.0, high_um=1.0, duty_frac=0.25)
    sine = Grating(period_mm=4.0, angle_rad=0.0, low_um=0.0, high_um=1.0, duty_frac=0.0)
    scene.set_targets(wants("a", {1: STILL, 2: square, 5: sine, "ghost": STILL}, {"ghost": LINE, "idle": LINE}), T0_NS)
    assert scene.requested((1, 2, 3, 4), {3}, T0_NS) == [1, 2, 3, "ghost"]
    assert scene.requested((), (), T0_NS + TTL_NS) == []
    assert scene.finest_mm(1) == scene.finest_mm("unknown") == math.inf
    assert (scene.finest_mm(2), scene.finest_mm(5)) == pytest.approx((1.0 / 8.0, 4.0 / 12.0))


# --- whatever clients do ----------------------------------------------------------------------------------------

steps = st.tuples(
    st.sampled_from(["a", "b", "c"]),
    st.dictionaries(st.integers(1, 4), st.sampled_from([STILL, SLIPPERY, Amplitude(9.0)]), max_size=4),
    st.dictionaries(st.sampled_from(["x", "y"]), st.sampled_from([LINE, OTHER_LINE]), max_size=2),
    st.integers(0, TTL_NS),
)


@given(st.lists(steps, max_size=20))
def test_a_finger_always_has_one_connected_owner_or_no_target(
    history: list[tuple[str, dict[int, Content], dict[str, VirtualPath], int]],
) -> None:
    scene, t_ns = a_scene(), T0_NS
    t_said_ns: dict[str, int] = {}
    held_before: set[int | str] = set()
    for client, targets, virtuals, pause_ns in history:
        t_ns += pause_ns
        refusals = scene.set_targets(wants(client, dict(targets.items()), virtuals), t_ns)
        t_said_ns[client] = t_ns
        released = scene.expire(t_ns)
        asked: set[int | str] = {*targets, *virtuals}
        assert len(refusals) == sum(scene.owner_of(key) != client for key in asked)
        held: set[int | str] = {key for key in (1, 2, 3, 4, "x", "y") if scene.owner_of(key) is not None}
        for key in held:
            assert t_ns - t_said_ns[scene.owner_of(key)] < TTL_NS
        for key in (1, 2, 3, 4):
            assert (scene.target_of(key) is not None) == (key in held)
        assert held_before - held <= set(released)
        assert not held & set(released)
        held_before = held
    assert held_before <= set(scene.expire(t_ns + TTL_NS))
    assert scene.next_expiry_ns is None


def test_a_virtual_finger_beside_the_plate_is_refused_and_one_on_its_edge_is_not(scene: Scene) -> None:
    outside = VirtualPath(((0.0, 0.0), (500.0, 0.0)), 50.0, loop=True)
    (refusal,) = scene.set_targets(wants("a", {"far": SLIPPERY}, {"far": outside}), T0_NS)
    expected = "virtual finger 'far' leaves the plate: its path must lie within ±68.75 mm in x and ±68.75 mm in y."
    assert refusal == expected
    assert scene.virtual_names(T0_NS) == ()
    edge = VirtualPath(((-68.75, 68.75), (68.75, -68.75)), 50.0, loop=True)
    assert scene.set_targets(wants("a", {"edge": SLIPPERY}, {"edge": edge}), T0_NS) == ()
