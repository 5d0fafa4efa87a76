"""Streams of the Lab Streaming Layer in a recording: on the daemon's clock, in tables and in the picture."""

from __future__ import annotations

import asyncio
import math
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tools.record.test_attach import SLIPPERY, STICKY, Bench, recorders, served

from hapticd.__main__ import main
from hapticd.errors import HapticdError, UsageError
from hapticd.files.recording.kinds import Record
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.files.recording.mcap_writer import RecordingFile
from hapticd.sim.settings import Settings
from hapticd.tools.record import inlets, picture, simulated
from hapticd.tools.record.attach import record
from hapticd.tools.record.inlets import Inlets
from hapticd.tools.record.replay import replay
from hapticd.tools.record.tables import tables

AGO_S = 60.0


class FakeInfo:
    """A stream's description."""

    def __init__(self, name: str, form: str, labels: Sequence[str] | None, channels: int) -> None:
        self._name, self._form, self._labels, self._channels = name, form, labels, channels

    def name(self) -> str:
        return self._name

    def type(self) -> str:
        return "Force"

    def channel_count(self) -> int:
        return self._channels

    def channel_format(self) -> str:
        return self._form

    def nominal_srate(self) -> float:
        return 100.0

    def get_channel_labels(self) -> list[str] | None:
        return None if self._labels is None else list(self._labels)

    def get_channel_units(self) -> list[str] | None:
        return None if self._labels is None else ["N"] * self._channels


class FakeLsl:
    """What an inlet needs of pylsl; its clock is `offset_s` before the host's."""

    proc_clocksync, cf_string = 1, "string"

    def __init__(self, *infos: FakeInfo, offset_s: float = 0.0) -> None:
        self._infos = infos
        self.offset_s = offset_s
        self.waiting: dict[str, list[tuple[list[Any], float]]] = {info.name(): [] for info in infos}
        self.closed: list[str] = []

    def local_clock(self) -> float:
        return time.monotonic() - self.offset_s

    def resolve_byprop(self, prop: str, name: str, minimum: int, timeout: float) -> list[FakeInfo]:
        assert (prop, minimum, timeout) == ("name", 1, inlets.FOUND_WITHIN_S)
        return [info for info in self._infos if info.name() == name]

    def StreamInlet(self, info: FakeInfo, max_buflen: int, processing_flags: int) -> FakeStream:
        assert (max_buflen, processing_flags) == (inlets.KEPT_S, self.proc_clocksync)
        return FakeStream(self, info)


class FakeStream:
    """A connection to one stream."""

    def __init__(self, lsl: FakeLsl, info: FakeInfo) -> None:
        self._lsl, self._info = lsl, info

    def info(self, _timeout_s: float) -> FakeInfo:
        return self._info

    def open_stream(self, _timeout_s: float) -> None:
        pass

    def pull_chunk(self, timeout: float, max_samples: int) -> tuple[list[list[Any]], list[float]]:
        assert timeout == 0.0
        waiting = self._lsl.waiting[self._info.name()]
        now, waiting[:] = waiting[:max_samples], waiting[max_samples:]
        return [values for values, _ in now], [t_s for _, t_s in now]

    def close_stream(self) -> None:
        self._lsl.closed.append(self._info.name())


FORCE = FakeInfo("force", "double64", ("Fx", "Fz"), 2)


def test_samples_come_on_the_daemons_clock_behind_a_description_of_their_stream() -> None:
    lsl = FakeLsl(FORCE, offset_s=1000.0)
    with Inlets.opened(["force"], lsl) as opened:
        lsl.waiting["force"] += [([0.1, 2.0], 5.0), ([math.nan, 2.0], 5.01), ([0.3, 2.5], 5.02), ([0.3, 2.5], -2000.0)]
        described, sampled = opened.records(7)
        assert list(opened.records(8)) == []
        assert opened.summary() == "; force: 2 samples, 2 left out"
        assert lsl.closed == []
    channels = [{"name": "Fx", "unit": "N"}, {"name": "Fz", "unit": "N"}]
    assert described.fields == {"stream": "force", "about": "Force", "rate_hz": 100.0, "channels": channels}
    assert [one["values"] for one in sampled.fields["samples"]] == [[0.1, 2.0], [0.3, 2.5]]
    stamps_s = [one["t_ns"] * 1e-9 for one in sampled.fields["samples"]]
    assert stamps_s == pytest.approx([1005.0, 1005.02], abs=1e-3)
    assert (described.seq, sampled.seq) == (7, 7)
    assert lsl.closed == ["force"]


