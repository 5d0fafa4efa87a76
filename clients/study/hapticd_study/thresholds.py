"""Thresholds of each participant and condition, and ratings: rows of the report."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from .experiment import Levels
from .psychometric import Curve, fit
from .session import Session


@dataclass(frozen=True, slots=True)
class ConditionCurve:
    """A participant's psychometric function in one condition; None for fewer than two levels."""

    participant: str
    condition: Levels
    trials: int
    curve: Curve | None


def curves(sessions: Iterable[Session]) -> list[ConditionCurve]:
    """Return all psychometric functions of finished sessions."""
    return [one for session in sessions if session.experiment.abscissa for one in _curves(session)]


def threshold_lines(fitted: Sequence[ConditionCurve]) -> list[str]:
    """Return them as a table of text."""
    if not fitted:
        return []
    lines = ["", f"{'participant':<16}{'trials':>8}{'threshold':>12}{'95 % interval':>22}{'spread':>10}  condition"]
    for one in fitted:
        found, interval, spread, unsure = "-", "-", "-", ""
        if one.curve is not None:
            found, spread = f"{one.curve.threshold:.4g}", f"{one.curve.spread:.3g}"
            interval = " .. ".join(f"{end:.4g}" for end in one.curve.threshold_interval)
            unsure = "" if one.curve.is_bounded else " (the levels did not reach it)"
        condition = ", ".join(f"{name} {level}" for name, level in one.condition.items())
        lines.append(f"{one.participant:<16}{one.trials:>8}{found:>12}{interval:>22}{spread:>10}  {condition}{unsure}")
    return lines


def rating_lines(sessions: Sequence[Session]) -> list[str]:
    """Return the mean and standard deviation of answers that are numbers by condition, over all participants."""
    made = sessions[0].experiment
    if made.is_graded or not all(answer.isdecimal() for answer in made.choices):
        return []
    rated: dict[str, list[float]] = {}
    for session in sessions:
        for trial, answer in zip(session.presented, session.answers, strict=False):
            condition = ", ".join(f"{name} {level}" for name, level in trial.levels.items())
            rated.setdefault(condition, []).append(float(answer.answer))
    lines = ["", f"{'answers':>8}{'mean':>9}{'SD':>9}  condition"]
    for condition, all_rated in sorted(rated.items()):
        spread = f"{statistics.stdev(all_rated):.3f}" if len(all_rated) > 1 else "-"
        lines.append(f"{len(all_rated):>8}{statistics.fmean(all_rated):>9.3f}{spread:>9}  {condition}")
    return lines


def _curves(session: Session) -> Iterator[ConditionCurve]:
    """Yield a function for each combination of the factors, but of the abscissa and of what says the right answer."""
    made = session.experiment
    tracks: dict[tuple[tuple[str, Any], ...], list[tuple[float, bool]]] = {}
    for trial, answer in zip(session.presented, session.answers, strict=False):
        levels = dict(trial.levels)
        level = float(levels.pop(made.abscissa))
        levels.pop(made.correct, None)
        right = trial.correct or next(iter(made.choices))
        tracks.setdefault(tuple(levels.items()), []).append((level, answer.answer == right))
    guess_frac = 1.0 / len(made.choices) if made.is_graded else 0.0
    falls = None if made.adaptive is None else made.adaptive.harder == "higher"
    for condition, track in tracks.items():
        yield ConditionCurve(session.participant, dict(condition), len(track), fit(track, guess_frac, falls=falls))
