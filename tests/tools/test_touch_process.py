"""The process that calibrates while the plate is touched: what it adopts, when it fits, that its end harms nothing."""

from __future__ import annotations

import asyncio
import io
import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from hapticd.config.sections import Config, TrackpadConfig
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.daemon.machine import Machine
from hapticd.daemon.observer import Observer
from hapticd.daemon.pad_adoption import Adoption, Correction, configured_pad
from hapticd.daemon.recorder import header_of
from hapticd.daemon.self_calibration import STEP_EVERY_NS, SelfCalibration, adopt
from hapticd.files.recording.header import Header, header_fields
from hapticd.files.recording.kinds import Record, record_of
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.files.recording.mcap_writer import DirectRecording
from hapticd.sim import lockstep
from hapticd.sim.fingers.scenarios import SCENARIOS
from hapticd.sim.lockstep import T_START_NS, Settings, Simulation
from hapticd.tools import touch_process
from hapticd.tools.record.replay import replay
from hapticd.tools.touch_process import Accumulator, serve
from hapticd.wire import protocol
from hapticd.wire.framing import encode_frame

MISPLACED = TrackpadConfig(offset_mm=(0.4, -0.3), latency_ms=13.0)  # the simulated pad lies at 0, 0 and takes 10 ms
WATCHED = ("board_bytes", "written", "pass", "adopt")


def settings_of(pad: TrackpadConfig) -> Settings:
    return Settings(config=Config(trackpad=replace(pad, correct_while_touched=True)))


class Touching:
    """What a daemon would send of simulated touching."""

    def __init__(self, scenario: str, pad: TrackpadConfig, seconds: float) -> None:
        self.records: list[Record] = []
        self.headers: list[Header] = []
        lockstep.run(scenario, settings=settings_of(pad), seed=1, seconds=seconds, observer=self._observer)

    def _observer(self, machine: Machine, _: ModeShapes) -> Observer:
        self.headers.append(header_of(machine, t_ns=T_START_NS, utc="", is_whole=True))

        def put(kind: str, t_ns: int, *values: Any) -> None:
            if kind in WATCHED:
                self.records.append(record_of(kind, len(self.records), t_ns, values))

        return put

    def packed(self) -> bytes:
        """What the process reads."""
        messages = [[record.kind, record.t_ns, record.fields] for record in self.records]
        return b"".join(map(msgpack.packb, [header_fields(self.headers[0]), *messages]))


