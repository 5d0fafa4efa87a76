"""What a person perceives, as telemetry and recordings report it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import msgpack
import pytest
from machine_bench import PLATE, SLIPPERY, STICKY, Bench

from hapticd.config.sections import RecordConfig
from hapticd.core.friction import FrictionCurve
from hapticd.core.plate.contact import contact_gram, disc_points
from hapticd.daemon.perception import Perception
from hapticd.daemon.recorder import Recorders
from hapticd.files.recording.header import Header
from hapticd.files.recording.kinds import record_of
from hapticd.values import Perceived, Tick, TouchPoint

MS = 1_000_000
CURVE = FrictionCurve.from_amplitudes((0.0, 1.0, 3.0), floor_frac=0.2)  # 1 um: 0.6 of bare glass's friction
CREST_MM = 27.0 / 4.0  # where mode X of the bench's plate is 1


def tick(t_ms: int, *targets_um: float, end_x_mm: float = CREST_MM) -> Tick:
    """A pass with fingers on a crest of mode X."""
    points = [TouchPoint(n, CREST_MM, 0.0, um, um, end_x_mm, 0.0) for n, um in enumerate(targets_um, 1)]
    return Tick(t_ms * MS, 0, 0, None, tuple(points), False)


def test_a_finger_s_friction_is_that_of_the_reference_relative_to_what_was_asked() -> None:
    perceived = Perception(PLATE, CURVE, 0.0, 17 * MS).judge(tick(0, 0.0, 1.0, 3.0), (1.0, 0.0))
    assert [perceived[n].friction_change for n in (1, 2, 3)] == pytest.approx([-0.4, 0.0, 2.0], abs=1e-3)


def test_over_a_contact_the_friction_is_the_mean_not_that_of_its_centre() -> None:
    at_node = TouchPoint(1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert Perception(PLATE, CURVE, 0.0, MS).felt(at_node, (1.0, 0.0)) == pytest.approx((0.0, 0.0), abs=1e-9)
    change, rms_um = Perception(PLATE, CURVE, 5.0, MS).felt(at_node, (1.0, 0.0))
    assert change < -0.15
    gram = contact_gram(PLATE, disc_points(5.0), 0.0, 0.0)
    assert rms_um == pytest.approx(math.sqrt(gram[0][0]))


def test_a_sliding_finger_needs_more_amplitude_where_the_curve_depends_on_speed() -> None:
    curve = FrictionCurve.from_amplitudes((0.0, 1.0, 3.0), floor_frac=0.2, speed_mm_s=100.0)
    sliding = tick(0, 0.0, end_x_mm=CREST_MM + 1.0).points[0]  # 1 mm in 10 ms
    assert Perception(PLATE, curve, 0.0, 10 * MS).felt(sliding, (1.0, 0.0))[0] == pytest.approx(
        0.6**0.5 - 1.0, abs=1e-3
    )


def test_the_share_of_time_beyond_the_weber_fraction_begins_again_with_each_touch() -> None:
    perception = Perception(PLATE, CURVE, 0.0, 17 * MS)
    shares = []
    for t_ms, reference_um in ((0, 1.0), (10, 0.0), (40, 0.0)):
        shares.append(perception.judge(tick(t_ms, 0.0), (reference_um, 0.0))[1].weber_frac)
    perception.judge(tick(50), (0.0, 0.0))
    shares.append(perception.judge(tick(60, 0.0), (0.0, 0.0))[1].weber_frac)
    assert shares == [1.0, 1.0, 0.25, 0.0]


def driven() -> tuple[dict[str, Any], dict[str, Any]]:
    """The newest pass of two fingers with targets, as a subscriber and a recording get it."""
    bench = Bench(SLIPPERY, STICKY).driven()
    sent: list[bytes] = []
    passes: list[tuple[Any, ...]] = []
    bench.machine.watch(sent.append, bench.t_ns)
    bench.machine.observer = lambda kind, _, *values: passes.append(values) if kind == "pass" else None
    bench.run(30)
    return msgpack.unpackb(sent[-1]), record_of("pass", 1, 0, passes[-1]).fields


def test_telemetry_and_recordings_report_the_same_friction_and_amplitude_of_contacts() -> None:
    state, recorded = driven()
    fingers = {finger["id"]: finger for finger in state["fingers"]}
    assert len(fingers) == len(recorded["points"]) == 2
    for point in recorded["points"]:
        finger = fingers[point["finger_id"]]
        assert math.isfinite(point["friction_change"])
        assert 0.0 <= point["weber_frac"] <= 1.0
        for name in Perceived._fields:
            assert point[name] == finger[name]
    rms_um = [point["contact_um"] for point in sorted(recorded["points"], key=lambda point: point["target_um"])]
    assert 0.0 < rms_um[0] < rms_um[1]  # contact leak and contact slip


def test_without_a_subscriber_or_a_recording_nothing_is_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    monkeypatch.setattr(Perception, "judge", lambda *_: pytest.fail("judged"))
    bench.run(100)


def test_what_only_calibrates_needs_no_perception(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    kinds: list[str] = []
    monkeypatch.setattr(Perception, "judge", lambda *_: pytest.fail("judged"))
    Recorders(bench.machine, RecordConfig(), tmp_path, no_header, also=lambda kind, *_: kinds.append(kind))
    bench.run(100)
    assert {"pass", "written", "board_bytes"} <= set(kinds)
    assert bench.machine.pipeline.fingers
    assert not bench.machine.is_failing


def no_header(*_: object) -> Header:
    return pytest.fail("no recording begins")


def test_a_pass_goes_on_and_is_reported_where_perception_fails(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    sent: list[bytes] = []
    bench.machine.watch(sent.append, bench.t_ns)
    monkeypatch.setattr(Perception, "felt", lambda *_: 1 / 0)
    heard = bench.run(100)
    assert "reference" in [each.name for each in heard]
    assert len(msgpack.unpackb(sent[-1])["fingers"]) == 2
    assert sum("what fingers perceive" in record.getMessage() for record in caplog.records) == 1
