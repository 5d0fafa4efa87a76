"""A study's report: all finished sessions of a folder, as text, CSV, JSON and the paper's figure 12."""

from __future__ import annotations

import csv
import json
import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from . import picture
from .analysis import Group, Result, judge, judge_group
from .protocol import StudyError
from .session import SUFFIX, Session, read

RESULTS, TRIALS, FIGURE = "results.csv", "trials.csv", "figure-12.png"


def write(folder: Path, json_file: str | None = None) -> None:
    """Judge the sessions in `folder`, print the report and write its files beside them.

    Raises StudyError where no session is finished, a file is damaged, or nothing can be written.
    """
    sessions = sessions_in(folder)
    finished = [session for session in sessions if session.is_over]
    if not finished:
        raise StudyError(f"{folder}: holds no finished session: {_progress(sessions) or 'run one with --out first'}.")
    results = [judge(session) for session in finished]
    group = judge_group(results)
    print(text(results, group), file=sys.stderr if json_file == "-" else sys.stdout)
    for line in _remarks(sessions):
        print(line, file=sys.stderr)
    _write_rows(folder / RESULTS, result_rows(results, group))
    _write_rows(folder / TRIALS, trial_rows(finished))
    picture.draw(results, group, folder / FIGURE)
    if json_file is not None:
        told = json.dumps(figures(results, group), indent=2) + "\n"
        sys.stdout.write(told) if json_file == "-" else _write_text(Path(json_file), told)


def sessions_in(folder: Path) -> list[Session]:
    """All sessions of a folder, by the participants' names (P2 before P10). Raises StudyError."""
    if not folder.is_dir():
        raise StudyError(f"{folder}: is no folder: give the --out of the sessions.")
    whose: dict[str, Path] = {}
    sessions = []
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        sessions.append(read(path))
        first = whose.setdefault(sessions[-1].participant, path)
        if first != path:
            raise StudyError(
                f"{path}: is {sessions[-1].participant}'s, as {first} is: keep one of them, or it counts twice."
            )
    return sorted(sessions, key=lambda session: (len(session.participant), session.participant))


def text(results: Sequence[Result], group: Group) -> str:
    """The report for a person."""
    lines = [f"{'participant':<16}{'recognised':>12}{'rate':>10}{'95 % interval':>16}{'p':>10}{'low':>9}{'high':>8}"]
    for one in results:
        low, high = one.interval_frac
        recognised, interval = f"{one.correct} of {one.trials}", f"{100 * low:.0f} .. {100 * high:.0f} %"
        lines.append(
            f"{one.participant:<16}{recognised:>12}{_percent(one.rate_frac, 1):>10}{interval:>16}{_p(one.p):>10}"
            f"{_of(one.low):>9}{_of(one.high):>8}"
        )
    spread = "" if math.isnan(group.sd_frac) else f", standard deviation {_percent(group.sd_frac, 2)}"
    lines += ["", f"average success rate {_percent(group.mean_frac, 2)}{spread} ({_people(len(results))})"]
    lines += ["against guessing, 50 %, two-sided:", *_tests(results, group)]
    return "\n".join(lines)


def _tests(results: Sequence[Result], group: Group) -> list[str]:
    on_trials = f"{group.correct} of {group.trials} trials together"
    lines = [f"  exact binomial test   {on_trials:<32}p = {_p(group.pooled_p)}"]
    if len(results) == 1:
        return lines
    if not math.isnan(group.t):
        lines.append(f"  t test of the rates   {f't({len(results) - 1}) = {group.t:.2f}':<32}p = {_p(group.t_p)}")
    if not math.isnan(group.sign_p):
        beside = f"{group.above} above 50 %, {group.below} below"
        lines.append(f"  exact sign test       {beside:<32}p = {_p(group.sign_p)}")
    if not math.isnan(group.wilcoxon_p):
        lines.append(f"  Wilcoxon signed rank  {'':<32}p = {_p(group.wilcoxon_p)}")
    return lines


def figures(results: Sequence[Result], group: Group) -> dict[str, Any]:
    """The report as plain data; null where a figure has no meaning."""
    people = [
        {**asdict(one), "correct": one.correct, "trials": one.trials, "rate_frac": one.rate_frac} for one in results
    ]
    plain = {name: None if math.isnan(value) else value for name, value in asdict(group).items()}
    return {"participants": people, "group": plain}


def result_rows(results: Sequence[Result], group: Group) -> list[list[object]]:
    """A row for each participant, then the average and the standard deviation of the rates."""
    head: list[object] = ["participant", "recognised", "trials", "success_rate_percent", "p_binomial"]
    rows: list[list[object]] = [head]
    rows += [[one.participant, one.correct, one.trials, 100 * one.rate_frac, one.p] for one in results]
    rows.append(["average", group.correct, group.trials, 100 * group.mean_frac, group.pooled_p])
    if not math.isnan(group.sd_frac):
        rows.append(["standard deviation", "", "", 100 * group.sd_frac, ""])
    return rows


def trial_rows(sessions: Iterable[Session]) -> list[list[object]]:
    """A row for each trial of the finished sessions."""
    head = ["participant", "trial", "combination", "presented", "answer", "recognised"]
    measured = ["t_unix_s", "took_s", "touched_s", "speed_mm_s", "limited_frac"]
    rows: list[list[object]] = [[*head, *measured]]
    for session in sessions:
        for answer, friction in zip(session.answers, session.presented, strict=True):
            recognised = int(answer.answer is friction)
            rows.append(
                [session.participant, answer.trial, friction.combination, friction, answer.answer, recognised]
                + [getattr(answer, name) for name in measured]
            )
    return rows


def _remarks(sessions: Sequence[Session]) -> list[str]:
    """What a reader must know of what was judged together."""
    remarks = [f"not judged, for it is not finished: {progress}" for progress in [_progress(sessions)] if progress]
    if len({session.design for session in sessions if session.is_over}) > 1:
        remarks.append("These sessions are not of one design (trials, amplitude, line): do not judge them together.")
    people = {bool(session.about.get("simulated")) for session in sessions if session.is_over}
    if people == {True}:
        remarks.append("These participants are simulated: this is no evidence about people.")
    elif len(people) > 1:
        remarks.append("Simulated participants and people lie in one folder: judge them apart.")
    return remarks


def _progress(sessions: Iterable[Session]) -> str:
    open_ones = [session for session in sessions if not session.is_over]
    return ", ".join(f"{one.participant} ({len(one.answers)} of {one.design.trials})" for one in open_ones)


def _write_rows(path: Path, rows: Iterable[Sequence[object]]) -> None:
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows(rows)
    except OSError as error:
        raise StudyError(f"{path}: cannot be written ({error.strerror}).") from None


def _write_text(path: Path, told: str) -> None:
    try:
        path.write_text(told, encoding="utf-8")
    except OSError as error:
        raise StudyError(f"{path}: cannot be written ({error.strerror}).") from None


def _percent(frac: float, digits: int) -> str:
    return f"{100 * frac:.{digits}f} %"


def _p(p: float) -> str:
    return f"{p:.3f}" if p >= 0.001 else f"{p:.1e}"


def _of(counts: tuple[int, int]) -> str:
    return f"{counts[0]}/{counts[1]}"


def _people(count: int) -> str:
    return f"{count} participant{'' if count == 1 else 's'}"
