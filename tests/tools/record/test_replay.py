"""Replay: the same core on the same inputs gives the same bytes, and what is not the same is shown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from msgspec import structs

from hapticd.__main__ import main
from hapticd.config.sections import Config
from hapticd.daemon import board_gateway
from hapticd.errors import RecordingError
from hapticd.files.recording.kinds import INPUTS, Record
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.sim.fingers import scripted
from hapticd.sim.fingers.fingertip import Fingertip
from hapticd.sim.fingers.pad_ellipse import calibrated
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.settings import Settings
from hapticd.tools.record import simulated
from hapticd.tools.record.replay import replay, report
from hapticd.wire.client import decode_targets, encode_targets
from hapticd_contract.targets import ClientTargets

from .conftest import rewritten, written

LONG_LINE_BYTES = 60  # only a reference is so long


def test_a_simulated_run_is_replayed_bit_for_bit(strokes: Path) -> None:
    outcome = replay(open_recording(strokes))

    assert outcome.is_identical
    assert outcome.references > 50
    assert outcome.lines == sum(record.kind == "written" for record in open_recording(strokes).records())


def test_every_kind_of_input_is_replayed_bit_for_bit(eventful: Path) -> None:
    recording = open_recording(eventful)
    kinds = Counter(record.kind for record in recording.records())

    assert set(INPUTS) <= set(kinds)
    assert kinds["marker"] == 1
    happened = [record.fields for record in recording.records() if record.kind == "event"]
    assert [event["number"] for event in happened] == list(range(1, len(happened) + 1))
    assert {"landed", "lifted", "entered", "left", "begun", "ended"} <= {event["kind"] for event in happened}
    assert replay(recording).is_identical


def test_priorities_are_recorded_and_decide_the_same_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of three fingers on four modes one comes first; without its priority the plate does something else."""
    monkeypatch.setattr(scripted, "ClientTargets", SimpleNamespace(of=partial(ClientTargets.of, priorities={1: 2})))
    path = tmp_path / "priorities.mcap"
    simulated.run("one-of-three", path, settings=Settings(plate=PlateSettings.of("fingertip")), seed=1, seconds=0.5)

    def without(record: Record) -> Record:
        if record.kind != "targets":
            return record
        message = decode_targets(record.fields["payload"])
        assert all(one.priority == (2 if one.finger == 1 else 0) for one in message.targets)
        equal = tuple(structs.replace(one, priority=0) for one in message.targets)
        payload = encode_targets(structs.replace(message, targets=equal))
        return record._replace(fields={**record.fields, "payload": payload})

    assert replay(open_recording(path)).is_identical
    assert not replay(open_recording(rewritten(path, tmp_path / "without.mcap", without))).is_identical


def test_ellipses_of_contacts_are_recorded_and_decide_the_same_again(tmp_path: Path) -> None:
    """A daemon that takes the same contacts for discs does something else."""
    path, tip = tmp_path / "ellipses.mcap", Fingertip(5.5, 4.0, 0.6)
    settings = Settings(plate=PlateSettings.of("fingertip"), fingertip=tip, config=calibrated(Config()))
    simulated.run("strokes", path, settings=settings, seed=1, seconds=0.6)
    recording = open_recording(path)
    assert replay(recording).is_identical

    pad = replace(recording.header.config.trackpad, ellipse_scale=0.0)
    header = replace(recording.header, config=replace(recording.header.config, trackpad=pad))
    assert not replay(open_recording(written(tmp_path / "discs.mcap", header, recording.records()))).is_identical


def test_a_changed_byte_is_the_first_difference(tmp_path: Path, strokes: Path) -> None:
    late = 300

    def is_struck(record: Record) -> bool:
        return record.kind == "written" and record.seq >= late and len(record.fields["line"]) > LONG_LINE_BYTES

    def with_other_knot(record: Record) -> Record:
        if not is_struck(record):
            return record
        line = record.fields["line"]
        return record._replace(fields=record.fields | {"line": line[:30] + bytes((line[30] ^ 1,)) + line[31:]})

    difference = replay(open_recording(rewritten(strokes, tmp_path / "other.mcap", with_other_knot))).difference
    first = next(record for record in open_recording(strokes).records() if is_struck(record))

    assert difference is not None
    assert difference.replayed == first.fields["line"]
    assert difference.recorded != difference.replayed
    assert difference.t_ns == first.t_ns


def test_a_missing_record_is_a_loss_and_what_precedes_it_is_compared(tmp_path: Path, strokes: Path) -> None:
    records = list(open_recording(strokes).records())
    last_line = max(record.seq for record in records if record.kind == "written")
    timer = next(record.seq for record in records if record.kind == "timer" and record.seq > 200)

    def without(seq: int) -> Callable[[Record], Record | None]:
        return lambda record: None if record.seq == seq else record

    for name, seq in (("input", timer), ("line", last_line)):
        recording = open_recording(rewritten(strokes, tmp_path / f"{name}.mcap", without(seq)))
        outcome = replay(recording)
        assert (outcome.lost_seq, outcome.difference) == (seq, None)
        assert outcome.lines > 0
        assert not outcome.is_identical
        assert f"up to record {seq}, which is missing" in report(recording, outcome)


def test_a_recording_cut_anywhere_is_identical_as_far_as_it_goes(tmp_path: Path, eventful: Path) -> None:
    recording = open_recording(eventful)
    records = list(recording.records())
    for share in (0.3, 0.7, 0.999):
        cut = written(tmp_path / f"{share}.mcap", recording.header, records[: int(share * len(records))])
        cut.write_bytes(cut.read_bytes()[:-10])
        found = open_recording(cut)
        outcome = replay(found)
        assert outcome.is_identical
        assert outcome.lines > 0
        assert "it stops before the daemon did" in report(found, outcome)


def test_an_input_that_no_daemon_can_have_received_is_one_sentence(tmp_path: Path, strokes: Path) -> None:
    def another_pad(record: Record) -> Record:
        return record._replace(fields=record.fields | {"model": "mt9"}) if record.kind == "trackpad_link" else record

    recording = open_recording(rewritten(strokes, tmp_path / "pad.mcap", another_pad))

    with pytest.raises(RecordingError, match=r"trackpad_link.*cannot be replayed"):
        replay(recording)


def test_the_command_reports_identity_or_shows_the_difference(
    strokes: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["replay", str(strokes)]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("bit-identical: ")
    assert printed.count("\n") == 1

    monkeypatch.setattr(board_gateway, "FRESH_START", b"")
    assert main(["replay", str(strokes)]) == 1
    printed = capsys.readouterr().out
    assert printed.startswith("first difference after 0 references, 0 lines to the board: at 0.000000 s")
    assert "recorded: MSG_HELLO_REQUEST " in printed
