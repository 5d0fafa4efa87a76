"""The process that calibrates while the plate is touched: what it adopts, when it fits, that its end harms nothing."""

from __future__ import annotations

import asyncio
import base64
import io
import json
import math
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgpack
import numpy as np
import pytest
from asynchronous import asynchronous
from calibrating import CalibratingSimulation, lifting

from hapticd import board_protocol as protocol
from hapticd.config.sections import Config, TrackpadConfig
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.plate.parasitic_modes import ParasiticModes
from hapticd.daemon.machine import Machine
from hapticd.daemon.observer import Observer
from hapticd.daemon.recorder import header_of
from hapticd.daemon.self_calibration import IN_FORCE, KINDS, SelfCalibration
from hapticd.daemon.settings import uncertainty
from hapticd.design import finger_load
from hapticd.design.touch.evidence import HeldOutGain, Taken
from hapticd.design.touch.judge import NO_CHANGE
from hapticd.design.touch.model import LATENCY
from hapticd.design.touch.observations import Windows
from hapticd.errors import CalibrationError
from hapticd.files.recording.header import header_fields
from hapticd.files.recording.kinds import Record, record_of
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.files.recording.mcap_writer import DirectRecording
from hapticd.sim import lockstep
from hapticd.sim.lockstep import T_START_NS
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.settings import Settings, in_world, scheme_config
from hapticd.sim.world_errors import MapChange, SensorErrors, WorldErrors
from hapticd.tools import touch_process
from hapticd.tools.record.replay import replay
from hapticd.tools.service import PROGRAMS
from hapticd.tools.touch_process import Accumulator, serve
from hapticd.tools.touch_recording import Collected
from hapticd.wire.framing import encode_frame

MISPLACED = TrackpadConfig(offset_mm=(0.4, -0.3), latency_ms=13.0)  # the simulated pad lies at 0, 0 and takes 10 ms


def settings_of(pad: TrackpadConfig, telemetry_hz: int = 0) -> Settings:
    config = Config(trackpad=replace(pad, correct_while_touched=True))
    return Settings(config=replace(config, record=replace(config.record, telemetry_hz=telemetry_hz)))


class Touching:
    """What a daemon would send of simulated fingers at rest on a misplaced pad."""

    def __init__(self, seconds: float, telemetry_hz: int = 0) -> None:
        self.records: list[Record] = []
        settings = settings_of(MISPLACED, telemetry_hz)
        lockstep.run("rest", settings=settings, seed=1, seconds=seconds, observer=self._observer)

    def _observer(self, machine: Machine, _: ModeShapes) -> Observer:
        self.header = header_of(machine, t_ns=T_START_NS, utc="", is_whole=True)

        def put(kind: str, t_ns: int, *values: Any) -> None:
            if kind in KINDS:
                self.records.append(record_of(kind, len(self.records), t_ns, values))

        return put

    def packed(self, *first: Record) -> bytes:
        """What the process reads."""
        messages = [[record.kind, record.t_ns, record.fields] for record in (*first, *self.records)]
        return b"".join(map(msgpack.packb, [header_fields(self.header), *messages]))


@pytest.fixture(scope="module")
def at_rest() -> Touching:
    return Touching(2.5)