def test_a_stream_without_a_description_has_channels_without_names() -> None:
    lsl = FakeLsl(FakeInfo("eeg", "double64", None, 3))
    with Inlets.opened(["eeg", "eeg"], lsl) as opened:
        lsl.waiting["eeg"] += [([1.0, 2.0, 3.0], 5.0)]
        described, _ = opened.records(0)
    assert described.fields["channels"] == [{"name": "", "unit": ""}] * 3


def test_texts_of_a_stream_are_markers_and_many_values_come_in_parts() -> None:
    wide = FakeInfo("wide", "float32", None, inlets.MOST_CHANNELS)
    lsl = FakeLsl(FakeInfo("psychopy", FakeLsl.cf_string, None, 1), wide)
    with Inlets.opened(["psychopy", "wide"], lsl) as opened:
        lsl.waiting["psychopy"] += [(["trial 1"], 5.0), (["x" * 5000], 6.0)]
        lsl.waiting["wide"] += [([0.0] * inlets.MOST_CHANNELS, 5.0)] * 20
        found = list(opened.records(0))
    assert [one.fields["client"] for one in found if one.kind == "marker"] == ["psychopy"] * 2
    assert [len(one.fields["text"]) for one in found if one.kind == "marker"] == [7, inlets.MOST_CHARACTERS]
    assert [len(one.fields["samples"]) for one in found if one.kind == "samples"] == [8, 8, 4]


@pytest.mark.parametrize(
    ("info", "sentence"),
    [
        (FORCE, "--lsl eeg: no such stream came within 5 s: start its outlet first."),
        (FakeInfo("eeg", "double64", None, 513), "--lsl eeg: has 513 channels, at most 512 are taken."),
    ],
)
def test_a_stream_that_cannot_be_recorded_is_one_sentence(info: FakeInfo, sentence: str) -> None:
    with pytest.raises(UsageError) as refused, Inlets.opened(["eeg"], FakeLsl(info)):
        pass
    assert str(refused.value) == sentence


def test_without_a_stream_nothing_is_loaded() -> None:
    with Inlets.opened([]) as opened:
        assert list(opened.records(0)) == []
        assert opened.summary() == ""


