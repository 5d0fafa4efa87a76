"""The session file: durable, blind until its end, and hostile bytes are refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import to_builtins
from people import answer, paper, session, write

from hapticd.tools.study.experiment import StudyError
from hapticd.tools.study.session import Session, SessionFile, decode, read

HELD = session("P03", 15)

LONG = 10**3000  # no float holds it


def lines_of(held: Session, folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in write(folder, held).read_bytes().splitlines()]


def joined(lines: list[dict[str, Any]]) -> bytes:
    return b"".join(json.dumps(line).encode() + b"\n" for line in lines)


def test_a_session_is_read_as_it_was_held(tmp_path: Path) -> None:
    assert read(write(tmp_path, HELD)) == HELD


def test_a_session_continues_where_a_crash_cut_its_file(tmp_path: Path) -> None:
    whole = write(tmp_path, session("P1", 2, trials=3)).read_bytes()
    first_answer = whole.index(b"\n", whole.index(b"\n") + 1) + 1
    for cut in range(first_answer, len(whole), 7):
        path = tmp_path / "cut.jsonl"
        path.write_bytes(whole[:cut])
        with SessionFile(path, Session("P1", 99, paper(3))) as file:
            kept = len(file.session.answers)
            assert kept == min(whole[:cut].count(b"\n") - 1, 3)
            for one in session("P1", 2, trials=3).answers[kept:]:
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


def test_a_session_on_the_simulated_plate_is_marked_and_cannot_continue_on_a_real_one(tmp_path: Path) -> None:
    path = tmp_path / "P1.jsonl"
    with SessionFile(path, Session("P1", 1, paper())) as file:
        for is_simulated in (True, False, True):  # without answers the participant may move
            file.mark_simulated_plate(path, is_simulated=is_simulated)
            assert read(path).simulated == ("plate" if is_simulated else "")
        file.append(HELD.answers[0])
    with SessionFile(path, Session("P1", 2, paper())) as file:
        file.mark_simulated_plate(path, is_simulated=True)
        before = path.read_bytes()
        with pytest.raises(StudyError, match="was started on the simulated plate: continue there"):
            file.mark_simulated_plate(path, is_simulated=False)
    assert path.read_bytes() == before
    assert (read(path).simulated, read(path).seed, len(read(path).answers)) == ("plate", 1, 1)


def test_a_mark_of_older_files_is_a_simulated_participant_and_an_unknown_one_is_refused(tmp_path: Path) -> None:
    lines = lines_of(HELD, tmp_path)
    lines[0]["simulated"] = True
    assert decode(joined(lines), "file").simulated == "participant"
    for unknown in (False, "no", ["plate"], 2):
        lines[0]["simulated"] = unknown
        with pytest.raises(StudyError):
            decode(joined(lines), "file")


def test_until_the_last_answer_the_file_holds_no_stimulus(tmp_path: Path) -> None:
    """Two sessions with other orders and the same answers differ in the seed alone."""
    answers = HELD.answers[:19]
    one, other = (replace(HELD, seed=seed, answers=answers) for seed in (11, 12))
    assert one.presented != other.presented
    (tmp_path / "b").mkdir()
    first, second = lines_of(one, tmp_path), lines_of(other, tmp_path / "b")
    assert first[0].pop("seed") != second[0].pop("seed")
    assert first == second


def test_a_file_of_version_1_is_read_with_its_own_design_and_continued(tmp_path: Path) -> None:
    design = {"trials": 20, "slippery_um": 1.5, "line_mm": [[0, 0], [1, 1]], "line_speed_mm_s": 9.0}
    lines = lines_of(HELD, tmp_path)
    lines[0] = {"kind": "session", "version": 1, "participant": "P03", "seed": HELD.seed, "design": design}
    lines[-1] = {"kind": "end", "presented": [one.correct for one in HELD.presented]}
    held = decode(joined(lines), "file")
    assert (held.is_over, held.answers, held.presented) == (True, HELD.answers, HELD.presented)
    targets = held.experiment.targets({"friction": "low"})
    assert [one.amplitude_um for one in targets.targets] == [1.5, 0.0]
    assert (targets.virtuals[0].path_mm, targets.virtuals[0].speed_mm_s) == (((0.0, 0.0), (1.0, 1.0)), 9.0)


def test_the_end_holds_the_stimuli(tmp_path: Path) -> None:
    assert lines_of(HELD, tmp_path)[-1] == {"kind": "end", "presented": [one.shown for one in HELD.presented]}


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


def test_two_processes_cannot_hold_one_session(tmp_path: Path) -> None:
    given_ = Session("P1", 1, paper())
    with SessionFile(tmp_path / "P1.jsonl", given_), pytest.raises(StudyError, match="another hapticd study"):
        SessionFile(tmp_path / "P1.jsonl", given_)
    SessionFile(tmp_path / "P1.jsonl", given_).__exit__(None, None, None)


def edited(lines: list[dict[str, Any]], number: int, **fields: Any) -> bytes:
    return joined([{**line, **fields} if place == number else line for place, line in enumerate(lines)])


@pytest.mark.parametrize(
    ("number", "fields"),
    [
        (0, {"kind": "answer"}),
        (0, {"version": 3}),
        (0, {"version": LONG}),
        (0, {"seed": LONG}),
        (0, {"participant": LONG}),
        (3, {"trial": LONG}),
        (3, {"took_s": LONG}),
        (21, {"presented": LONG}),
        (0, {"seed": -1}),
        (0, {"seed": True}),
        (0, {"participant": "../P"}),
        (0, {"experiment": {}}),
        (3, {"trial": 9}),
        (3, {"answer": "maybe"}),
        (3, {"took_s": float("nan")}),
        (3, {"speed_mm_s": None}),
        (3, {"kind": "end", "presented": []}),
        (21, {"presented": ["low"] * 20}),
        (21, {"kind": "answer"}),
    ],
)
def test_a_changed_file_is_refused_with_its_line(number: int, fields: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=rf"^P03: line {number + 1}[: ].{{1,120}}\.$"):
        decode(edited(lines_of(HELD, tmp_path), number, **fields), "P03")


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
ANSWER_LINE = {"kind": "answer", "trial": 1, "answer": "low", "t_unix_s": 0, "took_s": 0, "touched_s": 0}


@settings(deadline=None)
@given(
    st.binary(max_size=200)
    | st.builds(
        lambda version, name, value, of_answer, other: joined(
            [{"kind": "session", "version": version, "participant": "P", "seed": 1, "experiment": to_builtins(paper(2))}
             | {"design": {"trials": 2, "slippery_um": 1, "line_mm": [[0, 0], [1, 1]], "line_speed_mm_s": 9}}
             | ({} if of_answer else {name: value}),
             ANSWER_LINE | {"speed_mm_s": 0, "limited_frac": 0} | ({name: value} if of_answer else {}) | other]
        ),
        st.sampled_from([1, 2]),
        st.sampled_from(
            ["kind", "version", "experiment", "participant", "seed", "design", "trial", "answer", "took_s"]
        ),
        json_values,
        st.booleans(),
        st.dictionaries(st.text(max_size=5), json_values, max_size=2),
    )
)  # fmt: skip
def test_hostile_bytes_raise_nothing_but_the_study_s_error(data: bytes) -> None:
    try:
        held = decode(data, "P")
    except StudyError:
        return
    assert len(held.answers) <= held.experiment.trials
