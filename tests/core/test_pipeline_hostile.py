"""The touch path under what no well-behaved pad or client would do: whatever comes, limits hold and fingers go on."""

from __future__ import annotations

import random

import pytest
from pipeline_bench import LINK_NS, MS, PERIOD_NS, START_NS, Bench

from hapticd.values import Knot, LimitReason, LinkTiming
from hapticd_contract.contents import Amplitude, Content, Friction, Grating, LevelMap
from hapticd_contract.surfaces import VirtualPath
from hapticd_contract.targets import ClientTargets

W_LIMIT_UM = (4.0, 0.5)
TARGETS: tuple[Content, ...] = (
    Amplitude(0.0),
    Amplitude(4.0),
    Amplitude(1e-300),
    Friction(0.0),
    Grating(0.05, angle_rad=0.3, low_um=0.0, high_um=4.0, duty_frac=0.5),
    LevelMap(2, 2, b"\x00\xff\xff\x00", 0.0, 4.0),
)


@pytest.fixture
def bench() -> Bench:
    return Bench(w_limit_um=W_LIMIT_UM)


def assert_within_limits(knots: tuple[Knot, ...]) -> None:
    for knot in knots:
        assert all(abs(w_um) <= limit_um for w_um, limit_um in zip(knot.modal_um, W_LIMIT_UM, strict=True))


def scatter(kind: str, count: int, source: random.Random) -> list[tuple[float, float]]:
    """Where hostile fingers are: all on one point, on a node of both modes, beyond the map, or jumping about."""
    if kind == "coincident":
        return [(source.uniform(-60, 60), 7.0)] * count
    if kind == "node":
        return [(0.0, 13.5 * index) for index in range(count)]
    if kind == "outside":
        return [(source.choice((-1e5, 90.0, 1e6)), source.uniform(-200, 200)) for _ in range(count)]
    return [(source.uniform(-68, 68), source.uniform(-68, 68)) for _ in range(count)]


@pytest.mark.parametrize("kind", ["coincident", "node", "outside", "jumping"])
@pytest.mark.parametrize("count", [1, 3, 15])
def test_no_touch_and_no_wish_brings_a_mode_above_its_limit(kind: str, count: int, bench: Bench) -> None:
    source, drives = random.Random(f"{kind}{count}"), 0
    for step in range(20):
        t_ns = START_NS + step * PERIOD_NS
        bench.touch(t_ns - 10 * MS, t_ns, *scatter(kind, count, source))
        targets = {finger.finger_id: source.choice(TARGETS) for finger in bench.pipeline.fingers}
        targets["walker"] = source.choice(TARGETS)
        walk = VirtualPath(((-200.0, 0.0), (200.0, 0.0)), source.choice((0.0, 1e3)), loop=True)
        bench.scene.set_targets(ClientTargets.of("test", 500 * MS, targets, {"walker": walk}), t_ns)
        bench.pipeline.release(bench.scene.expire(t_ns))
        tick = bench.pipeline.drive(t_ns, LinkTiming(LINK_NS))
        if tick.drive is not None:
            drives += 1
            assert_within_limits(tick.drive.knots)
            assert tick.drive.reasons is LimitReason.NONE  # the solver kept the limits by itself
    assert drives > 0


def test_targets_that_change_a_thousand_times_a_second_are_each_followed(bench: Bench) -> None:
    bench.touch(START_NS, START_NS + 10 * MS, (6.0, 20.0))
    for step in range(200):
        t_ns = START_NS + 10 * MS + step * MS
        if step % 11 == 0:
            bench.touch(t_ns - 9 * MS, t_ns, (6.0, 20.0))
        wanted_um = 0.4 * (step % 2)
        bench.scene.set_targets(ClientTargets.of("test", 500 * MS, {1: Amplitude(wanted_um)}, {}), t_ns)
        tick = bench.pipeline.drive(t_ns, LinkTiming(LINK_NS))
        assert [point.target_um for point in tick.points] == [wanted_um]
        assert_within_limits(tick.drive.knots)
        assert tick.points[0].achieved_um == pytest.approx(wanted_um, abs=1e-3)


def test_fingers_go_on_within_three_reports_when_the_pad_s_clock_is_set_back(bench: Bench) -> None:
    for step in range(10):
        t_ns = START_NS + step * PERIOD_NS
        bench.touch(t_ns + 1900 * MS, t_ns, (float(step), 0.0))
    before = bench.pipeline.fingers[0].finger_id
    lifted: tuple[int, ...] = ()
    seen_mm = []
    for step in range(10, 20):
        t_ns = START_NS + step * PERIOD_NS
        lifted += bench.touch(t_ns, t_ns, (float(step), 0.0)).lifted
        seen_mm += [finger.x_mm for finger in bench.pipeline.fingers]
    assert seen_mm == [9.0, 9.0, *(float(step) for step in range(12, 20))]
    assert lifted == (before,)
