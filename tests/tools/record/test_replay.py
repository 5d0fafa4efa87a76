"""Replay: the same core on the same inputs gives the same bytes, and what is not the same is shown."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from hapticd.__main__ import main
from hapticd.daemon import board_gateway as board_gateway
from hapticd.errors import RecordingError
from hapticd.files.recording.framing import MAGIC, SYNC, Scanner, frame
from hapticd.files.recording.header import decode_header, encode_header
from hapticd.files.recording.reader import open_recording
from hapticd.files.recording.records import HEARD, KINDS
from hapticd.tools.record.replay import replay, report, told

LONG_LINE_BYTES = 60  # only a reference is so long


def rewritten(source: Path, target: Path, change: object) -> Path:
    """A copy with `change(raw)` instead of each framed record."""
    scanner = Scanner()
    raws = [*scanner.feed(source.read_bytes()[len(MAGIC) :]), *scanner.finish()]
    changed = [change(raw) for raw in raws]  # type: ignore[operator]
    target.write_bytes(MAGIC + b"".join(frame(*raw) for raw in changed if raw is not None))
    return target


def test_a_simulated_run_is_replayed_bit_for_bit(strokes: Path) -> None:
    outcome = replay(open_recording(strokes))

    assert outcome.is_identical
    assert outcome.references > 50
    written = [record for record in open_recording(strokes).records() if record.kind == "written"]
    assert outcome.lines == len(written)


def test_every_kind_of_event_is_replayed_bit_for_bit(eventful: Path) -> None:
    recording = open_recording(eventful)
    kinds = Counter(record.kind for record in recording.records())

    assert set(HEARD) <= set(kinds)
    assert kinds["marker"] == 1
    assert replay(recording).is_identical


def test_writes_that_the_line_refused_are_refused_again(tmp_path: Path, eventful: Path) -> None:
    def all_accepted(raw):  # type: ignore[no-untyped-def]
        if raw.kind != KINDS["written"].number:
            return raw
        return raw._replace(body=raw.body.replace(b"\xc2", b"\xc3")) if raw.body.endswith(b"\xc2") else raw

    recording = open_recording(eventful)
    refused = [record for record in recording.records() if record.kind == "written" and not record.fields[2]]

    assert refused == []  # an unplugged line is told of by board_link before anything is written
    assert replay(open_recording(rewritten(eventful, tmp_path / "all.hrec", all_accepted))).is_identical


def test_a_changed_byte_is_the_first_difference(tmp_path: Path, strokes: Path) -> None:
    wanted = 300

    def with_other_knot(raw):  # type: ignore[no-untyped-def]
        if raw.kind == KINDS["written"].number and raw.seq >= wanted and len(raw.body) > LONG_LINE_BYTES:
            return raw._replace(body=raw.body[:30] + bytes([raw.body[30] ^ 1]) + raw.body[31:])
        return raw

    recording = open_recording(rewritten(strokes, tmp_path / "other.hrec", with_other_knot))
    difference = replay(recording).difference
    later = [r for r in open_recording(strokes).records() if r.kind == "written" and r.seq >= wanted]
    first = next(record for record in later if len(record.fields[1]) > LONG_LINE_BYTES)

    assert difference is not None
    assert difference.replayed == first.fields[1]
    assert difference.recorded != difference.replayed
    assert difference.t_ns == first.t_ns


def test_another_core_differs(strokes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(board_gateway, "START_COMPUTE_NS", board_gateway.START_COMPUTE_NS + 1_000_000)

    outcome = replay(open_recording(strokes))

    assert outcome.difference is not None
    assert told(outcome.difference.recorded).startswith("a reference: ")


def test_a_missing_line_is_a_difference_and_a_missing_input_a_loss(tmp_path: Path, strokes: Path) -> None:
    last = max(record.seq for record in open_recording(strokes).records() if record.kind == "written")
    timer = next(r.seq for r in open_recording(strokes).records() if r.kind == "timer" and r.seq > 200)

    def without(seq: int):  # type: ignore[no-untyped-def]
        return lambda raw: None if raw.seq == seq and raw.kind != 0 else raw

    lost = replay(open_recording(rewritten(strokes, tmp_path / "lost.hrec", without(timer))))
    assert lost.lost_seq == timer
    assert not lost.is_identical
    assert lost.difference is None
    assert replay(open_recording(rewritten(strokes, tmp_path / "line.hrec", without(last)))).lost_seq == last


def test_a_recording_cut_anywhere_is_identical_as_far_as_it_goes(tmp_path: Path, eventful: Path) -> None:
    data = eventful.read_bytes()
    cut = tmp_path / "cut.hrec"
    whole = replay(open_recording(eventful)).lines
    records_at = data.index(SYNC, data.index(SYNC) + 1)
    for share in (0.3, 0.999):
        cut.write_bytes(data[: records_at + int(share * (len(data) - records_at))])
        recording = open_recording(cut)
        outcome = replay(recording)
        assert outcome.is_identical
        assert outcome.lines <= whole
        assert "it stops before the daemon did" in report(recording, outcome)


def test_a_recording_that_began_late_says_that_it_cannot_be_exact(tmp_path: Path, strokes: Path) -> None:
    def late(raw):  # type: ignore[no-untyped-def]
        return (
            raw._replace(body=encode_header(replace(decode_header(raw.body), is_whole=False))) if raw.kind == 0 else raw
        )

    recording = open_recording(rewritten(strokes, tmp_path / "late.hrec", late))

    with pytest.raises(RecordingError, match="begins when the daemon ran already"):
        replay(recording)


def test_what_no_daemon_heard_is_a_sentence(tmp_path: Path, strokes: Path) -> None:
    def another_pad(raw):  # type: ignore[no-untyped-def]
        return raw._replace(body=raw.body.replace(b"\xc0", b"\xa3mt9")) if raw.kind == 5 else raw

    recording = open_recording(rewritten(strokes, tmp_path / "pad.hrec", another_pad))

    with pytest.raises(RecordingError, match=r"trackpad_link.*cannot be replayed"):
        replay(recording)


def test_the_command_says_identical_or_shows_the_difference(
    strokes: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["replay", str(strokes)]) == 0
    said = capsys.readouterr().out
    assert said.startswith("bit-identical: ")
    assert said.count("\n") == 1

    monkeypatch.setattr(board_gateway, "FRESH_START", b"")
    assert main(["replay", str(strokes)]) == 1
    said = capsys.readouterr().out
    assert said.startswith("first difference after 0 references, 0 lines to the board: at 0.000000 s")
    assert "recorded: a greeting: " in said
