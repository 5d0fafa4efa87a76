"""Friction targets on a curve that depends on sliding speed."""

from __future__ import annotations

import math

import pytest
from pipeline_bench import FOREVER_NS, PERIOD_NS, Bench, CountedPredictor

from hapticd.core.friction import FrictionCurve
from hapticd.core.pipeline import Pipeline
from hapticd.core.targets.scene import Scene
from hapticd.values import Tick
from hapticd_contract.contents import Content, Friction, LevelMap
from hapticd_contract.surfaces import Surface
from hapticd_contract.targets import ClientTargets

SPEED_MM_S, REST_UM = 100.0, 0.5
CURVE = FrictionCurve.from_amplitudes((0.0, 0.5, 1.0), floor_frac=0.3, speed_mm_s=SPEED_MM_S)


def bench(curve: FrictionCurve, w_limit_um: float = 4.0, **settings: object) -> Bench:
    one = Bench(**settings)
    one.scene = Scene(w_limit_um, curve)
    one.pipeline = Pipeline(one.pipeline.modes, one.scene, one.pipeline._settings)
    return one


def targets_um(one: Bench, speed_mm_s: float, target: Content | None = None) -> list[float]:
    """What a finger that moves steadily is given in its last passes."""
    ticks: list[Tick] = []
    for report in range(60):
        if target is not None and one.pipeline.fingers:
            one.set_targets({one.pipeline.fingers[0].finger_id: target})
        x_mm = -25.0 + speed_mm_s * report * PERIOD_NS * 1e-9
        ticks.append(one.report((x_mm, 3.0)))
    return [point.target_um for tick in ticks[-5:] for point in tick.points]


@pytest.mark.parametrize("speed_mm_s", [0.0, 50.0, 100.0])
def test_a_friction_gets_the_amplitude_of_the_finger_s_predicted_speed(speed_mm_s: float) -> None:
    found_um = targets_um(bench(CURVE), speed_mm_s, Friction(0.5))
    noise_mm_s = 5.0 if speed_mm_s else 0.0
    assert found_um == pytest.approx([REST_UM * (1.0 + (speed_mm_s - noise_mm_s) / SPEED_MM_S)] * 5, rel=0.02)


@pytest.mark.parametrize("content", [Friction(0.5), LevelMap(1, 1, b"\0", 0.0, 1.0, friction=(0.5, 0.0))])
def test_a_surface_s_friction_follows_the_speed_within_the_plate_s_limit(content: Content) -> None:
    for limit_um, expected_um in ((4.0, REST_UM * 1.95), (0.6, 0.6)):
        one = bench(CURVE, limit_um)
        surface = {"all": Surface.of(content)}
        one.scene.set_targets(ClientTargets.of("test", FOREVER_NS, {}, {}, surfaces=surface), one.t_ns)
        assert targets_um(one, 100.0) == pytest.approx([expected_um] * 5, rel=0.02)


@pytest.mark.parametrize(("speed_mm_s", "predictions"), [(math.inf, 1), (SPEED_MM_S, 2)])
def test_a_finger_is_predicted_twice_only_where_friction_depends_on_speed(speed_mm_s: float, predictions: int) -> None:
    curve = FrictionCurve.from_amplitudes((0.0, 0.5, 1.0), floor_frac=0.3, speed_mm_s=speed_mm_s)
    one = bench(curve, make_predictor=CountedPredictor)
    targets_um(one, 0.0, Friction(0.5))
    before = CountedPredictor.predictions
    one.hold(10, (-25.0, 3.0))
    assert CountedPredictor.predictions - before == 10 * 2 * predictions
