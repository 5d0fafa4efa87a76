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


class FakeStream:
    """A stream: its description, and a connection to it."""

    def __init__(
        self, name: str, form: str = "double64", labels: Sequence[str] | None = None, channels: int = 2
    ) -> None:
        self.named = name
        self.waiting: list[tuple[list[Any], float]] = []
        self.is_closed = False
        self.type = lambda: "Force"
        self.channel_count = lambda: channels
        self.channel_format = lambda: form
        self.nominal_srate = lambda: 100.0
        self.get_channel_labels = lambda: labels
        self.get_channel_units = lambda: None if labels is None else ["N"] * channels
        self.info = lambda _timeout_s: self
        self.open_stream = lambda _timeout_s: None

    def pull_chunk(self, timeout: float, max_samples: int) -> tuple[list[list[Any]], list[float]]:
        assert timeout == 0.0
        now, self.waiting[:] = self.waiting[:max_samples], self.waiting[max_samples:]
        return [values for values, _ in now], [t_s for _, t_s in now]

    def close_stream(self) -> None:
        self.is_closed = True


class FakeLsl:
    """What an inlet needs of pylsl; its clock is `offset_s` before the host's."""

    proc_clocksync, cf_string = 1, "string"

    def __init__(self, *streams: FakeStream, offset_s: float = 0.0) -> None:
        self._streams, self.offset_s = streams, offset_s

    def local_clock(self) -> float:
        return time.monotonic() - self.offset_s

    def resolve_byprop(self, prop: str, name: str, minimum: int, timeout: float) -> list[FakeStream]:
        assert (prop, minimum, timeout) == ("name", 1, inlets.FOUND_WITHIN_S)
        return [stream for stream in self._streams if stream.named == name]

    def StreamInlet(self, stream: FakeStream, max_buflen: int, processing_flags: int) -> FakeStream:
        assert (max_buflen, processing_flags) == (inlets.KEPT_S, self.proc_clocksync)
        return stream


def force() -> FakeStream:
    return FakeStream("force", labels=("Fx", "Fz"))


def found_in(opened: Inlets, seq: int = 0) -> list[Record]:
    return [one for inlet in opened for one in inlet.records(seq)]


def test_samples_come_on_the_daemons_clock_behind_a_description_of_their_stream() -> None:
    stream = force()
    with Inlets.opened(["force"], FakeLsl(stream, offset_s=1000.0)) as opened:
        stream.waiting += [([0.1, 2.0], 5.0), ([math.nan, 2.0], 5.01), ([0.3, 2.5], 5.02), ([0.3, 2.5], -2000.0)]
        described, sampled = found_in(opened, 7)
        assert found_in(opened, 8) == []
        assert opened.summary() == "; force: 2 samples, 2 left out"
        assert not stream.is_closed
    channels = [{"name": "Fx", "unit": "N"}, {"name": "Fz", "unit": "N"}]
    assert described.fields == {"stream": "force", "about": "Force", "rate_hz": 100.0, "channels": channels}
    assert [one["values"] for one in sampled.fields["samples"]] == [[0.1, 2.0], [0.3, 2.5]]
    stamps_s = [one["t_ns"] * 1e-9 for one in sampled.fields["samples"]]
    assert stamps_s == pytest.approx([1005.0, 1005.02], abs=1e-3)
    assert (described.seq, sampled.seq) == (7, 7)
    assert stream.is_closed


def test_texts_of_a_stream_are_markers_and_many_values_come_in_parts() -> None:
    psychopy = FakeStream("psychopy", FakeLsl.cf_string, channels=1)
    wide = FakeStream("wide", "float32", channels=inlets.MOST_CHANNELS)
    with Inlets.opened(["psychopy", "wide", "wide"], FakeLsl(psychopy, wide)) as opened:
        psychopy.waiting += [(["trial 1"], 5.0), (["x" * 5000], 6.0)]
        wide.waiting += [([0.0] * inlets.MOST_CHANNELS, 5.0)] * 20
        found = found_in(opened)
    assert [one.fields["client"] for one in found if one.kind == "marker"] == ["psychopy"] * 2
    assert [len(one.fields["text"]) for one in found if one.kind == "marker"] == [7, inlets.MOST_CHARACTERS]
    (described,) = (one for one in found if one.kind == "stream")
    assert described.fields["channels"] == [{"name": "", "unit": ""}] * inlets.MOST_CHANNELS
    assert [len(one.fields["samples"]) for one in found if one.kind == "samples"] == [8, 8, 4]


@pytest.mark.parametrize(
    ("stream", "sentence"),
    [
        (force(), "--lsl eeg: no such stream came within 5 s: start its outlet first."),
        (FakeStream("eeg", channels=513), "--lsl eeg: has 513 channels, at most 512 are taken."),
    ],
)
def test_a_stream_that_cannot_be_recorded_is_one_sentence(stream: FakeStream, sentence: str) -> None:
    with pytest.raises(UsageError) as refused, Inlets.opened(["eeg"], FakeLsl(stream)):
        pass
    assert str(refused.value) == sentence


@pytest.fixture(scope="module")
def touched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of a second of touching, with a force of two channels and a sample before its begin."""
    folder = tmp_path_factory.mktemp("measured")
    simulated.run("strokes", folder / "plain.mcap", settings=Settings(), seed=1, seconds=1.0)
    plain = open_recording(folder / "plain.mcap")
    stream = force()
    lsl = FakeLsl(stream, offset_s=time.monotonic())
    file = RecordingFile(folder / "force.mcap", plain.header)
    with Inlets.opened(["force"], lsl) as opened:
        stream.waiting += [([math.sin(10 * t_s), 2.0], t_s) for t_s in np.arange(0.0, 1.0, 0.01).tolist()]
        measured = [_moved(one, plain.header.t_start_ns - round(lsl.offset_s * 1e9)) for one in found_in(opened)]
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


def test_measured_values_are_a_table_with_one_value_a_row_at_its_own_instant(touched: Path, tmp_path: Path) -> None:
    recording = open_recording(touched)
    assert replay(recording).is_identical
    assert not recording.losses.any
    assert main(["export", str(touched), "--csv", str(tmp_path / "out")]) == 0
    import pandas  # takes a second

    streams, measured = (pandas.read_csv(tmp_path / "out" / f"{name}.csv") for name in ("streams", "measured"))
    assert (streams["name"].tolist(), streams["unit"].tolist()) == (["Fx", "Fz"], ["N", "N"])
    assert (len(measured), set(measured["stream"])) == (200, {"force"})
    fx = measured[measured["channel"] == 1]
    np.testing.assert_allclose(fx["value"], np.sin(10 * fx["t_s"]), atol=0.05)
    np.testing.assert_allclose(np.diff(fx["t_s"]), 0.01, atol=1e-6)


def test_the_picture_has_a_panel_for_each_stream(touched: Path, figures: list[Any]) -> None:
    picture.draw(tables(open_recording(touched)), Path("p.png"))
    last = figures[0].axes[-1]
    assert [line.get_label() for line in last.lines] == ["Fx", "Fz"]
    assert (last.get_ylabel(), last.get_xlabel()) == ("force, N", "time, s")


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
