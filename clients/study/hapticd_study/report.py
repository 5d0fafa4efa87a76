"""`hapticd-study report`: all finished sessions of a folder as text, CSV, JSON and the paper's figure 12.

Answers that are right or wrong have success rates and tests, levels that are numbers a psychometric function, answers
that are numbers their means by condition.
"""

from __future__ import annotations

import csv
import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from statistics import median
from typing import Any, TypeAlias

from matplotlib.figure import Figure

from .analysis import Group, Result, analyse, analyse_group
from .experiment import StudyError
from .session import ERRORS, SUFFIX, Answer, Session, read
from .thresholds import curves, rating_lines, threshold_lines

RESULTS, TRIALS, FIGURE = "results.csv", "trials.csv", "figure-12.png"
TITLE = "hapticd-study report"  # of the picture, among its first bytes
MARKS = {RESULTS: b"participant,recognised,", TRIALS: b"participant,trial,", FIGURE: TITLE.encode()}
MARKED_BYTES = 512
MEASURED = [field.name for field in fields(Answer)][2:]  # behind the trial's number and the answer
STDOUT = "-"
LIGHT, DARK = "#9ecae1", "#08519c"
Row: TypeAlias = Mapping[str, Any]
BAR_IN = 0.55  # a participant's share of the figure's width
MAX_WIDTH_IN = 16.0
DPI = 110


def write(folder: Path, json_file: str | None = None, *, is_forced: bool = False) -> None:
    """Analyse the sessions in `folder`, print the report, and write its files there, over those of an earlier report.

    Raises StudyError if no session is finished, a file is damaged, simulated sessions are among others, or an output
    holds something else; OSError.
    """
    sessions = sessions_in(folder)
    if not is_forced:
        _check_outputs(folder, json_file)
    finished = [session for session in sessions if session.is_over]
    if not finished:
        raise StudyError(f"{folder}: holds no finished session: {_progress(sessions) or 'run one with --out first'}.")
    for what, kinds in (
        ("experiments", {session.experiment.name for session in finished}),
        ("real and simulated plates", {session.simulated for session in finished}),
    ):
        if len(kinds) > 1:
            names = ", ".join(f"{one.participant}: {one.simulated or one.experiment.name}" for one in finished)
            raise StudyError(f"{folder}: mixes {what} ({names}): give each kind a folder of its own.")
    simulated = finished[0].simulated
    results = [analyse(session) for session in finished] if finished[0].experiment.is_graded else []
    group = analyse_group(results) if results else None
    fitted = curves(finished)
    lines = [text(results, group, simulated)] if group is not None else []
    lines += [*threshold_lines(fitted), *rating_lines(finished), *error_lines(finished)]
    print("\n".join(lines), file=sys.stderr if json_file == STDOUT else sys.stdout)
    for line in _remarks(sessions):
        print(line, file=sys.stderr)
    rows = trial_rows(finished)
    _write_rows(folder / TRIALS, rows)
    written = [TRIALS]
    if group is not None:
        _write_rows(folder / RESULTS, result_rows(results, group, simulated))
        draw(results, group, folder / FIGURE, simulated)
        written = [RESULTS, TRIALS, FIGURE]
    print(f"wrote {', '.join(written)} in {folder}", file=sys.stderr)
    if json_file is not None:
        analysed = figures(results, group) if group is not None else {}
        curves_ = [asdict(one) for one in fitted]
        plain = json.dumps({"simulated": simulated or None, **analysed, "curves": curves_, "trials": rows}, indent=2)
        print(plain) if json_file == STDOUT else Path(json_file).write_text(plain + "\n", encoding="utf-8")


def _check_outputs(folder: Path, json_file: str | None) -> None:
    """Raise StudyError for a file with the name of a report's that no report wrote."""
    for name, mark in MARKS.items():
        path = folder / name
        if path.exists() and not (path.is_file() and mark in path.read_bytes()[:MARKED_BYTES]):
            raise StudyError(f"{path}: is no file of an earlier report: move it away, or add --force to overwrite it.")
    if json_file not in (None, STDOUT) and Path(str(json_file)).is_file():
        raise StudyError(f"{json_file}: exists already: name another file, or add --force to overwrite it.")


