"""A touch's way through the core, on a plate whose shapes are sines and with fingers that move as a test says."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pipeline_bench import (
    LINK_NS,
    MS,
    PERIOD_NS,
    PLATE,
    SLIPPERY,
    STICKY,
    Bench,
    CountedPredictor,
    amplitude_um,
    felt_um,
)

from hapticd.core.frame import DrivenFingers, FramePlan
from hapticd.core.solver import solve
from hapticd.core.solver.felt_descent import EVEN_FRAC
from hapticd.core.solver.instant import DERATING_MM2_UM2, LEAST_SHARE
from hapticd.sim.paper_scheme import InverseSolver
from hapticd.values import LinkTiming
from hapticd_contract.contents import Amplitude, Grating
from hapticd_contract.surfaces import VirtualPath


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_one_finger_slips_while_the_other_sticks(bench: Bench) -> None:
    bench.land({SLIPPERY: 1.0, STICKY: 0.0})
    tick = bench.report(SLIPPERY, STICKY)
    assert [point.target_um for point in tick.points] == [1.0, 0.0]
    for knot in (0, -1):
        assert amplitude_um(tick, knot, SLIPPERY) == pytest.approx(1.0, abs=1e-9)
        assert amplitude_um(tick, knot, STICKY) < 1e-12


def test_the_first_knot_is_one_link_from_now_and_a_frame_outlasts_a_lost_report() -> None:
    bench = Bench(frame_duration_ns=17 * MS, loop_delay_ns=2 * MS)
    bench.land({SLIPPERY: 1.0})
    tick = bench.report(SLIPPERY)
    assert tick.drive.t_apply_ns == bench.t_ns + LINK_NS
    assert tick.drive.knots[0].dt_ns == 0
    assert tick.drive.knots[-1].dt_ns == 17 * MS
    assert tick.age_ns == 10 * MS
    assert tick.horizon_ns == 10 * MS + LINK_NS + 2 * MS


def test_frames_outlast_a_report_that_a_slow_pad_loses_and_are_short_on_a_fast_one() -> None:
    bench = Bench(frame_duration_ns=17 * MS)
    bench.period_ns = 16_667_000  # 60 Hz
    bench.land({SLIPPERY: 1.0})
    bench.hold(12, SLIPPERY)
    slid_mm = SLIPPERY[0] + 1.0, SLIPPERY[1]
    tick = bench.report(slid_mm)
    assert tick.drive.knots[-1].dt_ns == 24 * MS

    bench.period_ns = 4 * MS  # 250 Hz: the next report comes soon
    for place in range(40):
        tick = bench.report((slid_mm[0] + 0.2 * place, slid_mm[1]))
    assert tick.drive.knots[-1].dt_ns == 8.5 * MS
    assert bench.pipeline._solver.even_frac == pytest.approx(EVEN_FRAC * 4.0 / 11.0, rel=0.02)


def test_no_finger_is_one_zero_frame_and_then_nothing(bench: Bench) -> None:
    bench.land({SLIPPERY: 1.0})
    assert bench.report(SLIPPERY).drive is not None
    lifted = bench.report()
    assert [knot.modal_um for knot in lifted.drive.knots] == [(0.0, 0.0)]
    assert [tick.drive for tick in bench.hold(5)] == [None] * 5
    assert bench.pipeline.counters.skipped_no_finger == 6


def test_an_ended_target_holds_its_finger_at_zero_while_it_is_down(bench: Bench) -> None:
    bench.land({SLIPPERY: 1.0, STICKY: 1.0})
    bench.report(SLIPPERY, STICKY)
    bench.set_targets({1: Amplitude(1.0)})
    bench.pipeline.release(bench.scene.expire(bench.t_ns))
    tick = bench.report(SLIPPERY, STICKY)
    assert [(point.key, point.target_um) for point in tick.points] == [(1, 1.0), (2, 0.0)]
    bench.scene.release_client("test")
    bench.pipeline.release(bench.scene.expire(bench.t_ns))
    tick = bench.report(SLIPPERY, STICKY)
    assert not any(any(knot.modal_um) for knot in tick.drive.knots)


def test_still_fingers_let_the_last_reference_stand_and_it_equals_a_new_one() -> None:
    bench, never = Bench(), Bench(tolerance_um=1e-12)
    for each in (bench, never):
        each.land({SLIPPERY: 1.0, STICKY: 0.0})
    standing, solved = bench.hold(40, SLIPPERY, STICKY), never.hold(40, SLIPPERY, STICKY)
    assert standing[-1].drive is None
    assert bench.pipeline.counters.skipped_standing > 20
    assert [point.achieved_um for point in standing[-1].points] == [point.achieved_um for point in standing[5].points]
    stands = next(tick.drive for tick in reversed(standing) if tick.drive is not None)
    would = next(tick.drive for tick in reversed(solved) if tick.drive is not None)
    for w_um, exact_um in zip(stands.knots[-1].modal_um, would.knots[-1].modal_um, strict=True):
        assert abs(w_um - exact_um) <= 0.01


def test_resting_ellipses_skip_passes_despite_noise_until_a_finger_presses() -> None:
    bench = Bench(contact_radius_mm=5.0, ellipse_scale=1.15, ellipse_offset_mm=0.8)
    bench.land({SLIPPERY: 1.0, STICKY: 0.0})
    bench.hold(30, SLIPPERY, STICKY)
    skipped = bench.pipeline.counters.skipped_standing
    for step in range(20):
        bench.axes_mm = (8.0 + 0.2 * (step % 2), 7.0 - 0.1 * (step % 3))
        assert bench.report(SLIPPERY, STICKY).drive is None
    assert bench.pipeline.counters.skipped_standing == skipped + 20
    bench.axes_mm = (10.5, 9.0)
    assert bench.report(SLIPPERY, STICKY).drive is not None


@pytest.mark.parametrize("change", ["moves", "target", "lands", "forgotten"])
def test_whatever_changes_ends_the_standing(change: str, bench: Bench) -> None:
    bench.report(SLIPPERY, STICKY)
    bench.set_targets({1: Amplitude(1.0), 2: Amplitude(0.0), 3: Amplitude(0.0)})
    assert bench.hold(30, SLIPPERY, STICKY)[-1].drive is None
    positions = [SLIPPERY, STICKY]
    if change == "moves":
        positions[0] = (SLIPPERY[0] + 2.0, SLIPPERY[1])
    elif change == "target":
        bench.set_targets({1: Amplitude(0.9), 2: Amplitude(0.0)})
    elif change == "lands":
        positions.append((0.0, 40.0))
    else:
        bench.pipeline.invalidate_reference()
    assert bench.report(*positions).drive is not None


def test_two_moving_fingers_are_predicted_4_times_and_once_each_per_knot_between() -> None:
    """Also when their last reference had settled."""
    bench = Bench(make_predictor=CountedPredictor)
    bench.land({SLIPPERY: 1.0, STICKY: 0.0})
    counts = dict[tuple[int, bool], list[int]]()
    for report in range(80):
        before, solves = CountedPredictor.predictions, bench.pipeline.counters.solves
        moved_mm = max(report - 40, 0) ** 2 * 0.01
        tick = bench.report(*((x_mm + moved_mm, y_mm) for x_mm, y_mm in (SLIPPERY, STICKY)))
        kind = bench.pipeline.counters.solves - solves, tick.drive is None
        counts.setdefault(kind, []).append(CountedPredictor.predictions - before)
    assert set(counts.pop((0, True))) == {4}  # they rest
    assert len(counts[2, False]) > 5
    assert max(counts) > (2, False)
    assert {kind: set(found) for kind, found in counts.items()} == {kind: {2 * kind[0]} for kind in counts}


def test_faster_fingers_get_more_knots_and_chords_err_by_2_percent_at_most() -> None:
    counts = []
    for speed_mm_s in (0.0, 50.0, 100.0, 200.0):
        path = VirtualPath(((-60.0, 4.0), (60.0, 20.0)), speed_mm_s, loop=True)
        bench = Bench()
        bench.set_targets({"walker": Amplitude(1.0)}, {"walker": path})
        bench.t_ns += 150 * MS
        tick = bench.pipeline.drive(bench.t_ns, LinkTiming(LINK_NS))
        knots = tick.drive.knots
        counts.append(len(knots))
        t_plate_ns = tick.drive.t_apply_ns + bench.pipeline._settings.loop_delay_ns
        for before, after in pairwise(knots):
            middle_ns = (before.dt_ns + after.dt_ns) // 2
            here_mm = bench.scene.virtual_position_mm("walker", t_plate_ns + middle_ns)
            between = [(a + b) / 2 for a, b in zip(before.modal_um, after.modal_um, strict=True)]
            assert abs(felt_um(between, here_mm) - 1.0) < 0.02 or tick.limited
        assert bench.pipeline.counters.knots == len(knots)
        assert bench.pipeline.counters.skipped_knots == 16 - len(knots)
    assert counts == sorted(counts)
    assert counts[0] == 2
    assert counts[-1] > 4


@given(
    most=st.integers(1, 24),
    way_mm=st.floats(0.0, 100.0),
    period_mm=st.floats(0.01, 50.0),
    corners_ms=st.lists(st.integers(1, 16), unique=True, max_size=22),
)
def test_knots_are_in_order_within_the_frame_and_never_too_many(
    most: int, way_mm: float, period_mm: float, corners_ms: list[int]
) -> None:
    bench = Bench()
    bench.set_targets({1: Grating(period_mm=period_mm, angle_rad=0.0, low_um=0.0, high_um=1.0, duty_frac=0.5)})
    corners_ns = [corner_ms * MS for corner_ms in corners_ms[: max(most - 2, 0)]]
    plan = FramePlan(DrivenFingers([1], [0], None), bench.t_ns, 17 * MS, most, corners_ns)
    times_ns = bench.pipeline._planner.times_ns(plan, [way_mm])
    assert times_ns == sorted({*times_ns, *corners_ns})
    assert (times_ns[0], times_ns[-1]) == (0, 17 * MS if most > 1 else 0)
    assert len(times_ns) <= most


def test_a_mode_is_asked_for_no_more_than_its_voltage_holds() -> None:
    bench = Bench(contact_radius_mm=5.0)
    bench.land({SLIPPERY: 3.0})
    timings = [LinkTiming(LINK_NS, is_followed=False, holdable_frac=shares) for shares in ((), (0.3, 1.0), ())]
    drives = [[bench.pipeline.drive(bench.t_ns, timing).drive for _ in range(8)][-1] for timing in timings]
    most_um, held_um, then_um = (abs(drive.knots[-1].modal_um[0]) for drive in drives)
    assert held_um <= 0.3 * 4.0 < min(most_um, then_um)  # a board that says nothing has all


def test_a_texture_gets_the_knots_that_its_corners_need() -> None:
    path = VirtualPath(((-60.0, 4.0), (60.0, 20.0)), 100.0, loop=True)
    square = Grating(period_mm=2.0, angle_rad=0.0, low_um=0.0, high_um=1.0, duty_frac=0.5)
    counts = {}
    for name, target in (("constant", Amplitude(1.0)), ("square", square)):
        bench = Bench()
        bench.set_targets({"walker": target}, {"walker": path})
        bench.t_ns += 150 * MS
        tick = bench.pipeline.drive(bench.t_ns, LinkTiming(LINK_NS))
        counts[name] = len(tick.drive.knots)
        for knot in tick.drive.knots:
            here_mm = bench.scene.virtual_position_mm("walker", tick.drive.t_apply_ns + knot.dt_ns)
            wanted_um = bench.scene.amplitude_um("walker", *here_mm)
            assert felt_um(knot.modal_um, here_mm) == pytest.approx(wanted_um, abs=1e-3) or tick.limited
    assert counts["square"] > 2 * counts["constant"]


def test_a_virtual_finger_takes_part_where_it_will_be(bench: Bench) -> None:
    path = VirtualPath(((-40.0, 0.0), (40.0, 0.0)), 80.0, loop=True)
    bench.report(SLIPPERY)
    bench.set_targets({1: Amplitude(1.0), "still": Amplitude(0.0)}, {"still": path})
    tick = bench.report(SLIPPERY)
    point = tick.points[1]
    assert point.key == "still"
    since_s = (bench.t_ns - (bench.t_ns - PERIOD_NS) + LINK_NS + bench.pipeline._settings.loop_delay_ns) * 1e-9
    assert point.x_mm == pytest.approx(-40.0 + 80.0 * since_s, abs=1e-6)
    assert amplitude_um(tick, 0, (point.x_mm, point.y_mm)) < 1e-12


def test_the_reference_is_continuous_where_the_paper_s_formula_flips() -> None:
    ours, paper = Bench(max_knots=2), Bench(max_knots=2, make_solver=InverseSolver)
    largest = {}
    for name, bench in (("ours", ours), ("paper", paper)):
        path = VirtualPath(((-30.0, 3.0), (-10.0, 3.0)), 100.0, loop=False)  # crosses a singular position
        still = VirtualPath(((5.0, 8.0),), 0.0, loop=False)
        bench.set_targets({"a": Amplitude(1.0), "b": Amplitude(0.0)}, {"a": path, "b": still})
        first_um = []
        for _ in range(190):
            bench.t_ns += MS
            tick = bench.pipeline.drive(bench.t_ns, LinkTiming(LINK_NS))
            if tick.drive is not None:
                first_um.append(np.real(tick.drive.knots[0].modal_um))
        largest[name] = np.abs(np.diff(first_um, axis=0)).max()
    assert largest["paper"] > 4.0
    assert largest["ours"] < largest["paper"] / 3


def test_a_silent_pad_is_reported_and_a_lost_one_loses_its_fingers(bench: Bench) -> None:
    bench.hold(3, SLIPPERY)
    assert not bench.pipeline.sensor_is_silent(bench.t_ns + 40 * MS)
    assert bench.pipeline.sensor_is_silent(bench.t_ns + 41 * MS)
    bench.pipeline.sensor_lost()
    assert bench.pipeline.fingers == ()
    assert not bench.pipeline.sensor_is_silent(bench.t_ns + 1000 * MS)
    assert bench.report(SLIPPERY).drive is None  # a new finger without a target


def test_where_the_limit_holds_the_target_is_derated_and_the_zero_stays(bench: Bench) -> None:
    nearly_singular = (STICKY[0] - 27.3, STICKY[1])  # a wavelength on: nearly the same shapes
    bench.land({nearly_singular: 1.0, STICKY: 0.0})
    tick = bench.report(nearly_singular, STICKY)
    assert tick.limited
    riding = solve(PLATE.evaluate([nearly_singular, STICKY]), [1.0, 0.0], 4.0)
    share, slope_um_mm = riding.achieved_um[0], np.linalg.norm(riding.modal_um @ PLATE.gradient([STICKY])[0])
    scale = math.hypot(share, LEAST_SHARE) / (DERATING_MM2_UM2 * slope_um_mm**2)
    assert scale < 1.0
    assert amplitude_um(tick, 0, nearly_singular) == pytest.approx(share * scale, rel=1e-9)
    assert amplitude_um(tick, 0, STICKY) < 1e-12


def test_the_past_has_the_reference_that_was_in_force_and_where_the_fingers_were(bench: Bench) -> None:
    bench.land({SLIPPERY: 1.0})
    ticks = [bench.report((SLIPPERY[0] + 0.5 * step, SLIPPERY[1])) for step in range(40)]
    last, before = ticks[-1], ticks[-2]
    t_sample_ns = last.t_now_ns - last.age_ns
    past = bench.pipeline.past([1], t_sample_ns)
    [(x_mm, y_mm, target_um)] = past.places
    assert (x_mm, y_mm) == pytest.approx((SLIPPERY[0] + 19.5, SLIPPERY[1]), abs=0.1)
    assert target_um == 1.0
    assert past.speed_gains == [1.0]
    now = bench.pipeline.past([1], before.drive.t_apply_ns)
    assert now.modal_um == pytest.approx(before.drive.knots[0].modal_um)
    assert abs(np.array(past.modal_um) - np.array(now.modal_um)).max() > 0.01
