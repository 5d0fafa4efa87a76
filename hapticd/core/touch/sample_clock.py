"""When a sample was really taken: a causal filter over the stamps of a regular sampler.

A trackpad samples its glass on a regular clock, but its stamps are rounded to a millisecond or come with the bus's
jitter. Half a millisecond is 0.17 mm at 30 cm/s, more than the sensor's own noise, so the stamps are filtered before
any motion is estimated: a two-state Kalman filter on (sampling time, period), with a whole number of periods between
samples. Source: the Kalman filter of a clock with phase and frequency (Kalman 1960; the standard phase-lock model);
the slot rule is explained at `_EARLY_FRAC`.

Only differences enter and leave, so nothing here depends on where time starts.
"""

from __future__ import annotations

import math
from typing import Final

_PHASE_WALK_VAR_S2: Final = 20e-6**2  # how far the true sampling instant strays in one period
_PERIOD_WALK_VAR_S2: Final = 0.1e-6**2  # how far the period itself strays in one period

# A gap of m periods is read as floor(gap/period + 0.35), not rounded: real stamps have lone outliers of +4 ms, and
# rounding takes such a late stamp for a lost frame, then loses the lock on the next one.
_EARLY_FRAC: Final = 0.35

_RELOCK_FRAC: Final = 0.6  # of a period: a stamp this far off belongs to a new train of samples
SHORTEST_PERIODS: Final = 0.4  # the least interval, so that no speed is made of a burst of reports
GAP_PERIODS: Final = 5.5  # five lost samples: what comes after is a new train
_LEAST_ERRORS: Final = 2  # over so many stamps their jitter is averaged at first,
_MOST_ERRORS: Final = 32  # and over so many later
_RELOCKS_TO_RETUNE: Final = 3  # in a row: then the nominal period is wrong, and the last interval is a better one


class SampleClock:
    """Sampling times from stamps. `period_s` is the estimated period, `lag_s` = last stamp - its sampling time.

    All arguments in seconds: the expected period, the standard errors of that expectation and of one stamp. Stamps that
    jitter by more are measured and trusted less. With a `stamp_error_s` of 0 every stamp is taken as it is.
    """

    __slots__ = (
        *("_cross", "_error_s", "_errors", "_least_stamp_var", "_period_error", "_period_var", "_phase_var"),
        *("_relock_span_s", "_relocks", "_seen_stamp_var", "_stamp_var", "_t_stamp_ns", "lag_s", "period_s"),
    )

    def __init__(self, period_s: float, period_error_s: float, stamp_error_s: float) -> None:
        self._t_stamp_ns: int | None = None
        self._stamp_var = self._seen_stamp_var = self._least_stamp_var = stamp_error_s * stamp_error_s
        self._period_error = period_error_s / period_s
        self._errors = _LEAST_ERRORS
        self._tune(period_s)
        self.restart()

    def _tune(self, period_s: float) -> None:
        self.period_s = period_s
        self._period_var = (self._period_error * period_s) ** 2

    def filtered_ns(self, t_stamp_ns: int) -> int:
        """Return when the sample stamped `t_stamp_ns` was taken, on the stamps' own axis; stamps in order.

        Before the first stamp, after a gap of `GAP_PERIODS` and where stamps go back a new train of samples begins:
        its first stamp is taken as it is. A repeated stamp changes nothing.
        """
        elapsed_s = -1.0 if self._t_stamp_ns is None else (t_stamp_ns - self._t_stamp_ns) * 1e-9
        if not 0.0 <= elapsed_s <= GAP_PERIODS * self.period_s:
            self.restart()
        elif elapsed_s > 0.0:
            self.advance(elapsed_s)
        self._t_stamp_ns = t_stamp_ns
        return t_stamp_ns - round(self.lag_s * 1e9)

    def restart(self) -> None:
        """Begin a train of samples with the next stamp; the estimate of the period stays."""
        self._t_stamp_ns = None
        self._start_train()

    def _start_train(self) -> None:
        self.lag_s = 0.0
        self._phase_var = self._stamp_var
        self._cross = 0.0
        self._relocks = 0
        self._relock_span_s = 0.0
        self._error_s = 0.0

    def advance(self, elapsed_s: float) -> float:
        """Take the next stamp, `elapsed_s` > 0 after the last; return the time between the two samplings, in s."""
        period = self.period_s
        since_sampling = elapsed_s + self.lag_s
        periods = max(1, math.floor(since_sampling / period + _EARLY_FRAC))
        error = since_sampling - periods * period
        if not abs(error) <= _RELOCK_FRAC * period:
            self._relock(elapsed_s)
            return max(since_sampling, SHORTEST_PERIODS * period)
        period_var = self._period_var
        phase_var = self._phase_var + periods * (2.0 * self._cross + periods * period_var) + _PHASE_WALK_VAR_S2
        cross = self._cross + periods * period_var
        spread = phase_var + self._stamp_var
        phase_gain = phase_var / spread
        self._measure_jitter(error, phase_var)
        period_gain = cross / spread
        untrusted = 1.0 - phase_gain

        self._phase_var = untrusted * phase_var
        self._cross = untrusted * cross
        self._period_var = period_var + _PERIOD_WALK_VAR_S2 - period_gain * cross
        self._relocks = 0
        self._relock_span_s = 0.0
        self.lag_s = untrusted * error
        self.period_s = period + period_gain * error
        return max(since_sampling - self.lag_s, SHORTEST_PERIODS * period)

    def _measure_jitter(self, error_s: float, phase_var: float) -> None:
        """From the change between errors, for a period that is still wrong adds the same to each."""
        if self._least_stamp_var == 0.0:
            return
        change_s = error_s - self._error_s
        self._error_s = error_s
        self._errors += self._errors < _MOST_ERRORS
        self._seen_stamp_var += (0.5 * change_s * change_s - phase_var - self._seen_stamp_var) / self._errors
        self._stamp_var = max(self._seen_stamp_var, self._least_stamp_var)

    def _relock(self, elapsed_s: float) -> None:
        """Begin a new train at a stamp that fits no slot. After some in a row, take their mean interval as period."""
        relocks, span_s = self._relocks + 1, self._relock_span_s + elapsed_s
        self._start_train()
        if relocks >= _RELOCKS_TO_RETUNE:
            self._tune(span_s / relocks)
        else:
            self._relocks, self._relock_span_s = relocks, span_s
