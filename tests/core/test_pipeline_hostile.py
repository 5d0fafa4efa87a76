"""The touch path under what no well-behaved pad or client would do: whatever comes, limits hold and fingers go on."""

from __future__ import annotations

import random

import numpy as np
import pytest

from hapticd.content_values import (
    AmplitudeTarget,
    ClientTargets,
    FrictionTarget,
    GratingTarget,
    MapTarget,
    Target,
    VirtualPath,
)
from hapticd.core.pipeline import Pipeline, PipelineSettings
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.prediction.predictor import DEFAULT
from hapticd.core.targets.scene import Scene
from hapticd.values import Contact, FingerFrame, Knot, LimitReason, TouchFrame

MS = 1_000_000
PERIOD_NS = 11_250_000
LINK_NS = 5 * MS
START_NS = 77_000_000_000
W_LIMIT_UM = (4.0, 0.5)


def sine_plate() -> ModeShapes:
    axis_mm = np.linspace(-68.75, 68.75, 63)
    wave = np.sin(2 * np.pi * axis_mm / 27.0)
    return ModeShapes.from_grid(axis_mm, axis_mm, np.stack([np.tile(wave, (63, 1)), np.tile(wave, (63, 1)).T]))


PLATE = sine_plate()
TARGETS: tuple[Target, ...] = (
    AmplitudeTarget(0.0),
    AmplitudeTarget(4.0),
    AmplitudeTarget(1e-300),
    FrictionTarget(0.0),
    GratingTarget(0.05, 0.3, 0.0, 4.0, 0.5),
    MapTarget(2, 2, b"\x00\xff\xff\x00", 0.0, 4.0),
)


def contacts(positions_mm: list[tuple[float, float]]) -> tuple[Contact, ...]:
    return tuple(
        Contact(index + 1, x_mm, y_mm, 8.0, 7.0, 0.0, 0.2, True, 4, 0, 0)
        for index, (x_mm, y_mm) in enumerate(positions_mm)
    )


def touch(pipeline: Pipeline, t_device_ns: int, t_read_ns: int, *positions_mm: tuple[float, float]) -> FingerFrame:
    return pipeline.touch(TouchFrame(t_device_ns, contacts(list(positions_mm)), False), t_read_ns)


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
def test_no_touch_and_no_wish_brings_a_mode_above_its_limit(kind: str, count: int) -> None:
    source = random.Random(f"{kind}{count}")
    scene = Scene(w_limit_um=max(W_LIMIT_UM))
    pipeline = Pipeline(PLATE, scene, PipelineSettings(W_LIMIT_UM, DEFAULT.for_touch))
    drives = 0
    for step in range(20):
        t_ns = START_NS + step * PERIOD_NS
        touch(pipeline, t_ns - 10 * MS, t_ns, *scatter(kind, count, source))
        targets: dict[int | str, Target] = {finger.finger_id: source.choice(TARGETS) for finger in pipeline.fingers}
        targets["walker"] = source.choice(TARGETS)
        walk = VirtualPath(((-200.0, 0.0), (200.0, 0.0)), source.choice((0.0, 1e3)), loop=True)
        scene.apply(ClientTargets("test", 500 * MS, targets, {"walker": walk}), t_ns)
        pipeline.release(scene.expire(t_ns))
        tick = pipeline.drive(t_ns, LINK_NS)
        if tick.drive is not None:
            drives += 1
            assert_within_limits(tick.drive.knots)
            assert tick.drive.reasons is LimitReason.NONE  # the solver kept the limits by itself
    assert drives > 0


def test_targets_that_change_a_thousand_times_a_second_are_each_followed() -> None:
    scene = Scene(w_limit_um=4.0)
    pipeline = Pipeline(PLATE, scene, PipelineSettings(W_LIMIT_UM, DEFAULT.for_touch))
    touch(pipeline, START_NS, START_NS + 10 * MS, (6.0, 20.0))
    for step in range(200):
        t_ns = START_NS + 10 * MS + step * MS
        if step % 11 == 0:
            touch(pipeline, t_ns - 9 * MS, t_ns, (6.0, 20.0))
        wanted_um = 0.4 * (step % 2)
        scene.apply(ClientTargets("test", 500 * MS, {1: AmplitudeTarget(wanted_um)}, {}), t_ns)
        tick = pipeline.drive(t_ns, LINK_NS)
        assert [point.target_um for point in tick.points] == [wanted_um]
        assert tick.drive is not None
        assert_within_limits(tick.drive.knots)
        assert tick.points[0].achieved_um == pytest.approx(wanted_um, abs=1e-9)


def test_fingers_go_on_within_three_reports_when_the_pad_s_clock_is_laid_anew_in_the_past() -> None:
    pipeline = Pipeline(PLATE, Scene(w_limit_um=4.0), PipelineSettings(W_LIMIT_UM, DEFAULT.for_touch))
    for step in range(10):
        t_ns = START_NS + step * PERIOD_NS
        touch(pipeline, t_ns + 1900 * MS, t_ns, (float(step), 0.0))
    before = pipeline.fingers[0].finger_id
    lifted: tuple[int, ...] = ()
    seen_mm = []
    for step in range(10, 20):
        t_ns = START_NS + step * PERIOD_NS
        lifted += touch(pipeline, t_ns, t_ns, (float(step), 0.0)).lifted
        seen_mm += [finger.x_mm for finger in pipeline.fingers]
    assert seen_mm == [9.0, 9.0, *(float(step) for step in range(12, 20))]
    assert lifted == (before,)


def test_a_straggler_changes_nothing() -> None:
    pipeline = Pipeline(PLATE, Scene(w_limit_um=4.0), PipelineSettings(W_LIMIT_UM, DEFAULT.for_touch))
    touch(pipeline, START_NS, START_NS + 10 * MS, (1.0, 0.0))
    touch(pipeline, START_NS + PERIOD_NS, START_NS + PERIOD_NS + 10 * MS, (2.0, 0.0))
    touch(pipeline, START_NS + 1, START_NS + PERIOD_NS + 11 * MS, (50.0, 50.0))
    assert [(finger.finger_id, finger.x_mm) for finger in pipeline.fingers] == [(1, 2.0)]