def sessions_in(folder: Path) -> list[Session]:
    """Read all sessions of a folder, sorted by participant (P2 before P10). Raises StudyError."""
    if not folder.is_dir():
        raise StudyError(f"{folder}: is no folder: give the one that `hapticd-study run` had as --out.")
    paths: dict[str, Path] = {}
    sessions = []
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        sessions.append(read(path))
        first = paths.setdefault(sessions[-1].participant, path)
        if first != path:
            raise StudyError(f"{path}: is {sessions[-1].participant}'s, as {first} is: delete one, or it counts twice.")
    return sorted(sessions, key=lambda session: (len(session.participant), session.participant))


def text(results: Sequence[Result], group: Group, simulated: str = "") -> str:
    """Return the report as text; `simulated` as `Session.simulated`."""
    lines = [f"{'participant':<16}{'recognised':>12}{'rate':>10}{'95 % interval':>16}{'p':>10}"]
    for one in results:
        low, high = (100 * end for end in one.interval_frac)
        recognised, interval = f"{one.correct} of {one.trials}", f"{low:.0f} .. {high:.0f} %"
        rate = f"{100 * one.rate_frac:.1f} %"
        lines.append(f"{one.participant:<16}{recognised:>12}{rate:>10}{interval:>16}{_p(one.p):>10}")
    spread = "" if math.isnan(group.sd_frac) else f", standard deviation {100 * group.sd_frac:.2f} %"
    lines += ["", f"average success rate {100 * group.mean_frac:.2f} %{spread} ({_people(len(results), simulated)})"]
    lines += [f"against guessing, {100 * group.guess_frac:.3g} %, two-sided:", *_tests(results, group)]
    return "\n".join(lines)


def error_lines(sessions: Sequence[Session]) -> list[str]:
    """Return how far the first finger's friction was from what was asked, by telemetry, medians over the trials."""
    answers = [answer for session in sessions for answer in session.answers if answer.median_jnd is not None]
    if not answers:
        return []
    bias, middle, most, one, two = (median(getattr(answer, name) for answer in answers) for name in ERRORS)
    return [
        f"first finger, by the daemon's belief of the person: bias {bias:.2f}, median {middle:.2f}, 95 % {most:.2f} "
        f"JND; within one JND {one:.0%}, two {two:.0%} of the time (medians of {len(answers)} trials)"
    ]


def _tests(results: Sequence[Result], group: Group) -> list[str]:
    on_trials = f"{group.correct} of {group.trials} trials together"
    lines = [f"  exact binomial test   {on_trials:<32}p = {_p(group.pooled_p)}"]
    if not math.isnan(group.t):
        lines.append(f"  t test of the rates   {f't({len(results) - 1}) = {group.t:.2f}':<32}p = {_p(group.t_p)}")
    return lines


def figures(results: Sequence[Result], group: Group) -> dict[str, Any]:
    """Return the report as plain data; an undefined figure is null."""
    people = [
        {**asdict(one), "correct": one.correct, "trials": one.trials, "rate_frac": one.rate_frac} for one in results
    ]
    plain = {name: None if math.isnan(value) else value for name, value in asdict(group).items()}
    return {"participants": people, "group": plain}


def result_rows(results: Sequence[Result], group: Group, simulated: str) -> list[Row]:
    """Return a row for each participant, then the average and the standard deviation of the rates."""

    def row(name: str, rate_frac: float, correct: object = "", trials: object = "", p: object = "") -> Row:
        found = {"participant": name, "recognised": correct, "trials": trials, "success_rate_percent": 100 * rate_frac}
        return {**found, "p_binomial": p, "simulated": simulated}

    rows = [row(one.participant, one.rate_frac, one.correct, one.trials, one.p) for one in results]
    rows.append(row("average", group.mean_frac, group.correct, group.trials, group.pooled_p))
    return rows if math.isnan(group.sd_frac) else [*rows, row("standard deviation", group.sd_frac)]


