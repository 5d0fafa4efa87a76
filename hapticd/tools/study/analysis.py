"""Statistics of the answers: success rates, their spread over participants, and tests against guessing.

All tests are two-sided, against the 50 % of a guessing participant. scipy computes them.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ...errors import missing_library
from .protocol import FrictionLevel
from .session import Session

GUESSING_FRAC = 0.5
CONFIDENCE = 0.95
MAX_EXACT = 12  # participants up to which all assignments of signs are enumerated


@dataclass(frozen=True, slots=True)
class Result:
    """One participant. `low` and `high` count the trials of either friction: (recognised, presented).

    `interval_frac` is the success rate's exact 95 % confidence interval (Clopper-Pearson), `p` the exact binomial
    test's.
    """

    participant: str
    low: tuple[int, int]
    high: tuple[int, int]
    interval_frac: tuple[float, float]
    p: float

    @property
    def correct(self) -> int:
        """Number of recognised trials."""
        return self.low[0] + self.high[0]

    @property
    def trials(self) -> int:
        """Number of trials."""
        return self.low[1] + self.high[1]

    @property
    def rate_frac(self) -> float:
        """Success rate."""
        return self.correct / self.trials


@dataclass(frozen=True, slots=True)
class Group:
    """All participants. A test is NaN for fewer than two participants, or equal rates.

    `sd_frac` is the standard deviation of the rates (n - 1). `t`, `t_p`: one-sample t test of the rates. `above` and
    `below` count participants on either side of 50 %, `sign_p` is the exact sign test on them, `wilcoxon_p` the
    signed-rank test, exact up to MAX_EXACT participants, also for tied rates. `pooled_p` is the exact
    binomial test on all trials, as if of one participant.
    """

    mean_frac: float
    sd_frac: float
    t: float
    t_p: float
    above: int
    below: int
    sign_p: float
    wilcoxon_p: float
    correct: int
    trials: int
    pooled_p: float


def analyse(session: Session) -> Result:
    """Analyse a finished session. Raises HapticdError without scipy."""
    counts = {friction: [0, 0] for friction in FrictionLevel}
    for stimulus, answer in zip(session.presented, session.answers, strict=True):
        counts[stimulus][0] += answer.answer is stimulus
        counts[stimulus][1] += 1
    low, high = counts[FrictionLevel.LOW], counts[FrictionLevel.HIGH]
    return result(session.participant, (low[0], low[1]), (high[0], high[1]))


def result(participant: str, low: tuple[int, int], high: tuple[int, int]) -> Result:
    """Analyse counts of trials (recognised, presented)."""
    test = _stats().binomtest(low[0] + high[0], low[1] + high[1], GUESSING_FRAC)
    interval = test.proportion_ci(CONFIDENCE, method="exact")
    return Result(participant, low, high, (float(interval.low), float(interval.high)), float(test.pvalue))


def analyse_group(results: Sequence[Result]) -> Group:
    """Analyse all participants together, at least one. Raises HapticdError without scipy."""
    stats = _stats()
    rates = [one.rate_frac for one in results]
    sd_frac = statistics.stdev(rates) if len(rates) > 1 else math.nan
    t, t_p = math.nan, math.nan
    if sd_frac > 0:
        test = stats.ttest_1samp(rates, GUESSING_FRAC)
        t, t_p = float(test.statistic), float(test.pvalue)
    # In half trials, so that equal distances from 50 % are equal to the last bit.
    above = sum(2 * one.correct > one.trials for one in results)
    below = sum(2 * one.correct < one.trials for one in results)
    correct, trials = sum(one.correct for one in results), sum(one.trials for one in results)
    return Group(
        mean_frac=statistics.fmean(rates),
        sd_frac=sd_frac,
        t=t,
        t_p=t_p,
        above=above,
        below=below,
        sign_p=float(stats.binomtest(above, above + below).pvalue) if above + below > 0 else math.nan,
        wilcoxon_p=_wilcoxon(stats, results),
        correct=correct,
        trials=trials,
        pooled_p=float(stats.binomtest(correct, trials, GUESSING_FRAC).pvalue),
    )


def _wilcoxon(stats: Any, results: Sequence[Result]) -> float:
    """Return p of the signed ranks of the rates' distances from 50 %; those at 50 % are left out."""
    away = [round(one.rate_frac - GUESSING_FRAC, 12) for one in results if 2 * one.correct != one.trials]
    if len(away) < 2:
        return math.nan
    method = stats.PermutationMethod(n_resamples=math.inf) if len(away) <= MAX_EXACT else "asymptotic"
    return float(stats.wilcoxon(away, method=method).pvalue)


def _stats() -> Any:
    try:
        from scipy import stats
    except ImportError:
        raise missing_library("A report needs scipy", "study") from None
    return stats
