"""What a finger gets from the surfaces under it: from its first report on, and with a knot at every edge."""

from __future__ import annotations

from itertools import pairwise

import pytest
from pipeline_bench import (
    FOREVER_NS,
    LEFT_HALF,
    LINK_NS,
    MS,
    ONE,
    PERIOD_NS,
    SLIPPERY,
    STICKY,
    STILL,
    Bench,
    amplitude_um,
)

from hapticd.values import Knot, Tick
from hapticd_contract.contents import Grating
from hapticd_contract.surfaces import Circle, Polygon, Surface, VirtualPath
from hapticd_contract.targets import ClientTargets

Y_MM = 5.1


@pytest.fixture
def bench() -> Bench:
    return Bench()


def publish(bench: Bench, ttl_ns: int = FOREVER_NS, **surfaces: Surface) -> None:
    assert bench.scene.set_targets(ClientTargets.of("test", ttl_ns, {}, {}, surfaces=surfaces), bench.t_ns) == ()


def stroke(bench: Bench, speed_mm_s: float, from_mm: float, reports: int) -> list[Tick]:
    step_mm = speed_mm_s * PERIOD_NS * 1e-9
    return [bench.report((from_mm + step_mm * n, Y_MM)) for n in range(reports)]


def test_the_first_report_of_a_finger_on_a_surface_makes_its_frame(bench: Bench) -> None:
    publish(bench, disc=Surface.of(ONE, Circle(5.0), SLIPPERY))
    tick = bench.report(SLIPPERY, STICKY)
    assert tick.drive.t_apply_ns == bench.t_ns + LINK_NS
    assert tick.horizon_ns == 10 * MS + LINK_NS
    assert [point.target_um for point in tick.points] == [1.0, 0.0]
    for knot in (0, -1):
        assert amplitude_um(tick, knot, SLIPPERY) == pytest.approx(1.0, abs=1e-9)
        assert amplitude_um(tick, knot, STICKY) < 1e-12  # on no surface: bare glass


def test_a_finger_s_own_target_wins_and_when_it_ends_the_surface_is_felt(bench: Bench) -> None:
    publish(bench, all=Surface.of(ONE))
    bench.report(SLIPPERY, STICKY)
    bench.scene.set_targets(ClientTargets.of("other", FOREVER_NS, {1: STILL}, {}), bench.t_ns)
    assert [point.target_um for point in bench.report(SLIPPERY, STICKY).points] == [0.0, 1.0]
    bench.scene.release_client("other")
    bench.pipeline.release(bench.scene.expire(bench.t_ns))
    assert [point.target_um for point in bench.report(SLIPPERY, STICKY).points] == [1.0, 1.0]


def test_after_the_last_surface_its_fingers_are_held_still_and_new_ones_are_not(bench: Bench) -> None:
    publish(bench, ttl_ns=3 * PERIOD_NS, all=Surface.of(ONE))
    bench.hold(2, SLIPPERY)
    (point,) = bench.report(SLIPPERY).points  # its time is up
    assert (point.key, point.target_um) == (1, 0.0)
    assert [point.key for point in bench.report(SLIPPERY, STICKY).points] == [1]


def test_a_resting_finger_needs_new_frames_only_on_a_moving_surface(bench: Bench) -> None:
    publish(bench, disc=Surface.of(ONE, Circle(5.0), SLIPPERY))
    assert [tick.drive is None for tick in bench.hold(4, SLIPPERY)][-1]
    publish(bench, disc=Surface.of(ONE, Circle(5.0), SLIPPERY, velocity_mm_s=(300.0, 0.0)))
    targets_um = [tick.points[0].target_um for tick in bench.hold(4, SLIPPERY)]
    assert (targets_um[0], targets_um[-1]) == (1.0, 0.0)


# --- knots at edges ---------------------------------------------------------------------------------------------


def steps(tick: Tick) -> list[tuple[Knot, Knot]]:
    """Pairs of knots that are one grain of time apart."""
    knots = () if tick.drive is None else tick.drive.knots
    return [(left, right) for left, right in pairwise(knots) if right.dt_ns - left.dt_ns == 4_000]


def crossing_mm(bench: Bench, tick: Tick, layer: str) -> list[float]:
    """How far from the edge x = 0 of a layer the finger is predicted to be at each step."""
    (found,) = (one for one in bench.scene.surfaces.layers if one.name == layer)
    t_ns = [tick.drive.t_apply_ns + left.dt_ns for left, _ in steps(tick)]
    places_mm = [(*bench.pipeline._fingers.predicted_mm(1, one_ns), one_ns) for one_ns in t_ns]
    return [found.local_mm(*place_mm)[0] * found.surface.scale for place_mm in places_mm]


