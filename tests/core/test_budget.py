"""A pass does no more than its budget allows, keeps what is most important, and counts what it leaves out."""

from __future__ import annotations

import pytest
from pipeline_bench import ONE, SLIPPERY, STICKY, STILL, Bench, amplitude_um

from hapticd.core.pipeline import LEAST_FRAC, LONG_NS, SHORT_PASSES, PassTimes
from hapticd_contract.contents import Amplitude, Grating, Noise
from hapticd_contract.surfaces import VirtualPath
from hapticd_contract.targets import ClientTargets

FINE = Grating(period_mm=2.0, angle_rad=0.3, low_um=0.0, high_um=1.0, duty_frac=0.0)
NOISE = Noise(seed=1, shortest_mm=0.5, longest_mm=50.0, exponent=1.0, mean_um=0.5, rms_um=0.1)
WALKS = {f"v{n}": VirtualPath(((-50.0, 5.0 * n - 30.0), (50.0, 30.0 - 5.0 * n)), 400.0, True) for n in range(16)}
PLACES = ((-55.0, -40.0), (0.0, 20.0))


def busy(bench: Bench, targets: dict[int | str, Amplitude], **fields: object) -> None:
    """Two fingers that move over noise, and virtual ones."""
    walks = {name: WALKS[name] for name in targets if isinstance(name, str)}
    for step in range(6):
        bench.report(*[(x_mm + 3.0 * step, y_mm + 1.0 * step) for x_mm, y_mm in PLACES])
    assert bench.scene.set_targets(ClientTargets.of("busy", 10**15, targets, walks, **fields), bench.t_ns) == ()  # type: ignore[arg-type]


def test_a_usual_scene_is_never_cut_short() -> None:
    bench = Bench()
    bench.land({SLIPPERY: 1.0, STICKY: 0.0})
    for step in range(20):
        bench.report((-30.0 + step, 5.0), (21.0, -15.0 + step))
    assert bench.pipeline.counters.left_out_fingers == bench.pipeline.counters.left_out_knots == 0


def test_fingers_of_low_priority_and_new_virtual_ones_are_left_out_first() -> None:
    bench = Bench()
    names = list(WALKS)[:8]
    priorities: dict[int | str, int] = {"v3": 2, "v6": 1, 2: 1}
    busy(bench, {1: ONE, 2: STILL, **dict.fromkeys(names, Amplitude(0.5))}, priorities=priorities)
    kept = []
    for budget_frac in (1.0, 0.25, 0.12, 0.08, LEAST_FRAC):
        bench.pipeline.budget_frac = budget_frac
        bench.pipeline.invalidate_reference()
        tick = bench.report(*PLACES)
        kept.append([point.key for point in tick.points])
    important = ["v3", 2, "v6", 1, "v0", "v1", "v2", "v4", "v5", "v7"]
    counts = [len(keys) for keys in kept]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] == 10 > counts[-1] == 1
    assert len(set(counts)) >= 4
    for keys in kept:
        assert keys == [key for key in (1, 2, *names) if key in important[: len(keys)]]
    assert bench.pipeline.counters.left_out_fingers == sum(10 - count for count in counts)


def test_however_slow_the_machine_the_finger_that_came_first_is_served() -> None:
    bench = Bench()
    bench.land({SLIPPERY: 1.0, STICKY: 0.0})
    bench.pipeline.budget_frac = LEAST_FRAC
    bench.hold(5, SLIPPERY, STICKY)
    bench.pipeline.invalidate_reference()
    tick = bench.report(SLIPPERY, STICKY)
    assert tick.points[0].key == 1
    assert amplitude_um(tick, 0, SLIPPERY) == pytest.approx(1.0, abs=0.05)


def test_a_smaller_budget_gives_fewer_knots_but_at_least_two() -> None:
    knots = []
    for budget_frac in (1.0, 0.1, 0.06, 0.03):
        bench = Bench()
        bench.report(SLIPPERY, STICKY)
        bench.set_targets({1: FINE, 2: STILL})
        bench.pipeline.budget_frac = budget_frac
        for step in range(8):
            tick = bench.report((-30.0 + 2.0 * step, 5.0), STICKY)
        assert tick.drive is not None
        knots.append(len(tick.drive.knots))
    assert knots == sorted(knots, reverse=True)
    assert knots[0] > knots[-1] >= 2


def test_a_long_pass_halves_the_budget_and_many_short_ones_double_it() -> None:
    times = PassTimes()
    assert not times.measured(LONG_NS)
    assert times.measured(LONG_NS + 1)
    assert times.measured(LONG_NS + 1)
    assert times.budget_frac == 0.25
    changes = [times.measured(LONG_NS // 2 - 1) for _ in range(3 * SHORT_PASSES)]
    assert (changes.count(True), times.budget_frac) == (2, 1.0)
    for _ in range(20):
        times.measured(10 * LONG_NS)
    assert times.budget_frac == LEAST_FRAC
