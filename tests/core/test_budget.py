"""A pass does no more than its budget allows, keeps what is most important, and counts what it leaves out."""

from __future__ import annotations

import pytest
from pipeline_bench import LINK_NS, MS, ONE, SLIPPERY, STICKY, STILL, Bench, amplitude_um

from hapticd.core.budget import BUDGET_NS, LEAST_CHANGE, MEAN_PASSES, MOST_SLOWNESS, Slowness
from hapticd.values import Aim
from hapticd_contract.contents import Amplitude, Grating, Noise
from hapticd_contract.surfaces import Surface, VirtualPath
from hapticd_contract.targets import ClientTargets

FINE = Grating(period_mm=2.0, angle_rad=0.3, low_um=0.0, high_um=1.0, duty_frac=0.0)
NOISE = Noise(seed=1, shortest_mm=0.5, longest_mm=50.0, exponent=1.0, mean_um=0.5, rms_um=0.1)


def places(count: int) -> list[tuple[float, float]]:
    return [(-55.0 + 11.0 * (n % 11), -40.0 + 20.0 * (n // 11)) for n in range(count)]


def busy(bench: Bench, fingers: int, virtuals: int) -> None:
    """Fingers that move over noise, and virtual ones."""
    surfaces = {f"s{n}": Surface.of(NOISE, z=n) for n in range(8)}
    walks = {
        f"v{n}": VirtualPath(((-50.0, 5.0 * n - 30.0), (50.0, 30.0 - 5.0 * n)), 400.0, True) for n in range(virtuals)
    }
    targets = {name: Amplitude(0.5) for name in walks}
    assert bench.scene.apply(ClientTargets.of("busy", 10**15, targets, walks, surfaces=surfaces), bench.t_ns) == ()
    for step in range(6):
        bench.report(*[(x_mm + 3.0 * step, y_mm + 1.0 * step) for x_mm, y_mm in places(fingers)])


def test_a_usual_scene_is_never_cut_short() -> None:
    bench = Bench()
    bench.land({SLIPPERY: 1.0, STICKY: 0.0})
    for step in range(20):
        bench.report((-30.0 + step, 5.0), (21.0, -15.0 + step))
    assert bench.pipeline.counters.left_out_fingers == bench.pipeline.counters.left_out_knots == 0
    assert 0.0 < bench.pipeline.estimated_ns < 0.2 * BUDGET_NS


@pytest.mark.parametrize(("fingers", "virtuals"), [(0, 16), (2, 16), (11, 0), (11, 16)])
@pytest.mark.parametrize("slowness", [1.0, 4.0])
def test_a_pass_does_no_more_solves_than_its_budget_allows(fingers: int, virtuals: int, slowness: float) -> None:
    bench = Bench()
    bench.pipeline.set_slowness(slowness)
    busy(bench, fingers, virtuals)
    for step in range(20):
        bench.report(*[(x_mm + 2.0 * step, y_mm) for x_mm, y_mm in places(fingers)])
        most_ns = max(BUDGET_NS / slowness, 1e6)  # two solves of the fingers that are down are the least
        assert bench.pipeline.estimated_ns <= most_ns


def test_knots_are_left_out_first_and_then_the_newest_virtual_fingers() -> None:
    bench = Bench()
    busy(bench, 2, 16)
    bench.pipeline.set_slowness(1.0)
    first = bench.report(*places(2))
    left_out = bench.pipeline.counters.left_out_fingers
    bench.pipeline.set_slowness(6.0)
    second = bench.report(*places(2))
    assert bench.pipeline.counters.left_out_fingers > left_out
    keys = [point.key for point in second.points]
    assert keys == [point.key for point in first.points][: len(keys)]
    assert keys[:2] == [1, 2]
    assert first.drive is not None
    assert second.drive is not None
    assert len(second.drive.knots) == 2 <= len(first.drive.knots)


def test_what_has_a_lower_priority_is_left_out_first_and_the_others_keep_their_order() -> None:
    bench = Bench()
    walks = {f"v{n}": VirtualPath(((-50.0, 5.0 * n - 30.0), (50.0, 30.0 - 5.0 * n)), 400.0, True) for n in range(8)}
    targets = {1: ONE, 2: STILL, **dict.fromkeys(walks, Amplitude(0.5))}
    priorities: dict[int | str, int] = {"v3": 2, "v6": 1, 2: 1}
    for _ in range(3):
        bench.report(*places(2))
    bench.scene.apply(ClientTargets.of("test", 10**15, targets, walks, priorities=priorities), bench.t_ns)
    kept, counts = [], []
    for slowness in (1.0, 4.0, 8.0, 12.0, 16.0, MOST_SLOWNESS):
        bench.pipeline.set_slowness(slowness)
        bench.pipeline.resend()
        kept.append([point.key for point in bench.report(*places(2)).points])
        counts.append(len(kept[-1]))
    important = ["v3", 2, "v6", 1, "v0", "v1", "v2", "v4", "v5", "v7"]
    given_order = [1, 2, *walks]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > counts[-1] == 1
    assert len(set(counts)) >= 4
    for keys in kept:
        assert keys == [key for key in given_order if key in important[: len(keys)]]


def test_however_slow_the_machine_the_finger_that_came_first_is_served() -> None:
    bench = Bench()
    bench.land({SLIPPERY: 1.0, STICKY: 0.0})
    bench.pipeline.set_slowness(MOST_SLOWNESS)
    tick = bench.hold(5, SLIPPERY, STICKY)[-1]
    bench.pipeline.resend()
    tick = bench.report(SLIPPERY, STICKY)
    assert tick.points[0].key == 1
    assert amplitude_um(tick, 0, SLIPPERY) == pytest.approx(1.0, abs=0.05)


def test_fewer_solves_keep_the_chords_that_err_most() -> None:
    """A texture gets as many knots as can be afforded; each one more is no worse."""
    knots = []
    for slowness in (1.0, 8.0, 16.0, 32.0):
        bench = Bench()
        bench.report(SLIPPERY, STICKY)
        bench.want({1: FINE, 2: STILL})
        bench.pipeline.set_slowness(slowness)
        for step in range(8):
            tick = bench.report((-30.0 + 2.0 * step, 5.0), STICKY)
        assert tick.drive is not None
        knots.append(len(tick.drive.knots))
    assert knots == sorted(knots, reverse=True)
    assert knots[0] > knots[-1] >= 2


def test_the_same_inputs_give_the_same_bits_whatever_was_left_out() -> None:
    drives = []
    aim = Aim(LINK_NS, is_followed=False)
    for _ in range(2):
        bench = Bench()
        busy(bench, 5, 16)
        bench.pipeline.set_slowness(3.0)
        drives.append([bench.pipeline.drive(bench.t_ns + n * MS, aim).drive for n in range(10)])
    assert drives[0] == drives[1]


# --- how slow this machine is -----------------------------------------------------------------------------------


def test_a_machine_that_is_three_times_slower_is_found_out_and_one_that_recovers_too() -> None:
    slowness = Slowness()
    adopted = [found for _ in range(8 * MEAN_PASSES) if (found := slowness.measured(6e6, 2e6)) is not None]
    assert adopted == sorted(adopted)
    assert 3.0 / LEAST_CHANGE <= slowness.adopted <= 3.0
    for _ in range(8 * MEAN_PASSES):
        slowness.measured(2e6, 2e6)
    assert slowness.adopted < LEAST_CHANGE**2
