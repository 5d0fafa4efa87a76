"""Two recordings for all tests here: a scenario with its truth, and a machine between hostile and friendly clients."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from pathlib import Path

import msgpack
import pytest
from machine_bench import MS, SLIPPERY, START_NS, STICKY, Bench

from hapticd.daemon.machine import Machine
from hapticd.daemon.observer import Observer
from hapticd.daemon.recorder import header_of
from hapticd.files.recording.header import Header
from hapticd.files.recording.kinds import Record
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.files.recording.mcap_writer import DirectRecording, RecordingFile
from hapticd.sim.fingers.paths import Path as Finger
from hapticd.sim.plate.ground_truth import GroundTruth
from hapticd.sim.settings import Settings
from hapticd.tools.record import simulated
from hapticd.wire.trackpad import PADS

SECONDS = 1.5


@pytest.fixture(scope="session")
def strokes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two fingers on strokes, one slippery, one sticky, and what the plate truly did."""
    path = tmp_path_factory.mktemp("recording") / "strokes.mcap"
    simulated.run("strokes", path, settings=Settings(), seed=3, seconds=SECONDS)
    return path


@pytest.fixture
def header(strokes: Path) -> Header:
    return open_recording(strokes).header


def recorded(path: Path, *fingers: Finger) -> tuple[Bench, DirectRecording]:
    """A machine on the bench, recorded from before its first input."""
    begun: list[DirectRecording] = []

    def observer(machine: Machine) -> Observer:
        begun.append(DirectRecording(path, header_of(machine, t_ns=START_NS, utc="", is_whole=True)))
        return begun[0].put

    return Bench(*fingers, observer=observer, parasitic_modes=GroundTruth().parasitic_modes(1)), begun[0]


@pytest.fixture(scope="session")
def eventful(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every kind of event: targets of each form, requests, garbage, a marker, an unplugged board, a silent pad."""
    path = tmp_path_factory.mktemp("recording") / "eventful.mcap"
    bench, recording = recorded(path, SLIPPERY, STICKY)
    bench.driven()
    grating = {"period_mm": 6.0, "angle_rad": 0.4, "low_um": 0.1, "high_um": 1.5, "duty_frac": 0.5}
    image = {"width": 2, "height": 2, "levels": b"\0\x40\x80\xff", "high_um": 2.0}
    walker = {"name": "walker", "path_mm": [[-30.0, 12.0], [30.0, 15.0]], "speed_mm_s": 70.0}
    bench.machine.watch(lambda _: None, bench.t_ns)
    levels = bytes(range(200)) * 100
    asset = {"client": "library", "asset": hashlib.sha256(levels).digest(), "size": len(levels)}
    for offset in (0, 12_000):
        assert bench.ask("asset", **asset, offset=offset, part=levels[offset : offset + 12_000])["ok"]
    corners = [[-9, -9], [9, -9], [0, 9]]
    pose = {"position_mm": [-28, 5], "velocity_mm_s": [9, 3], "turning_rad_s": 2.0, "z": 1, "blend": "max"}
    photo = {"width": 200, "height": 100, "asset": asset["asset"], "friction": [0.1, 0.9]}
    noise = {"seed": 3, "shortest_mm": 1.0, "longest_mm": 9.0, "mean_um": 0.2, "rms_um": 0.05}
    surfaces = [
        {"name": "all", "map": photo},
        {"name": "bit", "grating": grating, "polygon_mm": corners, **pose},
        {"name": "way", "noise": noise, "circle_mm": 9, "path_mm": [[-40, 0], [-20, 9]], "z": 2, "blend": "add"},
    ]
    effects = [
        {"name": "click", "pulse": {"height_um": 0.5, "length_s": 0.03}, "start": {"cause": "landing"}},
        {"name": "hum", "modulation": {"frequency_hz": 250, "depth": 0.5}, "surface": "all"},
        {"name": "edge", "pulse": {"height_um": 1, "length_s": 0.02}, "start": {"cause": "crossing", "surface": "bit"}},
    ]
    painting = msgpack.packb({"v": 1, "client": "painter", "ttl_s": 0.4, "surfaces": surfaces, "effects": effects})
    bench.machine.targets(painting, bench.t_ns, "uid 7")
    for finger, request in ((1, {"grating": grating}), (1, {"map": image}), (2, {"friction": 0.3})):
        targets = [{"finger": finger, **request}, {"finger": "walker", "amplitude_um": 0.5, "priority": 2}]
        message = {"v": 1, "client": "test", "ttl_s": 1.0, "targets": targets, "virtuals": [walker]}
        bench.machine.targets(msgpack.packb(message), bench.t_ns, "uid 7")
        bench.run(120)
    bench.machine.targets(b"\xc1 no message", bench.t_ns, "uid 8")
    bench.machine.budget(0.5, bench.t_ns)
    bench.machine.person("anna", (0.0, 0.5, 1.5), 0.1, 200.0, bench.t_ns)
    assert bench.ask("marker", client="test", text="trial 1 begins")["ok"]
    assert bench.ask("set", client="other", targets=[{"finger": "walker", "friction": 1.0}])["ok"] is False
    assert bench.ask("release", client="test", finger=2)["ok"]
    bench.machine.targets(painting, bench.t_ns, "uid 7")
    bench.run(60)
    bench.machine.watch(None, bench.t_ns)
    bench.board.plugged = False
    bench.machine.board_link(False, "unplugged", bench.t_ns)
    bench.machine.self_test("running", "measuring", bench.t_ns)
    bench.run(50)
    bench.machine.self_test("moved", "Mode 0 has moved by +30.0 Hz", bench.t_ns)
    bench.board.plugged = True
    bench.machine.board_link(True, "plugged in", bench.t_ns)
    bench.run(200)
    bench.pad_speaks = False
    bench.run(100)
    bench.machine.self_test("unsafe", "The wires are swapped", bench.t_ns)
    bench.machine.board_link(True, "plugged in", bench.t_ns)
    bench.run(50)
    bench.machine.trackpad_link(False, "unplugged", bench.t_ns)
    bench.machine.trackpad_link(True, "another pad", bench.t_ns + MS, pad=PADS["mt1"])
    bench.machine.stop(bench.t_ns + 2 * MS)
    bench.machine.disconnect(bench.t_ns + 2 * MS)
    recording.close(bench.t_ns + 2 * MS, "the test ended")
    return path


def written(path: Path, header: Header, records: Iterable[Record]) -> Path:
    """A recording of these records, with their own numbers."""
    file = RecordingFile(path, header)
    for record in records:
        file.add(record)
    file.close()
    return path


def rewritten(source: Path, target: Path, change: Callable[[Record], Record | None]) -> Path:
    """A copy with `change(record)` in place of each record; None leaves it out."""
    recording = open_recording(source)
    changed = map(change, recording.records())
    return written(target, recording.header, (record for record in changed if record is not None))