@pytest.fixture(scope="module")
def at_rest() -> Touching:
    return Touching("rest", MISPLACED, 2.5)


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process fits what a second of touching gives."""
    monkeypatch.setattr(touch_process, "FIT_TICKS", 400)


def verdicts(touching: Touching, spent_s: Callable[[], float]) -> list[dict[str, Any]]:
    out = io.StringIO()
    seconds = iter(range(1_000_000))
    serve(io.BytesIO(touching.packed()), out, spent_s, lambda: float(next(seconds)))
    return [json.loads(line) for line in out.getvalue().splitlines()]


@pytest.mark.usefixtures("soon")
def test_fingers_at_rest_are_refused_with_a_reason(at_rest: Touching) -> None:
    found = verdicts(at_rest, lambda: 0.0)
    assert found
    for verdict in found:
        assert verdict["refusal"]
        assert "matrix" not in verdict


@pytest.mark.usefixtures("soon")
def test_it_fits_only_while_it_has_used_less_than_its_share_of_the_time(at_rest: Touching) -> None:
    assert verdicts(at_rest, lambda: 1e9) == []


@pytest.mark.usefixtures("soon")
def test_what_was_collected_before_a_change_of_the_pad_is_not_used(at_rest: Touching) -> None:
    accumulator = Accumulator(at_rest.headers[0])
    for record in at_rest.records:
        accumulator.take(record)
    assert accumulator.is_full
    accumulator.take(Record("adopt", 0, T_START_NS, {"plate_from_pad": [1.0] * 6, "latency_ns": 0}))
    assert not accumulator.is_full


RIGHT = {"refusal": "", "matrix": [1, 0, 0, 1], "offset_mm": [0, 0], "latency_s": 0}
NO_VERDICTS = {
    "empty": b"",
    "no fields": b"{}",
    "a list": b"[]",
    "no text": b"\xff",
    "short": json.dumps(RIGHT | {"matrix": [1]}).encode(),
    "not finite": json.dumps(RIGHT | {"latency_s": float("nan")}).encode(),
    "too large": json.dumps(RIGHT | {"offset_mm": [10**400, 0]}).encode(),
    "deep": b"[" * 60_000,
}


@pytest.mark.parametrize("line", NO_VERDICTS.values(), ids=NO_VERDICTS)
def test_what_is_no_verdict_changes_nothing(line: bytes) -> None:
    calibration = SelfCalibration(Config())
    assert not calibration.take_verdict(line)
    assert calibration.report()["verdicts"] == 0
    assert not calibration.report()["moving"]


def test_a_latency_beyond_all_bounds_is_a_refusal() -> None:
    calibration = SelfCalibration(Config())
    assert calibration.take_verdict(json.dumps(RIGHT | {"latency_s": 1e300}).encode())
    assert "far from the configured one" in str(calibration.report()["last_refusal"])
    assert not calibration.report()["moving"]


def test_a_long_refusal_is_cut() -> None:
    calibration = SelfCalibration(Config())
    assert calibration.take_verdict(json.dumps({"refusal": "x" * 5000}).encode())
    assert calibration.report()["last_refusal"] == "x" * 200


class Foreign(SelfCalibration):
    """Calibration whose process runs other code."""

    def run(self, header: Header, monkeypatch: pytest.MonkeyPatch, code: str) -> None:
        """Feed the process until it is ended."""
        popen = subprocess.Popen

        def other(_: object, **settings: Any) -> subprocess.Popen[bytes]:
            return popen([sys.executable, "-I", "-S", "-c", code], **settings)

        async def story() -> None:
            monkeypatch.setattr(subprocess, "Popen", other)
            self.start(asyncio.get_running_loop(), header)
            while self.process is not None:
                self.put("board_bytes", T_START_NS, b"nothing")
                await asyncio.sleep(0)

        try:
            asyncio.run(asyncio.wait_for(story(), 30.0))
        finally:
            if self.process is not None:
                self.process.kill()


def test_a_process_that_floods_the_daemon_is_ended_with_one_warning(
    at_rest: Touching, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    calibration = Foreign(Config())
    calibration.run(at_rest.headers[0], monkeypatch, "import os\nwhile 1: os.write(1, b'\\n' * 65536)")
    assert [record.getMessage() for record in caplog.records] == [
        "the self-calibration's process sent no verdict, the pad stays as it is: b''"
    ]


def test_a_process_that_reads_no_more_is_ended_with_one_warning(
    at_rest: Touching, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    calibration = Foreign(Config())
    calibration.run(at_rest.headers[0], monkeypatch, "import os, signal; os.close(0); signal.pause()")
    assert [record.getMessage() for record in caplog.records] == [
        "the self-calibration's process has ended: the pad stays as it is"
    ]


def test_an_output_that_has_nothing_yet_is_read_later(at_rest: Touching, monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing_yet(*_: object) -> bytes:
        raise BlockingIOError

    async def story() -> bool:
        calibration = SelfCalibration(Config())
        calibration.start(asyncio.get_running_loop(), at_rest.headers[0])
        with monkeypatch.context() as patched:
            patched.setattr(os, "read", nothing_yet)
            calibration._read()
        is_running = calibration.process is not None
        calibration.close()
        return is_running

    assert asyncio.run(story())


def test_the_end_of_the_process_is_one_warning_and_leaves_the_machine_alone(
    at_rest: Touching, caplog: pytest.LogCaptureFixture
) -> None:
    async def story() -> SelfCalibration:
        calibration = SelfCalibration(Config())
        calibration.start(asyncio.get_running_loop(), at_rest.headers[0])
        process = calibration.process
        assert process is not None
        calibration.put("board_bytes", T_START_NS, b"nothing")
        process.kill()
        while calibration.process is not None:
            calibration.put("board_bytes", T_START_NS, b"nothing")
            await asyncio.sleep(0)
        calibration.put("board_bytes", T_START_NS, b"nothing")
        await asyncio.sleep(0)
        calibration.close()
        return calibration

    calibration = asyncio.run(story())
    assert not calibration.report()["running"]
    assert [record.getMessage() for record in caplog.records] == [
        "the self-calibration's process has ended: the pad stays as it is"
    ]


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
    accumulator = Accumulator(at_rest.headers[0])
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
    accumulator = Accumulator(at_rest.headers[0])
    for record in at_rest.records:
        accumulator.take(record)
        if accumulator._collected.samples:
            break
    accumulator.take(hello(4321.0))
    assert accumulator._collected.control_hz == 4321.0
    assert not accumulator._collected.samples


def test_a_process_that_does_not_read_costs_records_and_no_time(at_rest: Touching) -> None:
    async def story() -> dict[str, object]:
        calibration = SelfCalibration(Config())
        calibration.start(asyncio.get_running_loop(), at_rest.headers[0])
        assert calibration.process is not None
        calibration.process.send_signal(signal.SIGSTOP)
        for _ in range(40):
            calibration.put("board_bytes", T_START_NS, bytes(1 << 16))
            await asyncio.sleep(0)
        report = calibration.report()
        calibration.close()
        return report

    report = asyncio.run(story())
    assert report["running"]
    assert 0 < int(str(report["dropped"])) < 40


def test_the_process_reads_to_the_end_within_its_memory(at_rest: Touching) -> None:
    command = [sys.executable, "-P", "-m", "hapticd.tools.touch_process"]
    ended = subprocess.run(command, input=at_rest.packed(), capture_output=True, timeout=60.0, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, b"", b"")


class Calibrating(Simulation):
    """A simulation whose daemon calibrates while it is touched, with the process's part in step."""

    def __init__(self, pad: TrackpadConfig, path: Path, seed: int = 1) -> None:
        settings = settings_of(pad)
        super().__init__(SCENARIOS["strokes"].build(seed, settings.speed_mm_s), settings, seed)
        header = header_of(self.machine, t_ns=T_START_NS, utc="1970-01-01T00:00:00Z", is_whole=True)
        self.recording = DirectRecording(path, header)
        self.accumulator = Accumulator(header)
        self.adoption = Adoption.of(configured_pad(settings.config))
        self.refusals: list[str] = []
        self.t_adopted_s: list[float] = []
        self._t_stepped_ns = 0
        self.machine.observer = self._observe

    def _observe(self, kind: str, t_ns: int, *values: Any) -> None:
        self.recording.put(kind, t_ns, *values)
        if kind in WATCHED:
            self.accumulator.take(record_of(kind, 0, t_ns, values))

    def _handle(self, kind: str, data: bytes, t_ns: int) -> None:
        super()._handle(kind, data, t_ns)
        if self.accumulator.is_full:
            verdict = self.accumulator.verdict()
            self.refusals.append(verdict["refusal"])
            if not verdict["refusal"]:
                offset_mm = tuple(verdict["offset_mm"])
                assert self.adoption.request(Correction(tuple(verdict["matrix"]), offset_mm, verdict["latency_s"]))
        if t_ns - self._t_stepped_ns >= STEP_EVERY_NS and (pad := self.adoption.step()) is not None:
            self._t_stepped_ns = t_ns
            self.t_adopted_s.append(1e-9 * (t_ns - T_START_NS))
            adopt(self.machine, pad, t_ns)


