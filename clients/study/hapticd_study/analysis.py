"""Statistics of right and wrong answers: success rates, their spread over participants, and tests against guessing.

All tests are two-sided, against the share of a guessing participant: one of the number of answers. scipy computes them.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scipy import stats

from .experiment import CONFIDENCE
from .session import Session


@dataclass(frozen=True, slots=True)
class Result:
    """One participant. `by_answer` counts the trials by the right answer: (recognised, presented). `guess_frac` is the
    share of a guessing participant.

    `interval_frac` is the success rate's exact 95 % confidence interval (Clopper-Pearson), `p` the exact binomial
    test's.
    """

    participant: str
    by_answer: Mapping[str, tuple[int, int]]
    guess_frac: float
    interval_frac: tuple[float, float]
    p: float

    @property
    def correct(self) -> int:
        """Number of recognised trials."""
        return sum(recognised for recognised, _ in self.by_answer.values())

    @property
    def trials(self) -> int:
        """Number of trials."""
        return sum(presented for _, presented in self.by_answer.values())

    @property
    def rate_frac(self) -> float:
        """Success rate."""
        return self.correct / self.trials


@dataclass(frozen=True, slots=True)
class Group:
    """All participants. A test is NaN for fewer than two participants, or equal rates.

    `sd_frac` is the standard deviation of the rates (n - 1). `t`, `t_p`: one-sample t test of the rates.
    `pooled_p` is the exact binomial test's on all trials, as if of one participant.
    """

    guess_frac: float
    mean_frac: float
    sd_frac: float
    t: float
    t_p: float
    correct: int
    trials: int
    pooled_p: float


def analyse(session: Session) -> Result:
    """Analyse a finished session whose answers are right or wrong."""
    counts = {answer: [0, 0] for answer in session.experiment.choices}
    for trial, answer in zip(session.presented, session.answers, strict=True):
        counts[trial.correct][0] += answer.answer == trial.correct
        counts[trial.correct][1] += 1
    return result(session.participant, {answer: (count[0], count[1]) for answer, count in counts.items()})


def result(participant: str, by_answer: Mapping[str, tuple[int, int]]) -> Result:
    """Analyse counts of trials (recognised, presented) by the right answer."""
    recognised, presented = (sum(count[place] for count in by_answer.values()) for place in (0, 1))
    guess_frac = 1.0 / len(by_answer)
    test = stats.binomtest(recognised, presented, guess_frac)
    interval = test.proportion_ci(CONFIDENCE, method="exact")
    return Result(participant, by_answer, guess_frac, (float(interval.low), float(interval.high)), float(test.pvalue))


def analyse_group(results: Sequence[Result]) -> Group:
    """Analyse all participants together, at least one."""
    guess_frac = results[0].guess_frac
    rates = [one.rate_frac for one in results]
    sd_frac = statistics.stdev(rates) if len(rates) > 1 else math.nan
    t, t_p = math.nan, math.nan
    if sd_frac > 0:
        test = stats.ttest_1samp(rates, guess_frac)
        t, t_p = float(test.statistic), float(test.pvalue)
    correct, trials = sum(one.correct for one in results), sum(one.trials for one in results)
    return Group(
        guess_frac=guess_frac,
        mean_frac=statistics.fmean(rates),
        sd_frac=sd_frac,
        t=t,
        t_p=t_p,
        correct=correct,
        trials=trials,
        pooled_p=float(stats.binomtest(correct, trials, guess_frac).pvalue),
    )
