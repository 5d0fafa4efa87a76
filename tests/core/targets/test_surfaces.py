"""Layers on the plate: which of them a place is on, for how long, and where they are meanwhile."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.targets.scene import Scene
from hapticd.core.targets.surfaces import MAX_CORNERS, MAX_EXPENSIVE, MAX_SURFACES, Predicted
from hapticd_contract.contents import Amplitude, Grating, LevelMap, Noise
from hapticd_contract.surfaces import Circle, Polygon, Surface, VirtualPath
from hapticd_contract.targets import ClientTargets

T0_NS = 1_234_567_890_123
TTL_NS = 500_000_000
ONE, HALF, STILL = Amplitude(1.0), Amplitude(0.5), Amplitude(0.0)
SQUARE = Polygon(((-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0)))
STAR = Polygon(tuple((10.0 * math.cos(0.8 * k * math.pi), 10.0 * math.sin(0.8 * k * math.pi)) for k in range(5)))


def publish(scene: Scene, client: str = "a", t_ns: int = T0_NS, **surfaces: Surface) -> tuple[str, ...]:
    return scene.set_targets(ClientTargets.of(client, TTL_NS, {}, {}, surfaces=surfaces), t_ns)


def a_scene(**surfaces: Surface) -> Scene:
    scene = Scene(w_limit_um=4.0)
    assert publish(scene, **surfaces) == ()
    return scene


def felt_um(scene: Scene, x_mm: float, y_mm: float = 0.0, t_ns: int = T0_NS) -> float:
    return scene.surfaces.amplitude_um(x_mm, y_mm, t_ns)


def stack(scene: Scene) -> list[str]:
    return [layer.name for layer in scene.surfaces.layers]


# --- one layer --------------------------------------------------------------------------------------------------


def test_content_is_felt_within_its_shape_and_bare_glass_elsewhere() -> None:
    scene = a_scene(disc=Surface.of(ONE, Circle(3.0), (20.0, 10.0)), tile=Surface.of(HALF, SQUARE, (-20.0, 0.0)))
    assert [felt_um(scene, *place) for place in ((20.0, 12.9), (22.9, 10.0), (20.0, 13.1))] == [1.0, 1.0, 0.0]
    assert [felt_um(scene, *place) for place in ((-24.9, 4.9), (-15.1, -4.9), (-14.9, 0.0), (0.0, 0.0))] == [
        0.5,
        0.5,
        0,
        0,
    ]


def test_content_and_shape_are_turned_and_scaled_with_the_layer() -> None:
    grating = Grating(period_mm=4.0, angle_rad=0.0, low_um=0.0, high_um=2.0, duty_frac=0.0)
    quarter = Surface.of(grating, SQUARE, (10.0, 0.0), angle_rad=0.5 * math.pi, scale=2.0)
    scene = a_scene(quarter=quarter)
    assert felt_um(scene, 10.0, 0.0) == pytest.approx(2.0)  # a crest through the layer's origin
    assert felt_um(scene, 19.9, 0.0) == pytest.approx(2.0)  # along the crest, which was turned
    assert felt_um(scene, 10.0, 4.0) == pytest.approx(0.0, abs=1e-12)  # half of the doubled period
    assert felt_um(scene, 20.1, 0.0) == 0.0
    corner_mm = 10.0 + 10.0 * math.sqrt(2.0) - 0.1
    assert (
        felt_um(a_scene(turned=Surface.of(ONE, SQUARE, (10.0, 0.0), angle_rad=0.25 * math.pi, scale=2.0)), corner_mm)
        == 1.0
    )


def test_a_map_is_spread_over_the_box_of_its_shape() -> None:
    image = LevelMap(2, 1, b"\x00\xff", low_um=0.0, high_um=1.0)
    for shape in (SQUARE, Circle(5.0)):
        scene = a_scene(image=Surface.of(image, shape, (30.0, 0.0)))
        assert [felt_um(scene, x_mm) for x_mm in (25.5, 30.0, 34.5)] == pytest.approx([0.05, 0.5, 0.95])


# --- several layers ---------------------------------------------------------------------------------------------


def test_the_larger_z_is_on_top_and_of_equals_the_one_that_came_last() -> None:
    scene = a_scene(low=Surface.of(ONE, z=-1), old=Surface.of(HALF, SQUARE), new=Surface.of(STILL, SQUARE))
    publish(scene, "b", newest=Surface.of(Amplitude(0.25), Circle(1.0)))
    assert stack(scene) == ["newest", "new", "old", "low"]
    assert [felt_um(scene, x_mm) for x_mm in (0.0, 3.0, 30.0)] == [0.25, 0.0, 1.0]


def test_a_refreshed_or_changed_layer_keeps_its_place_among_equals() -> None:
    scene = a_scene(old=Surface.of(HALF), new=Surface.of(ONE))
    publish(scene, old=Surface.of(STILL), new=Surface.of(ONE))
    assert stack(scene) == ["new", "old"]


def test_layers_are_blended_into_what_is_below_them() -> None:
    base, top = Surface.of(ONE, SQUARE), Surface.of(HALF, z=1, blend="add")
    assert [felt_um(a_scene(base=base, top=top), x_mm) for x_mm in (0.0, 20.0)] == [1.5, 0.5]
    most = Surface.of(Amplitude(1.2), z=2, blend="max")
    assert [felt_um(a_scene(base=base, top=top, most=most), x_mm) for x_mm in (0.0, 20.0)] == [1.5, 1.2]
    below = Surface.of(Amplitude(1.2), z=0, blend="max")
    assert [
        felt_um(a_scene(base=Surface.of(ONE, SQUARE, z=-1), below=below, top=top), x_mm) for x_mm in (0.0, 20.0)
    ] == [1.7, 1.7]


# --- motion -----------------------------------------------------------------------------------------------------


def test_a_moving_layer_goes_on_from_its_pose_until_the_next_message() -> None:
    scene = a_scene(patch=Surface.of(ONE, Circle(1.0), (-10.0, 0.0), velocity_mm_s=(100.0, 50.0)))
    assert felt_um(scene, 0.0, 5.0, T0_NS + 100_000_000) == 1.0
    assert felt_um(scene, -10.0, 0.0, T0_NS + 100_000_000) == 0.0
    publish(scene, t_ns=T0_NS + 100_000_000, patch=Surface.of(ONE, Circle(1.0), (30.0, 0.0)))
    assert felt_um(scene, 30.0, 0.0, T0_NS + 200_000_000) == 1.0


def test_a_refresh_does_not_start_a_motion_again_but_another_pose_does() -> None:
    moving = Surface.of(ONE, Circle(1.0), velocity_mm_s=(100.0, 0.0))
    scene = a_scene(patch=moving)
    publish(scene, t_ns=T0_NS + 200_000_000, patch=moving)
    assert felt_um(scene, 30.0, 0.0, T0_NS + 300_000_000) == 1.0
    other_content = Surface.of(HALF, Circle(1.0), velocity_mm_s=(100.0, 0.0))
    publish(scene, t_ns=T0_NS + 300_000_000, patch=other_content)
    assert felt_um(scene, 40.0, 0.0, T0_NS + 400_000_000) == 0.5
    publish(scene, t_ns=T0_NS + 400_000_000, patch=Surface.of(HALF, Circle(1.0), velocity_mm_s=(-100.0, 0.0)))
    assert felt_um(scene, -10.0, 0.0, T0_NS + 500_000_000) == 0.5


def test_a_pose_may_be_that_of_an_instant_before_or_after_the_message() -> None:
    for late_ns in (-100_000_000, 100_000_000):
        moving = Surface.of(ONE, Circle(1.0), velocity_mm_s=(100.0, 0.0), t_pose_ns=T0_NS + late_ns)
        assert felt_um(a_scene(patch=moving), -late_ns * 1e-7) == 1.0


# --- owners and time to live ------------------------------------------------------------------------------------


def test_surfaces_are_requests_that_expire_and_own_no_finger() -> None:
    scene = a_scene(mine=Surface.of(ONE))
    assert scene.next_expiry_ns == T0_NS + TTL_NS
    assert scene.requested([1], (), T0_NS) == []
    assert scene.owner_of(1) is None


RING = Polygon(tuple((10.0 * math.cos(0.4 * k), 10.0 * math.sin(0.4 * k)) for k in range(16)))
NOISE = Noise(seed=1, shortest_mm=0.5, longest_mm=50.0, exponent=1.0, mean_um=0.5, rms_um=0.1)
PATH = VirtualPath(((0.0, 0.0), (1.0, 0.0)), 50.0, True)


@pytest.mark.parametrize(
    ("most", "kinds", "late", "refused"),
    [
        (MAX_SURFACES, (Surface.of(ONE),), (), f"at most {MAX_SURFACES} surfaces"),
        (MAX_CORNERS // 16, (Surface.of(ONE, RING),), (Surface.of(ONE, Circle(5.0)),), "corners: 0 are left"),
        (
            MAX_EXPENSIVE,
            (Surface.of(NOISE), Surface.of(ONE, turning_rad_s=6.0), Surface.of(ONE, path=PATH)),
            (Surface.of(ONE, Circle(5.0)),),
            f"at most {MAX_EXPENSIVE} surfaces",
        ),
    ],
)
def test_surfaces_corners_and_weights_are_bounded_and_a_refresh_needs_no_room(
    most: int, kinds: tuple[Surface, ...], late: tuple[Surface, ...], refused: str
) -> None:
    scene = Scene(w_limit_um=4.0)
    for _ in range(2):
        for client in range(-(-most // 16)):
            assert publish(scene, f"client {client}", **{f"s{n}": kinds[n % len(kinds)] for n in range(16)}) == ()
    (refusal,) = publish(scene, "late", one=kinds[0], **{f"late{n}": one for n, one in enumerate(late)})
    assert refused in refusal
    assert len(scene.surfaces.layers) == most + len(late)


# --- edges ------------------------------------------------------------------------------------------------------

numbers = st.floats(-60.0, 60.0)


def edges_of(scene: Scene, predicted_mm: Predicted, t_ns: int, span_ns: int) -> list[int]:
    return scene.surfaces.edges_ns(scene.surfaces.along(predicted_mm, t_ns, span_ns).crossings, t_ns, 0.02)


@given(
    st.sampled_from([SQUARE, STAR, Circle(7.0)]),
    st.tuples(numbers, numbers),
    st.tuples(numbers, numbers),
    st.floats(-6.0, 6.0),
    st.sampled_from([0.5, 1.0, 3.0]),
    st.tuples(st.floats(-300.0, 300.0), st.floats(-300.0, 300.0)),
)
def test_what_a_finger_feels_changes_at_the_edges_that_were_found_and_nowhere_else(
    shape: Circle | Polygon,
    start_mm: tuple[float, float],
    speed_mm_s: tuple[float, float],
    angle_rad: float,
    scale: float,
    velocity_mm_s: tuple[float, float],
) -> None:
    scene = a_scene(one=Surface.of(ONE, shape, angle_rad=angle_rad, scale=scale, velocity_mm_s=velocity_mm_s))

    def predicted_mm(t_ns: int) -> tuple[float, float]:
        since_s = (t_ns - T0_NS) * 1e-9
        return start_mm[0] + 10.0 * speed_mm_s[0] * since_s, start_mm[1] + 10.0 * speed_mm_s[1] * since_s

    edges_ns = edges_of(scene, predicted_mm, T0_NS, 17_000_000)
    changes_ns = [
        t_ns
        for t_ns in range(0, 17_000_000, 100_000)
        if felt_um(scene, *predicted_mm(T0_NS + t_ns), T0_NS + t_ns)
        != felt_um(scene, *predicted_mm(T0_NS + t_ns + 100_000), T0_NS + t_ns + 100_000)
    ]
    found_ns = edges_ns[::2]
    for t_ns in changes_ns:
        assert any(t_ns - 4_000 <= edge_ns < t_ns + 100_000 for edge_ns in found_ns)
    for before_ns, after_ns in zip(edges_ns[::2], edges_ns[1::2], strict=True):
        assert after_ns - before_ns == 4_000


def test_a_layer_walks_its_path_and_a_refreshed_one_goes_on() -> None:
    path = VirtualPath(((0.0, 0.0), (30.0, 0.0)), 100.0, loop=True)
    scene = a_scene(patch=Surface.of(ONE, Circle(1.0), path=path))
    for after_ms, x_mm in ((0, 0.0), (100, 10.0), (250, 25.0), (400, 20.0), (700, 10.0)):
        t_ns = T0_NS + after_ms * 1_000_000
        assert [felt_um(scene, x_mm + aside_mm, 0.0, t_ns) for aside_mm in (0.0, 0.9, 1.1)] == [1.0, 1.0, 0.0]
        publish(scene, t_ns=t_ns, patch=Surface.of(HALF if after_ms == 400 else ONE, Circle(1.0), path=path))
        publish(scene, t_ns=t_ns, patch=Surface.of(ONE, Circle(1.0), path=path))


def test_a_finger_that_a_turning_layer_only_touches_is_found_both_ways() -> None:
    """At the frame's ends the layer is away: it turns back in between."""
    path = VirtualPath(((0.0, 0.0), (10.0, 0.0)), 1000.0, loop=True)  # reaches 10 mm after 10 ms
    scene = a_scene(patch=Surface.of(ONE, Circle(2.0), path=path))
    way = scene.surfaces.along(lambda _t_ns: (11.0, 0.0), T0_NS + 5_000_000, 10_000_000)
    edges_ns = scene.surfaces.edges_ns(way.crossings, T0_NS + 5_000_000, 0.02)
    assert [edge_ns * 1e-6 for edge_ns in edges_ns] == pytest.approx([4.0, 4.0, 6.0, 6.0], abs=0.005)
