"""The session file: durable, blind until its end, and hostile bytes are refused."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import to_builtins
from people import answer, paper, session, write

from hapticd_study.experiment import StudyError
from hapticd_study.session import Session, SessionFile, decode, read

HELD = session("P03", 15)
LONG = 10**3000  # no float holds it


def lines_of(held: Session, folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in write(folder, held).read_bytes().splitlines()]


def joined(lines: list[dict[str, Any]]) -> bytes:
    return b"".join(json.dumps(line).encode() + b"\n" for line in lines)


def test_a_session_is_read_as_it_was_held_and_its_end_holds_the_stimuli(tmp_path: Path) -> None:
    lines = lines_of(HELD, tmp_path)
    assert read(tmp_path / "P03.jsonl") == HELD
    assert lines[-1] == {"kind": "end", "presented": [one.shown for one in HELD.presented]}


def test_a_session_continues_where_a_crash_cut_its_file(tmp_path: Path) -> None:
    held = session("P1", 2, trials=3)
    whole = write(tmp_path, held).read_bytes()
    first_answer = whole.index(b"\n", whole.index(b"\n") + 1) + 1
    for cut in range(first_answer, len(whole), 7):
        path = tmp_path / "cut.jsonl"
        path.write_bytes(whole[:cut])
        with SessionFile(path, Session("P1", 99, paper(3))) as file:
            kept = len(file.session.answers)
            assert kept == min(whole[:cut].count(b"\n") - 1, 3)
            for one in held.answers[kept:]:
                file.append(one)
            file.end()
        assert path.read_bytes() == whole


@pytest.mark.parametrize(
    "theirs", [b"notes without an end of line", b'{"kind": "letter"}', b'{"kind": "session"}\nnotes']
)
def test_a_file_that_is_no_session_is_left_as_it_is(theirs: bytes, tmp_path: Path) -> None:
    path = tmp_path / "P1.jsonl"
    path.write_bytes(theirs)
    with pytest.raises(StudyError):
        SessionFile(path, Session("P1", 99, paper()))
    assert path.read_bytes() == theirs


def test_a_pipe_a_folder_and_a_session_in_use_are_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.jsonl")
    (tmp_path / "folder.jsonl").mkdir()
    for name in ("pipe", "folder"):
        with pytest.raises(StudyError, match=f"{name}.jsonl: cannot be opened"):
            SessionFile(tmp_path / f"{name}.jsonl", Session("P1", 1, paper()))
    path = tmp_path / "P1.jsonl"
    with SessionFile(path, Session("P1", 1, paper())), pytest.raises(StudyError, match="another hapticd-study"):
        SessionFile(path, Session("P1", 1, paper()))


def test_a_session_on_the_simulated_plate_cannot_continue_on_a_real_one(tmp_path: Path) -> None:
    path = tmp_path / "P1.jsonl"
    with SessionFile(path, Session("P1", 1, paper())) as file:
        for is_simulated in (True, False, True):  # without answers the participant may move
            file.mark_simulated_plate(path, is_simulated=is_simulated)
            assert read(path).simulated == ("plate" if is_simulated else "")
        file.append(HELD.answers[0])
        before = path.read_bytes()
        with pytest.raises(StudyError, match="simulated plate"):
            file.mark_simulated_plate(path, is_simulated=False)
    assert path.read_bytes() == before


def test_until_the_last_answer_the_file_holds_no_stimulus(tmp_path: Path) -> None:
    """Two sessions with other orders and the same answers differ in the seed alone."""
    one, other = (replace(HELD, seed=seed, answers=HELD.answers[:19], is_over=False) for seed in (11, 12))
    assert one.presented != other.presented
    (tmp_path / "b").mkdir()
    first, second = lines_of(one, tmp_path), lines_of(other, tmp_path / "b")
    assert first[0].pop("seed") != second[0].pop("seed")
    assert first == second


def test_answers_come_in_their_order_and_the_end_last(tmp_path: Path) -> None:
    with SessionFile(tmp_path / "P1.jsonl", Session("P1", 1, paper(1))) as file:
        with pytest.raises(ValueError, match="not the next"):
            file.append(answer(2, "low"))
        with pytest.raises(ValueError, match="missing"):
            file.end()
        file.append(answer(1, "low"))
        with pytest.raises(ValueError, match="not the next"):
            file.append(answer(2, "low"))
        file.end()
        file.end()
    assert read(tmp_path / "P1.jsonl").is_over


@pytest.mark.parametrize(
    ("number", "fields"),
    [
        *((0, {name: value}) for name in ("version", "seed", "participant") for value in (LONG, None, [])),
        *((3, {name: value}) for name in ("trial", "took_s", "answer") for value in (LONG, None, "maybe")),
        (0, {"kind": "answer"}),
        (0, {"seed": -1}),
        (0, {"seed": True}),
        (0, {"participant": "../P"}),
        (0, {"experiment": {}}),
        (0, {"simulated": "participant"}),
        (3, {"took_s": float("nan")}),
        (3, {"kind": "end", "presented": []}),
        (21, {"presented": LONG}),
        (21, {"presented": ["low"] * 20}),
        (21, {"kind": "answer"}),
    ],
)
def test_a_changed_file_is_refused_with_its_line(number: int, fields: dict[str, Any], tmp_path: Path) -> None:
    lines = lines_of(HELD, tmp_path)
    lines[number] |= fields
    with pytest.raises(StudyError, match=rf"^P03: line {number + 1}[: ].{{1,120}}\.$"):
        decode(joined(lines), "P03")


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
FIRST = {"kind": "session", "version": 2, "participant": "P", "seed": 1, "experiment": to_builtins(paper(2))}
SECOND = {"kind": "answer"} | to_builtins(answer(1, "low"))


@settings(deadline=None)
@given(
    st.binary(max_size=200)
    | st.builds(
        lambda name, value, other: joined([FIRST | ({name: value} if name in FIRST else {}), SECOND | other]),
        st.sampled_from([*FIRST, "none"]),
        json_values,
        st.dictionaries(st.sampled_from([*SECOND]) | st.text(max_size=5), json_values, max_size=2),
    )
)  # fmt: skip
def test_hostile_bytes_raise_nothing_but_the_study_s_error(data: bytes) -> None:
    try:
        held = decode(data, "P")
    except StudyError:
        return
    assert len(held.answers) <= held.experiment.trials
