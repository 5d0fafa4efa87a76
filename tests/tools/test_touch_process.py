"""The process that calibrates while the plate is touched: what it adopts, when it fits, that its end harms nothing."""

from __future__ import annotations

import asyncio
import io
import json
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
from hapticd.daemon.pad_adoption import Adoption, Correction
from hapticd.daemon.recorder import header_of
from hapticd.daemon.self_calibration import STEP_EVERY_NS, SelfCalibration, adopt, configured_pad
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


def test_what_is_no_verdict_changes_nothing() -> None:
    calibration = SelfCalibration(Config())
    short = b'{"refusal": "", "matrix": [1], "offset_mm": [0, 0], "latency_s": 0}'
    endless = b'{"refusal": "", "matrix": [1, 0, 0, 1], "offset_mm": [0, 0], "latency_s": NaN}'
    for line in (b"", b"{}", b"[]", short, endless, b"\xff"):
        calibration.take_verdict(line)
    assert calibration.report()["verdicts"] == 0
    assert not calibration.report()["moving"]


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