@pytest.mark.long
def test_a_misplaced_pad_is_adopted_while_it_is_touched_and_replays_bit_for_bit(tmp_path: Path) -> None:
    simulation = Calibrating(MISPLACED, tmp_path / "session.mcap")
    simulation.run(40.0)
    simulation.recording.close(T_START_NS + 40_000_000_000, "the test ended")
    run = simulation.result("strokes")

    assert simulation.refusals == [""]
    assert np.hypot(*simulation.adoption.now.plate_from_pad.apply(0.0, 0.0)) < 0.06
    assert simulation.adoption.now.latency_ns == pytest.approx(10_000_000, abs=700_000)
    begin_s, end_s = simulation.t_adopted_s[0], simulation.t_adopted_s[-1]
    assert end_s - begin_s > 1.0
    still = run.target_um == 0.0
    before_um, after_um = (
        float(np.sqrt(np.mean(np.abs(run.truth_um[still & chosen[:, None]]) ** 2)))
        for chosen in ((run.t_s > 1.0) & (run.t_s < begin_s), run.t_s > end_s)
    )
    assert after_um < 0.6 * before_um
    steps_um = np.abs(np.diff(run.reference_um, axis=0)).max(axis=1)
    is_moving = (run.t_s[1:] >= begin_s) & (run.t_s[1:] <= end_s)
    assert steps_um[is_moving].max() <= steps_um[~is_moving].max()

    outcome = replay(open_recording(tmp_path / "session.mcap"))
    assert outcome.is_identical
    assert outcome.references > 1000


@pytest.mark.long
def test_a_pad_that_lies_as_configured_stays(tmp_path: Path) -> None:
    right = replace(MISPLACED, offset_mm=(0.0, 0.0), latency_ms=10.0)
    simulation = Calibrating(right, tmp_path / "session.mcap")
    simulation.run(26.0)
    assert len(simulation.refusals) == 1
    assert simulation.adoption.now.distance_mm(simulation.adoption.configured) < 0.1
