"""Thresholds of each participant and condition, ratings and d': rows of the report besides the success rates."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from .adaptive import LevelTrack, reversals, threshold
from .experiment import Experiment, Levels, QuestPlus, Staircase
from .psychometric import Curve, d_prime, fit
from .session import Session

FIRST_REVERSALS = 2  # of a staircase, which still climbs down to the threshold


@dataclass(frozen=True, slots=True)
class ConditionCurve:
    """A participant's psychometric function in one condition; `threshold` and its 95 % interval by the method of the
    experiment, `reversals_mean` of a staircase, `d_prime` where two answers are right or wrong by a factor."""

    participant: str
    condition: Levels
    trials: int
    threshold: float | None
    interval: tuple[float, float] | None
    method: str
    curve: Curve | None
    reversals_mean: float | None = None

    @property
    def plain(self) -> dict[str, Any]:
        """It as plain values for JSON."""
        return asdict(self)


def curves(sessions: Iterable[Session]) -> list[ConditionCurve]:
    """Return all psychometric functions of finished sessions."""
    return [
        _curve(session, condition, track)
        for session in sessions
        if session.experiment.abscissa
        for condition, track in _tracks(session)
    ]


def threshold_lines(fitted: Sequence[ConditionCurve]) -> list[str]:
    """Return them as a table of text."""
    if not fitted:
        return []
    lines = ["", f"{'participant':<16}{'trials':>8}{'threshold':>12}{'95 % interval':>22}{'spread':>10}  condition"]
    for one in fitted:
        found = "-" if one.threshold is None else f"{one.threshold:.4g}"
        interval = "-" if one.interval is None else f"{one.interval[0]:.4g} .. {one.interval[1]:.4g}"
        spread = "-" if one.curve is None else f"{one.curve.spread:.3g}"
        condition = ", ".join(f"{name} {level}" for name, level in one.condition.items())
        unsure = "" if one.curve is None or one.curve.is_bounded else " (the levels did not reach it)"
        lines.append(f"{one.participant:<16}{one.trials:>8}{found:>12}{interval:>22}{spread:>10}  {condition}{unsure}")
    return lines


def rating_lines(sessions: Sequence[Session]) -> list[str]:
    """Return the mean and standard deviation of answers that are numbers by condition, over all participants; and d' of
    each participant where there are two answers, of which a factor says the right one."""
    made = sessions[0].experiment
    lines: list[str] = []
    if not made.is_graded and all(answer.isdecimal() for answer in made.choices):
        rated: dict[str, list[float]] = {}
        for session in sessions:
            for trial, answer in zip(session.presented, session.answers, strict=False):
                condition = ", ".join(f"{name} {level}" for name, level in trial.levels.items())
                rated.setdefault(condition, []).append(float(answer.answer))
        lines += ["", f"{'answers':>8}{'mean':>9}{'SD':>9}  condition"]
        for condition, all_rated in sorted(rated.items()):
            spread = f"{statistics.stdev(all_rated):.3f}" if len(all_rated) > 1 else "-"
            lines.append(f"{len(all_rated):>8}{statistics.fmean(all_rated):>9.3f}{spread:>9}  {condition}")
    if made.correct and len(made.answers) == 2:
        lines += ["", *[f"{one.participant}: d' {sensitivity(one):.2f}" for one in sessions]]
    return lines


def sensitivity(session: Session) -> float:
    """Return d' of a session with two answers, of which a factor says the right one."""
    first = next(iter(session.experiment.answers))
    given = {True: [0, 0], False: [0, 0]}
    for trial, answer in zip(session.presented, session.answers, strict=False):
        count = given[trial.correct == first]
        count[0] += answer.answer == first
        count[1] += 1
    return d_prime((given[True][0], given[True][1]), (given[False][0], given[False][1]))


def _curve(session: Session, condition: Levels, track: LevelTrack) -> ConditionCurve:
    made = session.experiment
    guess_frac = 1.0 / len(made.choices) if made.is_graded else 0.0
    falls = None if made.adaptive is None else made.adaptive.harder == "higher"
    curve = fit(track, guess_frac, falls=falls)
    found = None if curve is None else (curve.threshold, curve.threshold_interval)
    turned: list[float] = []
    if isinstance(made.adaptive, QuestPlus):
        found = threshold(made.adaptive, track, guess_frac)
    elif isinstance(made.adaptive, Staircase):
        turned = reversals(track)[FIRST_REVERSALS:]
    return ConditionCurve(
        participant=session.participant,
        condition=condition,
        trials=len(track),
        threshold=None if found is None else found[0],
        interval=None if found is None else found[1],
        method="quest+" if isinstance(made.adaptive, QuestPlus) else "fit",
        curve=curve,
        reversals_mean=statistics.fmean(turned) if turned else None,
    )


def _tracks(session: Session) -> list[tuple[Levels, LevelTrack]]:
    """Return levels and whether the answers were right (or, ungraded, the first one was given) by condition."""
    made = session.experiment
    found: dict[tuple[Any, ...], tuple[Levels, list[tuple[float, bool]]]] = {}
    for trial, answer in zip(session.presented, session.answers, strict=False):
        condition = {name: level for name, level in trial.levels.items() if name not in _averaged(made)}
        right = trial.correct or next(iter(made.choices))
        key = tuple(condition.items())
        found.setdefault(key, (condition, []))[1].append((float(trial.levels[made.abscissa]), answer.answer == right))
    return [(condition, tuple(track)) for condition, track in found.values()]


def _averaged(made: Experiment) -> tuple[str, str]:
    """Return the factors that do not make a condition: the abscissa, and the one that says the right answer."""
    return made.abscissa, made.correct