def trial_rows(sessions: Sequence[Session]) -> list[Row]:
    """Return a row for each trial of the finished sessions: its levels, the right answer and what was measured."""
    factors = dict.fromkeys(name for session in sessions for name in session.presented[0].levels)
    return [
        {"participant": session.participant, "trial": answer.trial}
        | {name: trial.levels.get(name) for name in factors}
        | {"presented": trial.correct, "answer": answer.answer}
        | {"recognised": int(answer.answer == trial.correct) if trial.correct else None}
        | {name: getattr(answer, name) for name in MEASURED}
        | {"simulated": session.simulated}
        for session in sessions
        for answer, trial in zip(session.answers, session.presented, strict=False)
    ]


def draw(results: Sequence[Result], group: Group, path: Path, simulated: str = "") -> None:
    """Draw the paper's figure 12: success rates, light, with their 95 % intervals, and their average with its standard
    deviation, dark."""
    width_in = min(2.4 + BAR_IN * len(results), MAX_WIDTH_IN)
    figure = Figure(figsize=(max(width_in, 4.0), 3.2), layout="constrained", dpi=DPI)
    axes = figure.subplots()
    top = max(105.0, 5.0 + 100 * (group.mean_frac + (0.0 if math.isnan(group.sd_frac) else group.sd_frac)))
    trials = sorted({one.trials for one in results})
    axes.set(ylabel="stimuli recognised, %", ylim=(0, top))
    axes.set_title(
        f"{_people(len(results), simulated)}, {' or '.join(map(str, trials))} trials each, 95 % intervals",
        fontsize="medium",
    )
    places = range(1, len(results) + 1)
    rates = [100 * one.rate_frac for one in results]
    ends = [[abs(100 * one.interval_frac[end] - 100 * one.rate_frac) for one in results] for end in (0, 1)]
    axes.bar(places, rates, yerr=ends, width=0.7, color=LIGHT, ecolor="grey", capsize=3)
    spread = None if math.isnan(group.sd_frac) else 100 * group.sd_frac
    axes.bar(len(results) + 1.5, 100 * group.mean_frac, yerr=spread, width=0.7, color=DARK, capsize=4)
    axes.axhline(100 * results[0].guess_frac, color="grey", lw=0.8, ls="--")
    axes.text(
        1.01, 100 * results[0].guess_frac, "guessing", transform=axes.get_yaxis_transform(), va="center", color="grey"
    )
    definition = "average" if spread is None else f"average ± SD\nn = {len(results)}"
    names = [one.participant for one in results]
    is_crowded = sum(map(len, names)) > 8 * width_in
    axes.set_xticks([*places, len(results) + 1.5], [*names, definition], rotation=45 if is_crowded else 0)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, metadata={"Title": TITLE})


def _remarks(sessions: Sequence[Session]) -> list[str]:
    """Return warnings about the sessions analysed together."""
    finished = [session for session in sessions if session.is_over]
    remarks = [f"not finished, so not analysed: {progress}" for progress in [_progress(sessions)] if progress]
    if any(one.experiment != finished[0].experiment for one in finished):
        remarks.append("These sessions have different designs: analyse them separately.")
    if finished[0].simulated:
        remarks.append("simulated plate: this is no evidence about people on glass.")
    return remarks


def _progress(sessions: Iterable[Session]) -> str:
    open_ones = [session for session in sessions if not session.is_over]
    return ", ".join(f"{one.participant} ({len(one.answers)} of {one.experiment.trials})" for one in open_ones)


def _write_rows(path: Path, rows: Sequence[Row]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def _p(p: float) -> str:
    return f"{p:.3f}" if p >= 0.001 else f"{p:.1e}"


def _people(count: int, simulated: str) -> str:
    return f"{count} participant{'' if count == 1 else 's'}{' on the simulated plate' if simulated else ''}"