@pytest.fixture(scope="module")
def touched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of a second of touching, with a force of two channels and a sample before its begin."""
    folder = tmp_path_factory.mktemp("measured")
    simulated.run("strokes", folder / "plain.mcap", settings=Settings(), seed=1, seconds=1.0)
    plain = open_recording(folder / "plain.mcap")
    lsl = FakeLsl(FORCE, offset_s=time.monotonic())
    file = RecordingFile(folder / "force.mcap", plain.header)
    with Inlets.opened(["force"], lsl) as opened:
        lsl.waiting["force"] += [([math.sin(10 * t_s), 2.0], t_s) for t_s in np.arange(0.0, 1.0, 0.01).tolist()]
        measured = [_moved(one, plain.header.t_start_ns - round(lsl.offset_s * 1e9)) for one in opened.records(0)]
    for number, one in enumerate(plain.records()):
        file.add(one)
        if number == 0:
            for other in measured:
                file.add(other)
    file.close()
    return folder / "force.mcap"


def _moved(one: Record, by_ns: int) -> Record:
    samples = [sample | {"t_ns": sample["t_ns"] + by_ns} for sample in one.fields.get("samples", ())]
    return one._replace(t_ns=one.t_ns + by_ns, fields=one.fields | ({"samples": samples} if samples else {}))


def test_a_recording_with_a_stream_replays_as_without_and_lacks_nothing(touched: Path) -> None:
    recording = open_recording(touched)
    assert replay(recording).is_identical
    assert not recording.losses.any


def test_measured_values_are_a_table_with_one_value_a_row_at_its_own_instant(touched: Path) -> None:
    found = tables(open_recording(touched))
    assert found["streams"]["name"].tolist() == ["Fx", "Fz"]
    assert found["streams"]["unit"].tolist() == ["N", "N"]
    measured = found["measured"]
    assert len(measured["value"]) == 200
    fx = measured["channel"] == 1
    np.testing.assert_allclose(measured["value"][fx], np.sin(10 * measured["t_s"][fx]), atol=0.05)
    np.testing.assert_allclose(np.diff(measured["t_s"][fx]), 0.01, atol=1e-6)


def test_the_picture_has_a_panel_for_each_stream(touched: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(picture.plotting, "save", lambda figure, _path: drawn.append(figure))
    picture.draw(tables(open_recording(touched)), Path("p.png"))
    (figure,) = drawn
    last = figure.axes[-1]
    assert [line.get_label() for line in last.lines] == ["Fx", "Fz"]
    assert (last.get_ylabel(), last.get_xlabel()) == ("force, N", "time, s")


def test_export_writes_both_tables(touched: Path, tmp_path: Path) -> None:
    assert main(["export", str(touched), "--csv", str(tmp_path / "out")]) == 0
    head = (tmp_path / "out" / "measured.csv").read_text(encoding="utf-8").splitlines()[0]
    assert head == "t_s,t_ns,stream,channel,value"
    assert (tmp_path / "out" / "streams.csv").is_file()


def test_a_real_outlet_is_recorded_beside_the_daemon_at_the_instants_of_its_samples(tmp_path: Path) -> None:
    try:
        lsl = inlets.pylsl()
    except HapticdError as error:
        pytest.skip(str(error))
    outlet, pushed = _outlet(lsl), []
    bench = Bench(SLIPPERY, STICKY).driven()
    ours = recorders(bench, tmp_path)

    def run() -> None:
        with Inlets.opened(["hapticd-test-force"]) as opened:
            ended = threading.Event()
            sender = threading.Thread(target=_push, args=(lsl, outlet, pushed, ended))
            sender.start()
            said.append(record(tmp_path / "a.mcap", tmp_path, 1.0, is_now=True, inlets=opened))
            ended.set()
            sender.join()

    said: list[str] = []
    asyncio.run(served(bench, ours, threading.Thread(target=run)))
    recording = open_recording(tmp_path / "a.mcap")
    samples = [one for record in recording.records() if record.kind == "samples" for one in record.fields["samples"]]
    assert not recording.losses.any
    assert "hapticd-test-force: " in said[0]
    assert len(samples) > 10
    sent_ns = dict(pushed)
    late_ns = [sample["t_ns"] - sent_ns[sample["values"][0]] for sample in samples]
    assert max(map(abs, late_ns)) < AGO_S * 1e9 / 2  # stamps, not arrivals, however late the host is


def _outlet(lsl: Any) -> Any:
    info = lsl.StreamInfo("hapticd-test-force", "Force", 1, 100, lsl.cf_double64, "hapticd-test")
    info.set_channel_labels(["Fx"])
    return lsl.StreamOutlet(info)


def _push(lsl: Any, outlet: Any, pushed: list[tuple[float, int]], ended: threading.Event) -> None:
    """Push samples with stamps from the past, and note these on the daemon's clock."""
    number = 0.0
    while not ended.wait(0.01):
        number += 1.0
        pushed.append((number, time.monotonic_ns() - round(AGO_S * 1e9)))
        outlet.push_sample([number], lsl.local_clock() - AGO_S)