@pytest.mark.parametrize("speed_mm_s", [30.0, 100.0, 400.0])
@pytest.mark.parametrize("edge_mm_s", [0.0, 200.0, -200.0])
def test_knots_lie_on_both_sides_of_an_edge_where_it_is_predicted_to_be_crossed(
    speed_mm_s: float, edge_mm_s: float
) -> None:
    bench = Bench()
    reports = 12
    from_mm = 8.0 - speed_mm_s * 0.011 * reports
    edge_mm = 8.0 - edge_mm_s * 0.011 * reports
    publish(bench, left=Surface.of(ONE, LEFT_HALF, (edge_mm, 0.0), velocity_mm_s=(edge_mm_s, 0.0)))
    crossed = 0
    for n in range(2 * reports):
        tick = bench.report((from_mm + speed_mm_s * PERIOD_NS * 1e-9 * n, Y_MM))
        if tick.drive is not None:
            distances_mm = crossing_mm(bench, tick, "left")
            crossed += len(distances_mm)
            assert all(abs(distance_mm) <= 0.1 for distance_mm in distances_mm)
    assert crossed >= 1


def test_a_moving_layer_has_knots_at_its_edges_over_a_resting_finger_in_turns_too() -> None:
    bench = Bench()
    path = VirtualPath(((0.0, Y_MM), (7.0, Y_MM)), 500.0, loop=True)  # over the finger for 8 ms where it turns
    publish(bench, patch=Surface.of(ONE, Circle(5.0), path=path))
    crossed: list[float] = []
    for _ in range(12):
        tick = bench.report((10.0, Y_MM))
        if tick.drive is not None:
            crossed += [abs(x_mm) for x_mm in crossing_mm(bench, tick, "patch")]
    assert len(crossed) >= 6
    assert all(abs(distance_mm - 5.0) <= 0.1 for distance_mm in crossed)


def test_at_an_edge_the_reference_steps_from_one_content_to_the_other(bench: Bench) -> None:
    publish(bench, left=Surface.of(ONE, LEFT_HALF, (8.0, 0.0)))
    found = [(tick, step) for tick in stroke(bench, 100.0, -2.0, 12) for step in steps(tick)]
    assert found
    for tick, (before, after) in found:
        peaks_um = [max(abs(w_um) for w_um in knot.modal_um) for knot in (before, after)]
        assert peaks_um[0] > 0.5
        assert peaks_um[1] == 0.0
        assert len(tick.drive.knots) <= 8


def test_a_patch_narrower_than_the_way_of_a_frame_has_its_four_knots(bench: Bench) -> None:
    publish(bench, thin=Surface.of(ONE, Polygon(((-0.2, -20.0), (0.2, -20.0), (0.2, 20.0), (-0.2, 20.0))), (8.0, 0.0)))
    assert max(len(steps(tick)) for tick in stroke(bench, 200.0, -8.0, 12)) == 2


def test_a_frame_with_more_edges_than_it_has_room_for_keeps_the_earliest() -> None:
    bench = Bench(max_knots=8)
    comb = {f"tooth {n}": Surface.of(ONE, Circle(0.2), (0.5 * n, Y_MM)) for n in range(40)}
    publish(bench, **comb)
    for tick in stroke(bench, 400.0, -2.0, 6):
        if tick.drive is not None:
            assert len(tick.drive.knots) <= 8
            offsets_ns = [knot.dt_ns for knot in tick.drive.knots]
            assert offsets_ns == sorted(set(offsets_ns))


def test_a_texture_on_a_surface_gets_the_knots_of_the_same_target() -> None:
    grating = Grating(period_mm=3.0, angle_rad=0.2, low_um=0.0, high_um=1.0, duty_frac=0.5)
    own, on_plate = Bench(), Bench()
    own.report((-20.0, Y_MM))
    own.set_targets({1: grating})
    publish(on_plate, stripes=Surface.of(grating))
    on_plate.report((-20.0, Y_MM))
    for n in range(1, 8):
        place_mm = (-20.0 + 2.0 * n, Y_MM)
        mine, theirs = own.report(place_mm), on_plate.report(place_mm)
        if n > 1:  # the first frame continues another one
            assert mine.drive == theirs.drive


def test_a_narrow_stripe_between_two_silent_ends_of_a_frame_is_not_passed_over(bench: Bench) -> None:
    bench.report((-2.0, Y_MM))
    bench.set_targets({1: Grating(period_mm=6.0, angle_rad=0.0, low_um=0.0, high_um=1.0, duty_frac=0.1)})
    stroke(bench, 200.0, 1.0, 2)
    ticks = stroke(bench, 200.0, 5.5, 3)
    peaks_um = [max(abs(w_um) for knot in tick.drive.knots for w_um in knot.modal_um) for tick in ticks if tick.drive]
    assert max(peaks_um) > 0.5