@pytest.fixture
def calibration(at_rest: Touching) -> SelfCalibration:
    return SelfCalibration(Config(), at_rest.header.modes, None)


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process fits what a second of touching gives."""
    monkeypatch.setattr(touch_process, "FIT_S", 0.8)


def verdicts(touching: Touching, *, spent_s: float) -> list[dict[str, Any]]:
    out = io.StringIO()
    seconds = iter(range(1_000_000))
    serve(io.BytesIO(touching.packed()), out, lambda: spent_s, lambda: float(next(seconds)))
    return [json.loads(line) for line in out.getvalue().splitlines()]


@pytest.mark.usefixtures("soon")
def test_fingers_at_rest_are_refused_with_a_reason(at_rest: Touching) -> None:
    found = verdicts(at_rest, spent_s=0.0)
    assert found
    for verdict in found:
        assert verdict["refusal"]
        assert "matrix" not in verdict


@pytest.mark.usefixtures("soon")
def test_it_fits_only_while_it_has_used_less_than_its_share_of_the_time(at_rest: Touching) -> None:
    assert verdicts(at_rest, spent_s=1e9) == []


def accumulated(touching: Touching, *extra: Record) -> Accumulator:
    accumulator = Accumulator(touching.header)
    for record in (*touching.records, *extra):
        accumulator.take(record)
    return accumulator


def adopting(plate_from_pad: Sequence[float], latency_ns: int) -> Record:
    return Record("adopt", 0, T_START_NS, {"plate_from_pad": list(plate_from_pad), "latency_ns": latency_ns})


def test_fingers_are_kept_as_the_configured_pad_would_have_them() -> None:
    collected = Collected.of(Config(trackpad=MISPLACED))
    collected.take(passing(0))
    collected.take(adopting((0.0, -1.0, 1.0, 0.0, 3.0, 4.0), 12_000_000))
    collected.take(passing(0))  # of the report that was taken before: the pad was where it was configured to be
    finger = {"finger_id": 1, "x_mm": 3.0 - 7.0, "y_mm": 4.0 + 5.0, "major_mm": 9.0, "minor_mm": 4.0}  # at 5, 7 on it
    collected.take(Record("pass", 2, T_START_NS + 10_000_000, {"age_ns": 0, "fingers": [finger]}))
    (t_first_ns, *first_mm, first_axis_mm), (t_second_ns, *second_mm, second_axis_mm) = collected.fingers[1]
    assert first_mm == [1.0, 2.0]
    assert second_mm == pytest.approx([5.4, 6.7])
    assert t_second_ns - t_first_ns == 10_000_000 - 1_000_000
    assert math.isnan(first_axis_mm)  # no ellipse was reported
    assert second_axis_mm == 6.0  # of the disc


@pytest.mark.usefixtures("soon")
def test_what_is_in_force_is_what_was_adopted(at_rest: Touching) -> None:
    pad = adopting((1.01, -0.02, 0.02, 0.99, 0.1, 0.2), 11_000_000)
    readings = Record("adopt_readings", 0, T_START_NS, {"d": [1.0, 0.1, 0.0, 1.0], "q": [0.0, 0.0, 0.0, 0.0]})
    shapes = 1.01 * at_rest.header.modes.shapes
    change = Record("adopt_map", 0, T_START_NS, {"shapes": shapes.astype("<f4").tobytes(), "steepest_1_mm": 0.3})
    accumulator = accumulated(at_rest, pad, readings, change)
    matrix, offset_mm = accumulator._in_force.affine
    assert matrix @ (0.4, -0.3) + offset_mm == pytest.approx([0.1, 0.2])  # where the configured pad has its centre
    assert matrix == pytest.approx(np.array(((1.01, -0.02), (0.02, 0.99))))
    assert accumulator._in_force.pad[LATENCY] == pytest.approx(-0.002)
    assert accumulator._in_force.sense == pytest.approx(np.array(((1.0, -0.1), (0.0, 1.0))))
    assert accumulator._modes.shapes == pytest.approx(shapes, rel=1e-6)
    assert accumulator.is_full  # what was seen before counts


def test_a_board_that_reports_four_times_as_often_is_judged_after_the_same_time() -> None:
    often = accumulated(Touching(1.0, telemetry_hz=2000))
    usual = accumulated(Touching(1.0))
    assert often._collected.live_us == pytest.approx(usual._collected.live_us, rel=0.02)
    assert len(often._collected.samples) == pytest.approx(len(usual._collected.samples), rel=0.02)


@pytest.mark.usefixtures("soon")
def test_a_touch_that_lasts_beyond_a_verdict_goes_on_in_the_next(at_rest: Touching) -> None:
    accumulator = Accumulator(at_rest.header)
    first: Collected | None = None
    for record in at_rest.records:
        accumulator.take(record)
        if accumulator.is_full and first is None:
            first = accumulator._collected
            accumulator.verdict()
    assert first is not None
    both = first.followed_by(accumulator._collected)
    assert both.live_us == first.live_us + accumulator._collected.live_us
    for samples in both.fingers.values():
        instants_ns = [t_ns for t_ns, *_ in samples]
        assert instants_ns == sorted(set(instants_ns))


@pytest.mark.usefixtures("soon")
def test_what_is_older_than_the_plate_stays_alike_is_not_fitted(
    at_rest: Touching, monkeypatch: pytest.MonkeyPatch
) -> None:
    fitted: list[int] = []

    def counted(collected: Collected, *_: object) -> None:
        fitted.append(len(collected.samples))
        raise CalibrationError("counted")

    monkeypatch.setattr(touch_process, "touched", counted)
    for longest_s in (150.0, 0.0):
        monkeypatch.setattr(touch_process, "LONGEST_S", longest_s)
        accumulator = Accumulator(at_rest.header)
        for record in at_rest.records:
            accumulator.take(record)
            if accumulator.is_full:
                assert accumulator.verdict() == {"refusal": "counted"}
    together, alone = fitted[: len(fitted) // 2], fitted[len(fitted) // 2 :]
    assert together[1] == alone[0] + alone[1]
    assert together[0] == alone[0]


RIGHT: dict[str, Any] = {"refusal": "", "matrix": [1, 0, 0, 1], "offset_mm": [0, 0], "latency_s": 0}
SENSORS: dict[str, Any] = {"d": [1, 0.01, 0, 1], "q": [0, 0, 0, 0], "steepest_1_mm": 0.3} | {
    "touched_map_frac": 0.01,
    "touched_mm": [-40.0, -40.0, 40.0, 40.0],
    "sensors_frac": 0.005,
}


def changed(factor: float, modes: ModeShapes) -> dict[str, Any]:
    """A verdict that asks for another map, and other sensors."""
    shapes = base64.b64encode((factor * modes.shapes).astype("<f4").tobytes()).decode()
    return RIGHT | SENSORS | {"shapes": shapes, "steepest_1_mm": modes.steepest_1_mm()}


NO_VERDICTS = {
    "empty": b"",
    "no fields": b"{}",
    "a list": b"[]",
    "no text": b"\xff",
    "a place of one number": json.dumps(RIGHT | {"next_place": [1]}).encode(),
    "short": json.dumps(RIGHT | {"matrix": [1]}).encode(),
    "not finite": json.dumps(RIGHT | {"latency_s": float("nan")}).encode(),
    "too large": json.dumps(RIGHT | {"offset_mm": [10**400, 0]}).encode(),
    "deep": b"[" * 60_000,
    "two rows of sigmas": json.dumps(RIGHT | {"map_sigma": [[0.01] * 3] * 2}).encode(),
    "a sigma that is no number": json.dumps(RIGHT | {"map_sigma": [[0.01] * 3, [math.nan] * 3, [0.01] * 3]}).encode(),
    "a row of two sigmas": json.dumps(RIGHT | {"map_sigma": [[0.01] * 3, [0.01] * 2, [0.01] * 3]}).encode(),
    "a box of three numbers": json.dumps(RIGHT | SENSORS | {"shapes": "", "touched_mm": [0.0] * 3}).encode(),
    "a box that is no number": json.dumps(RIGHT | SENSORS | {"shapes": "", "touched_mm": [math.inf] * 4}).encode(),
    "no sensors": json.dumps(RIGHT | {"shapes": "AAAA", "steepest_1_mm": 1.0}).encode(),
    "no base 64": json.dumps(RIGHT | SENSORS | {"shapes": "?"}).encode(),
    "another grid": json.dumps(RIGHT | SENSORS | {"shapes": "AAAAAA=="}).encode(),
}


@pytest.mark.parametrize("line", NO_VERDICTS.values(), ids=NO_VERDICTS)
def test_what_is_no_verdict_changes_nothing(line: bytes, calibration: SelfCalibration) -> None:
    assert not calibration.take_verdict(line)
    assert calibration.report()["verdicts"] == 0
    assert not calibration.report()["moving"]


def test_the_ninth_to_touch_next_is_reported_until_another_verdict_names_none(calibration: SelfCalibration) -> None:
    assert calibration.take_verdict(json.dumps({"refusal": "", "next_place": [2, 9]} | RIGHT).encode())
    assert calibration.report()["next_place"] == (2, 2)
    assert calibration.take_verdict(json.dumps(RIGHT).encode())
    assert calibration.report()["next_place"] is None


def test_a_sentence_says_what_is_adopted_and_why_no_more(at_rest: Touching, calibration: SelfCalibration) -> None:
    assert calibration.report()["sentence"] == ""
    kept = "The map stays as it is."
    assert calibration.take_verdict(json.dumps({"refusal": kept, "map_refusal": kept}).encode())
    assert calibration.report()["sentence"] == f"Nothing is adopted. {kept}"
    modes = at_rest.header.modes
    machine = Machine(Config(), modes, write_board=lambda _: T_START_NS)
    known = {"map_sigma": [[0.01, 0.02, 0.01]] * 3, "map_known": "The map found errs by 1 %."}
    assert calibration.take_verdict(json.dumps(changed(1.02, modes) | known).encode())
    assert "map" not in str(calibration.report()["sentence"])
    assert calibration.step(machine, T_START_NS)
    assert calibration.report()["sentence"] == "Adopted: half of map and sensors. The map found errs by 1 %."
    assert calibration.report()["map_sigma"] == ((0.01, 0.02, 0.01),) * 3


def test_a_latency_beyond_all_bounds_is_a_refusal(calibration: SelfCalibration) -> None:
    assert calibration.take_verdict(json.dumps(RIGHT | {"latency_s": 1e300}).encode())
    assert "far from the configured one" in str(calibration.report()["last_refusal"])
    assert not calibration.report()["moving"]


def test_a_map_far_from_the_scanned_one_is_a_refusal(at_rest: Touching, calibration: SelfCalibration) -> None:
    assert calibration.take_verdict(json.dumps(changed(2.0, at_rest.header.modes)).encode())
    assert "far from the configured one" in str(calibration.report()["last_refusal"])


def test_map_and_sensors_are_adopted_when_no_finger_is_down(at_rest: Touching, calibration: SelfCalibration) -> None:
    modes = at_rest.header.modes
    assert calibration.take_verdict(json.dumps(changed(1.02, modes)).encode())
    assert not calibration.step(SimpleNamespace(is_idle=False), T_START_NS)  # type: ignore[arg-type]
    machine = Machine(Config(), modes, write_board=lambda _: T_START_NS)
    calibration.resume(machine, T_START_NS)
    assert machine.modes is modes
    assert calibration.step(machine, T_START_NS)
    assert not calibration.step(machine, T_START_NS)
    assert machine.modes.shapes == pytest.approx(1.01 * modes.shapes, rel=1e-6)  # half of it first
    assert machine.pipeline._modes is machine.status.modes is machine.modes
    assert machine.pipeline._readings == ((1.0, 0.005), (0.0, 1.0))
    assert calibration.report()["maps"] == 1
    half = {"touched_map_frac": math.hypot(0.005, 0.01), "touched_mm": (-40.0, -40.0, 40.0, 40.0)}
    assert calibration.report()["unknown"] == half | {"sensors_frac": math.hypot(0.0025, 0.01)}
    assert machine._perception.expected.map_frac_at(0.0, 0.0) == half["touched_map_frac"]
    assert machine._perception.expected.map_frac_at(50.0, 0.0) == 0.02
    assert calibration.take_verdict(json.dumps({"refusal": "no more", "in_force": "better"}).encode())
    assert calibration.step(machine, T_START_NS)
    assert machine.modes.shapes == pytest.approx(1.02 * modes.shapes, rel=1e-6)
    assert machine.pipeline._readings == ((1.0, 0.01), (0.0, 1.0))
    again = Machine(Config(), modes, write_board=lambda _: T_START_NS)
    calibration.resume(again, T_START_NS)
    assert (again.modes.shapes == machine.modes.shapes).all()
    assert again._perception.expected == machine._perception.expected
    assert again._perception.expected.map_frac_at(0.0, 0.0) == 0.01
    assert again.pipeline._readings == machine.pipeline._readings


def settled_mm(calibration: SelfCalibration, machine: Machine, verdict: dict[str, Any]) -> float:
    """How far the pad is moved when all steps of a verdict are done."""
    assert calibration.take_verdict(json.dumps(verdict).encode())
    for step in range(100):
        calibration.step(machine, T_START_NS + step * 20_000_000)
    return float(str(calibration.report()["moved_mm"]))


def test_what_later_touches_are_fitted_worse_by_is_taken_back(at_rest: Touching, calibration: SelfCalibration) -> None:
    modes = at_rest.header.modes
    machine = Machine(Config(), modes, write_board=lambda _: T_START_NS)
    found = changed(1.02, modes) | {"offset_mm": [0.01, 0.0]}
    settled = partial(settled_mm, calibration, machine)

    assert settled(found) == pytest.approx(0.005)
    assert settled({"refusal": "no more", "in_force": "better"}) == pytest.approx(0.01)
    assert settled(found | {"offset_mm": [9.0, 0.0], "in_force": "worse"}) == 0.0  # though what was found is too far
    assert machine.modes.shapes == pytest.approx(modes.shapes, rel=1e-6)
    assert machine.pipeline._readings is None
    assert machine._perception.expected == uncertainty(Config())
    report = calibration.report()
    assert "taken back" in str(report["last_refusal"])
    assert (report["adopted"], report["taken_back"]) == (2, 1)


def test_the_newest_touches_say_what_they_make_of_what_is_in_force(
    at_rest: Touching, monkeypatch: pytest.MonkeyPatch
) -> None:
    judged: list[tuple[int, bool]] = []
    gain: HeldOutGain | None = HeldOutGain(-0.1, -5.0)

    def found(windows: Windows, configured: Taken, in_force: Taken, _: object) -> HeldOutGain | None:
        judged.append((len(windows), in_force.modes is configured.modes))
        return gain

    monkeypatch.setattr(touch_process, "gained", found)
    monkeypatch.setattr(touch_process, "FIT_S", 1.2)
    pad = adopting((1.0, 0.0, 0.0, 1.0, 0.1, 0.2), 11_000_000)
    assert "in_force" not in accumulated(at_rest).verdict()
    assert judged == []
    assert accumulated(at_rest, pad).verdict()["in_force"] == "worse"
    gain = HeldOutGain(0.1, 5.0)
    assert accumulated(at_rest, pad).verdict()["in_force"] == "better"
    gain = None
    assert "in_force" not in accumulated(at_rest, pad).verdict()
    assert [alike for _, alike in judged] == [True] * 3
    assert min(windows for windows, _ in judged) > 10


def test_a_finger_s_load_is_adopted_when_no_finger_is_down_also_where_the_pad_stays(at_rest: Touching) -> None:
    header = at_rest.header
    modes, known = header.modes, header.parasitic_modes
    assert known is not None
    calibration = SelfCalibration(Config(), modes, known)
    assert calibration.take_verdict(json.dumps({"refusal": "as it was", "load_1_s": [80.0, -200.0]}).encode())
    assert calibration.report()["last_refusal"] == "as it was"
    machine, again = (
        Machine(Config(), modes, write_board=lambda _: T_START_NS, parasitic_modes=known) for _ in range(2)
    )
    calibration.resume(machine, T_START_NS)
    assert machine.parasitic_modes is known
    assert not calibration.step(SimpleNamespace(is_idle=False), T_START_NS)  # type: ignore[arg-type]
    assert calibration.step(machine, T_START_NS)
    assert not calibration.step(machine, T_START_NS)
    calibration.resume(again, T_START_NS)
    for one in (machine, again):
        assert (one.parasitic_modes.finger_decay_1_s, one.parasitic_modes.finger_detuning_rad_s) == (80.0, 200.0)
        assert one.pipeline._solver._parasitic_modes is one.parasitic_modes
    assert calibration.report()["loads"] == 1


def test_contacts_sizes_are_adopted_with_no_finger_down_and_taken_back_with_the_rest() -> None:
    settings = Settings(plate=PlateSettings.of("fingertip"))
    config, modes = scheme_config(settings), GroundTruth(settings.plate).measured_mode_map(1)
    machine, again = (Machine(config, modes, write_board=lambda _: T_START_NS) for _ in range(2))
    calibration = SelfCalibration(config, modes, None)
    sizes = {"refusal": "as it was", "contacts": [6.0, 1.2, 0.4]}
    for _ in range(2):
        assert calibration.take_verdict(json.dumps(sizes).encode())
    assert not calibration.step(SimpleNamespace(is_idle=False), T_START_NS)  # type: ignore[arg-type]
    assert calibration.report()["contacts"] is None
    assert calibration.step(machine, T_START_NS)
    assert not calibration.step(machine, T_START_NS)
    calibration.resume(again, T_START_NS)
    for one in (machine, again):
        assert one.pipeline.contact_radius_mm == one._perception._contacts.radius_mm == 6.0
    report = calibration.report()
    assert report["contacts"] == {"radius_mm": 6.0, "ellipse_scale": 1.2, "ellipse_offset_mm": 0.4}
    assert report["sentence"] == "Adopted: the contacts' size. as it was"
    assert calibration.take_verdict(json.dumps({"in_force": "worse"}).encode())
    assert calibration.step(machine, T_START_NS)
    assert machine.pipeline.contact_radius_mm == config.solver.contact_radius_mm
    assert calibration.report()["contacts"] is None


def test_contacts_sizes_that_no_finger_has_are_left_out_and_named(calibration: SelfCalibration) -> None:
    assert calibration.take_verdict(json.dumps(RIGHT | {"contacts": [6.0, 1.0, 0.0]}).encode())
    assert "contacts' size found is far from" in str(calibration.report()["last_refusal"])  # fingers are points
    assert calibration.report()["contacts"] is None


def test_evidence_alone_confirms_or_takes_back_what_was_adopted_and_is_no_verdict(
    at_rest: Touching, calibration: SelfCalibration
) -> None:
    machine = Machine(Config(), at_rest.header.modes, write_board=lambda _: T_START_NS)
    moved_mm = partial(settled_mm, calibration, machine)

    assert moved_mm(RIGHT | {"offset_mm": [0.01, 0.0], "map_refusal": "too few touches"}) == pytest.approx(0.005)
    assert moved_mm({"in_force": "better"}) == pytest.approx(0.01)
    report = calibration.report()
    assert (report["verdicts"], report["last_map_refusal"]) == (1, "too few touches")
    assert moved_mm({"in_force": "worse"}) == 0.0
    report = calibration.report()
    assert (report["verdicts"], report["taken_back"]) == (1, 1)
    assert "taken back" in str(report["last_refusal"])


@pytest.mark.usefixtures("soon")
def test_without_time_to_fit_the_newest_touches_judge_what_is_in_force(
    at_rest: Touching, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(touch_process, "gained", lambda *_: HeldOutGain(-0.1, -5.0))
    monkeypatch.setattr(touch_process, "FIT_S", 1.1)
    assert verdicts(at_rest, spent_s=1e9) == []  # all is as configured
    touching = SimpleNamespace(packed=lambda: at_rest.packed(adopting((1.0, 0.0, 0.0, 1.0, 0.1, 0.2), 11_000_000)))
    found = verdicts(touching, spent_s=1e9)  # type: ignore[arg-type]
    assert len(found) >= 2
    assert all(one == {"in_force": "worse"} for one in found)


def test_touches_from_before_the_plate_changed_are_not_fitted_again(
    at_rest: Touching, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(touch_process, "FIT_S", 1.1)
    accumulator = Accumulator(at_rest.header)
    worse = HeldOutGain(0.1, 5.0)
    monkeypatch.setattr(touch_process, "gained", lambda *_: worse)
    accumulator.take(adopting((1.0, 0.0, 0.0, 1.0, 0.1, 0.2), 11_000_000))
    kept = []
    for record in at_rest.records:
        accumulator.take(record)
        if accumulator.is_full:
            worse = HeldOutGain(-0.1, -5.0) if kept else worse
            accumulator.evidence()
            kept.append(len(accumulator._earlier))
    assert kept[:2] == [1, 1]


@pytest.mark.parametrize("load_1_s", [[-1.0, 0.0], [1e5, 0.0], [float("nan"), 0.0]])
def test_a_load_that_no_finger_has_is_left_out_and_named(load_1_s: list[float], at_rest: Touching) -> None:
    header = at_rest.header
    calibration = SelfCalibration(Config(), header.modes, header.parasitic_modes)
    assert calibration.take_verdict(json.dumps(RIGHT | {"load_1_s": load_1_s}).encode())
    assert "load found is far from the configured one" in str(calibration.report()["last_refusal"])
    assert not calibration.step(SimpleNamespace(is_idle=True), T_START_NS)  # type: ignore[arg-type]


def test_a_load_is_in_the_verdict_and_the_next_is_judged_against_what_is_in_force(
    at_rest: Touching, monkeypatch: pytest.MonkeyPatch
) -> None:
    judged_against: list[complex] = []

    def learned(_windows: Any, _modes: Any, parasitic_modes: ParasiticModes, *_: Any) -> complex:
        judged_against.append(complex(parasitic_modes.finger_decay_1_s, -parasitic_modes.finger_detuning_rad_s))
        return 80.0 + 200.0j

    monkeypatch.setattr(touch_process, "FIT_S", 1.2)
    monkeypatch.setattr(finger_load, "learned_1_s", learned)
    in_force = Record("adopt_load", 0, T_START_NS, {"decay_1_s": 120.0, "detuning_rad_s": -300.0})
    assert "load_1_s" not in accumulated(at_rest, in_force).verdict()  # where the pad lies is unknown
    fit = touch_process.calibrate
    known = lambda *given, **named: replace(fit(*given, **named), refusal=NO_CHANGE)  # noqa: E731
    monkeypatch.setattr(touch_process, "calibrate", known)
    assert accumulated(at_rest, in_force).verdict()["load_1_s"] == [80.0, 200.0]
    assert judged_against == [120.0 + 300.0j]


def test_a_long_refusal_is_cut(calibration: SelfCalibration) -> None:
    assert calibration.take_verdict(json.dumps({"refusal": "x" * 5000}).encode())
    assert calibration.report()["last_refusal"] == "x" * 200


ENDED = "the self-calibration's process has ended: the pad stays as it is"
NO_VERDICT = "the self-calibration's process sent no verdict, the pad stays as it is: b''"


@pytest.mark.parametrize(
    ("code", "warning"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", ENDED),
        ("import os, signal; os.close(0); signal.pause()", ENDED),
        ("import os\nwhile 1: os.write(1, b'\\n' * 65536)", NO_VERDICT),
    ],
    ids=["dies", "reads no more", "floods the daemon"],
)
@asynchronous
async def test_the_end_of_the_process_is_one_warning_and_leaves_the_machine_alone(
    code: str,
    warning: str,
    at_rest: Touching,
    calibration: SelfCalibration,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    popen, command = subprocess.Popen, [sys.executable, "-I", "-S", "-c", code]
    monkeypatch.setattr(subprocess, "Popen", lambda _, **settings: popen(command, **settings))
    calibration.start(asyncio.get_running_loop(), PROGRAMS.calibrate, at_rest.header)
    calibration.put("board_bytes", T_START_NS, b"nothing")
    try:
        async with asyncio.timeout(30.0):
            while calibration.process is not None:
                calibration.put("board_bytes", T_START_NS, b"nothing")
                await asyncio.sleep(0)
    finally:
        if calibration.process is not None:
            calibration.process.kill()
    calibration.put("board_bytes", T_START_NS, b"nothing")
    await asyncio.sleep(0)
    calibration.close()
    assert not calibration.report()["running"]
    assert [record.getMessage() for record in caplog.records] == [warning]


@asynchronous
async def test_an_output_that_has_nothing_yet_is_read_later(
    at_rest: Touching, calibration: SelfCalibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nothing_yet(*_: object) -> bytes:
        raise BlockingIOError

    calibration.start(asyncio.get_running_loop(), PROGRAMS.calibrate, at_rest.header)
    with monkeypatch.context() as patched:
        patched.setattr(os, "read", nothing_yet)
        calibration._read()
    assert calibration.process is not None
    calibration.close()


def test_priorities_and_limits_that_are_refused_are_done_without(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise PermissionError

    def limited(*_: object) -> None:
        raise ValueError

    freed: list[object] = []
    served: list[object] = []
    monkeypatch.setattr(os, "sched_setscheduler", refused)
    monkeypatch.setattr(os, "sched_setaffinity", lambda *_: freed.append(_))
    monkeypatch.setattr(os, "nice", refused)
    monkeypatch.setattr(resource, "setrlimit", limited)
    monkeypatch.setattr(touch_process, "serve", lambda *_: served.append(_))
    touch_process.main()
    assert len(freed) == len(served) == 1


def passing(tick: int, finger_id: int = 1) -> Record:
    finger = {"finger_id": finger_id, "x_mm": 1.0, "y_mm": 2.0}
    return Record("pass", tick, T_START_NS + tick * 10_000_000, {"age_ns": 0, "fingers": [finger]})


@pytest.mark.usefixtures("soon")
def test_what_is_collected_is_bounded_without_control_ticks_of_the_board(
    at_rest: Touching, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(touch_process, "MOST_FRAMES", 20)
    monkeypatch.setattr(touch_process, "MOST_POSITIONS", 50)
    accumulator = Accumulator(at_rest.header)
    most_frames = most_positions = 0
    for record in at_rest.records:
        if record.kind == "written":
            accumulator.take(record)
            most_frames = max(most_frames, len(accumulator._collected.frames))
    for tick in range(500):
        accumulator.take(passing(tick, finger_id=tick))
        most_positions = max(most_positions, len(accumulator._collected.fingers))
    assert (most_frames, most_positions) == (20, 50)


def hello(control_hz: float) -> Record:
    fields = protocol.HELLO.pack(1, 0, 2, b"x", 1, control_hz, 29_205.0, 50, 150.0)
    data = encode_frame(bytes([protocol.MSG_HELLO]) + fields + bytes(8))
    return Record("board_bytes", 0, T_START_NS, {"data": data})


@pytest.mark.usefixtures("soon")
def test_another_board_begins_a_collection_of_its_own(at_rest: Touching) -> None:
    accumulator = Accumulator(at_rest.header)
    for record in at_rest.records:
        accumulator.take(record)
        if accumulator._collected.samples:
            break
    accumulator.take(hello(4321.0))
    assert accumulator._collected.control_hz == 4321.0
    assert not accumulator._collected.samples


@asynchronous
async def test_a_process_that_does_not_read_costs_records_and_no_time_but_learns_what_is_in_force(
    at_rest: Touching, calibration: SelfCalibration
) -> None:
    calibration.start(asyncio.get_running_loop(), PROGRAMS.calibrate, at_rest.header)
    assert calibration.process is not None
    calibration.process.send_signal(signal.SIGSTOP)
    for _ in range(40):
        calibration.put("board_bytes", T_START_NS, bytes(1 << 16))
        await asyncio.sleep(0)
    report = calibration.report()
    calibration.put("adopt_readings", T_START_NS, [1.0, 0.0, 0.0, 1.0], [0.0] * 4)
    await asyncio.sleep(0)
    waiting = bytes(calibration._out)
    calibration.close()
    assert report["running"]
    assert 0 < int(str(report["dropped"])) < 40
    fields = {"d": [1.0, 0.0, 0.0, 1.0], "q": [0.0] * 4}
    assert waiting.endswith(msgpack.packb(None) + msgpack.packb(["adopt_readings", T_START_NS, fields]))


def test_the_process_reads_to_the_end_within_its_memory(at_rest: Touching) -> None:
    command = [sys.executable, "-P", "-m", "hapticd.tools.touch_process"]
    ended = subprocess.run(command, input=at_rest.packed(), capture_output=True, timeout=60.0, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, b"", b"")


def calibrating(settings: Settings, recording: DirectRecording | None = None) -> CalibratingSimulation:
    """A simulation that touches the plate in strokes, and lifts the fingers every ten seconds."""
    observer = None if recording is None else lambda _: recording.put
    return CalibratingSimulation(lifting(settings, 100.0), settings, 1, observer=observer)


@pytest.mark.long
def test_pad_sensors_and_map_are_adopted_while_touched_and_it_replays_bit_for_bit(tmp_path: Path) -> None:
    errors = SensorErrors((0.03, -0.03), (3.0, -3.0), ((0.0, 0.03), (0.0, 0.0)))
    world = WorldErrors(sensors=errors, map_change=MapChange(waves_frac=0.08), seed=3)
    far_off = replace(MISPLACED, offset_mm=(0.8, -0.6))
    settings = in_world(settings_of(far_off), world)
    path, made = tmp_path / "session.mcap", lockstep.Simulation((), settings, 1).machine
    recording = DirectRecording(path, header_of(made, t_ns=T_START_NS, utc="1970-01-01T00:00:00Z", is_whole=True))
    simulation = calibrating(settings, recording)
    simulation.run(64.0)
    recording.close(T_START_NS + 64_000_000_000, "the test ended")
    run, (calibration,) = simulation.result("strokes"), simulation.calibrations
    report = calibration.task.report()

    assert report["maps"]
    place = calibration.task._adoption.now
    assert np.hypot(*place.plate_from_pad.apply(0.0, 0.0)) < 0.75  # of 1 mm: most of it may be the fingers' posture
    assert place.latency_ns == pytest.approx(10_000_000, abs=700_000)
    readings = np.array(simulation.machine.pipeline._readings), errors.matrix(2)
    sensors, true = (one / np.abs(np.diag(one)) for one in readings)  # the map makes up for gains
    assert np.abs(sensors / sensors[0, 0] - true / true[0, 0]).max() < 0.025
    still = run.target_um == 0.0
    before_um, after_um = (
        float(np.sqrt(np.mean(np.abs(run.truth_um[still & chosen[:, None]]) ** 2)))
        for chosen in ((run.t_s > 1.0) & (run.t_s < 24.0), run.t_s > 50.0)
    )
    assert after_um < 0.7 * before_um

    adopted_s = [
        (record.t_ns - T_START_NS) * 1e-9 for record in open_recording(path).records() if record.kind in IN_FORCE
    ]
    assert adopted_s
    since_s = run.t_s[1:] - np.array([0.0, *adopted_s])[np.searchsorted(adopted_s, run.t_s[1:], "right")]
    steps_um = np.abs(np.diff(run.reference_um, axis=0)).max(axis=1)
    is_adopted = (since_s < 0.02) & (run.t_s[1:] > 1.0)
    assert steps_um[is_adopted].max() <= 1.01 * steps_um[~is_adopted].max()

    outcome = replay(open_recording(path))
    assert outcome.is_identical
    assert outcome.references > 1000


@pytest.mark.long
def test_a_pad_that_lies_as_configured_stays() -> None:
    simulation = calibrating(settings_of(replace(MISPLACED, offset_mm=(0.0, 0.0), latency_ms=10.0)))
    simulation.run(26.0)
    (calibration,) = simulation.calibrations
    assert len(calibration.verdicts) == 1
    adoption = calibration.task._adoption
    assert adoption.now.distance_mm(adoption.configured) < 0.1
