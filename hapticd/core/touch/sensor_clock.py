"""Sampling instants of the trackpad: its stamps in host nanoseconds.

A trackpad samples its glass on a regular clock, but its stamps are rounded to a millisecond, jitter with the bus, come
in batches or, as a finger lands, lie off the sampling grid. Half a millisecond is 0.17 mm at 30 cm/s, more than the
sensor's own noise, so the stamps are filtered before any motion is estimated.

`SlotFilter` estimates the sampling time and the period for one assumed error of the stamps: a Kalman filter of a clock
(Kalman 1960), where how many periods lie between two samples is unknown. Each likely number has a posterior, and their
mixture is replaced by its mean and covariance after every stamp (generalised pseudo-Bayes: Ackerson and Fu 1970). So a
doubtful number leaves a large variance, and the next stamps decide. `SampleClock` runs three, from a clock's rounding
to stamps that are hardly worth anything, and follows the one under which the last stamps were most likely.

`SensorClock` places what it gives on the host's axis. The pad's clock is a slope near 1 and an offset, seen through
delays that can only be late and cannot be measured: what arrives least late is nearest the truth.

Instants are integer nanoseconds and floats only hold differences, so nothing here depends on where time starts.
"""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections import deque
from typing import Final

_PHASE_WALK_VAR_S2: Final = 20e-6**2  # how far the true sampling instant strays in one period
_PERIOD_WALK_VAR_S2: Final = 0.1e-6**2  # how far the period itself strays in one period
_FIRST_PERIODS: Final = 0.3  # standard error of a train's first stamp: touch-downs of phones are up to 0.5 off the grid

_LOST: Final = 0.03  # probability of one more lost sample
_MOST_LOST: Final = 8.0  # more are as improbable as so many
_REPEATED: Final = 0.003  # that there was one slot too many before: it is taken back
_OUTLIER: Final = 1e-5  # likelihood of a stamp that no number of periods explains, relative to one that fits

_WORSE_STAMPS_S: Final = (2e-3, 4.5e-3)  # errors that stamps may have instead of the expected one
_EARLY_SIGMAS: Final = 3.0  # of the stamps' error: so much early a stamp may be, also before the last of a fast pad
_DOUBT: Final = 8.0  # log likelihood that the next of them must gain before it is believed
_FORGET: Final = 1.0 - 1.0 / 64.0  # of a log likelihood, a stamp

SHORTEST_PERIODS: Final = 0.4  # the least interval, so that no speed is made of a burst of reports
GAP_PERIODS: Final = 5.5  # five lost samples: what comes after is a new train
_FASTEST, _SLOWEST = 1.0 / 16.0, 4.0  # period over the expected one


class SlotFilter:
    """The clock of a sampler whose stamps err by `stamp_error_s` (standard error): `lag_s`, `period_s`, and the log
    likelihood of the last stamps."""

    def __init__(self, period_s: float, period_error_s: float, stamp_error_s: float, log_likelihood: float) -> None:
        self.period_s = period_s
        self.log_likelihood = log_likelihood
        self._shortest_s, self._longest_s = _FASTEST * period_s, _SLOWEST * period_s
        self._period_var = period_error_s * period_error_s
        self._stamp_var = stamp_error_s * stamp_error_s
        self.earliest_s = -_EARLY_SIGMAS * stamp_error_s
        self.restart()

    def restart(self) -> None:
        """Begin a train of samples with the last stamp; the estimate of the period stays."""
        self.lag_s = self._cross = 0.0
        self._phase_var = self._stamp_var + (_FIRST_PERIODS * self.period_s) ** 2

    def advance(self, elapsed_s: float) -> None:
        """Take the next stamp, `elapsed_s` after the last."""
        since_s = elapsed_s + self.lag_s
        nearest = float(math.floor(since_s / self.period_s + 0.5))
        periods = nearest - 1.0 if nearest > 1.0 else 0.0
        weights = lag = change = lag_var = cross = period_var = 0.0
        for _ in range(3):
            walks = periods if periods > 1.0 else 1.0
            error = since_s - periods * self.period_s
            before = self._cross + periods * self._period_var  # covariance of phase and period, before the stamp
            phase_var = self._phase_var + periods * (self._cross + before) + walks * _PHASE_WALK_VAR_S2
            spread = phase_var + self._stamp_var
            weight = _prior(periods) * (math.exp(-0.5 * error * error / spread) + _OUTLIER) / math.sqrt(spread)
            untrusted = self._stamp_var / spread
            gain = before / spread
            lag_here, change_here = untrusted * error, gain * error
            weights += weight
            lag += weight * lag_here
            change += weight * change_here
            lag_var += weight * (untrusted * phase_var + lag_here * lag_here)
            cross += weight * (untrusted * before - lag_here * change_here)
            period_var += weight * (self._period_var - gain * before + change_here * change_here)
            periods += 1.0
        self.log_likelihood = _FORGET * self.log_likelihood + math.log(weights)
        self.lag_s = lag = lag / weights
        change /= weights
        phase_var, period_var = lag_var / weights - lag * lag, period_var / weights - change * change
        self._phase_var = phase_var if phase_var > 0.0 else 0.0
        self._cross = cross / weights + lag * change
        self._period_var = (period_var if period_var > 0.0 else 0.0) + _PERIOD_WALK_VAR_S2
        period_s = self.period_s + change
        self.period_s = min(max(period_s, self._shortest_s), self._longest_s)


def _prior(periods: float) -> float:
    """Return how probable it is that so many periods lie between two samples."""
    if periods == 0.0:
        return _REPEATED
    if periods == 1.0:
        return 1.0
    lost = periods - 1.0
    return math.pow(_LOST, lost if lost < _MOST_LOST else _MOST_LOST)


class SampleClock:
    """Sampling times from stamps. `period_s` is the estimated period, `lag_s` = last stamp - its sampling time.

    All arguments in seconds: the expected period, the standard errors of that expectation and of one stamp. Stamps that
    prove worse are trusted less. With a `stamp_error_s` of 0 every stamp is taken as it is.
    """

    def __init__(self, period_s: float, period_error_s: float, stamp_error_s: float) -> None:
        worse_s = [error_s for error_s in _WORSE_STAMPS_S if error_s > stamp_error_s]
        self._filters = [
            SlotFilter(period_s, period_error_s, error_s, -_DOUBT * place)
            for place, error_s in enumerate((stamp_error_s, *worse_s))
        ]
        self._best = self._filters[0]
        self._takes_stamps = stamp_error_s == 0.0
        self._t_stamp_ns: int | None = None

    @property
    def period_s(self) -> float:
        """The sampler's period."""
        return self._best.period_s

    @property
    def lag_s(self) -> float:
        """The last stamp less its sampling time."""
        return 0.0 if self._takes_stamps else self._best.lag_s

    def filtered_ns(self, t_stamp_ns: int) -> int:
        """Return when the sample stamped `t_stamp_ns` was taken, on the stamps' own axis; samples in order.

        Before the first stamp, after a gap of `GAP_PERIODS` and where stamps go back by more than their error a new
        train of samples begins: its first stamp is taken as it is, and trusted little. A stamp that is repeated, though
        its error does not explain that, changes nothing.
        """
        elapsed_s = -math.inf if self._t_stamp_ns is None else (t_stamp_ns - self._t_stamp_ns) * 1e-9
        is_next = elapsed_s > 0.0 or elapsed_s + self.lag_s - self.period_s >= self._best.earliest_s
        if elapsed_s > GAP_PERIODS * self.period_s or (elapsed_s < 0.0 and not is_next):
            self.restart()
        elif is_next:
            self.advance(elapsed_s)
        self._t_stamp_ns = t_stamp_ns
        return t_stamp_ns - round(self.lag_s * 1e9)

    def restart(self) -> None:
        """Begin a train of samples with the next stamp; the estimates of the period stay."""
        self._t_stamp_ns = None
        for each in self._filters:
            each.restart()

    def advance(self, elapsed_s: float) -> float:
        """Take the next stamp, `elapsed_s` > 0 after the last; return the time between the two samplings, in s."""
        since_s = elapsed_s + self.lag_s
        for each in self._filters:
            each.advance(elapsed_s)
            if each.log_likelihood > self._best.log_likelihood or each is self._filters[0]:
                self._best = each
        return max(since_s - self.lag_s, SHORTEST_PERIODS * self.period_s)


_WINDOW: Final = 128
_LOW: Final = 1 / 16
_STAMP_SPREAD_NS: Final = 150_000  # from the low quantile to the median of what the filter leaves of jittered stamps
_MOST_SPREAD_NS: Final = 2_000_000  # a wider one comes from a stalled host, not from the stamps
_MAX_AGE_NS: Final = 10_000_000_000  # drift beyond 200 ppm invalidates older offsets
_MOST_EARLY_NS: Final = 5_000_000  # no jitter makes a report this early: the clock stepped
_MOST_LATE_NS: Final = 250_000_000  # a stalled host makes reports late, but not this late
_LATE_IN_A_ROW: Final = 8  # of more than `_MOST_EARLY_NS`: then it is the clock, not the host
_PERIOD_S: Final = 0.01125  # of a Magic Trackpad 2; other pads are found within some reports
_PERIOD_ERROR_S: Final = 0.0007  # 0.001 locked to a wrong period at stamps off by 3 ms; 0.0005 is slow to find 60 Hz
_STAMP_ERROR_S: Final = 0.0006  # +-1 ms, uniform


class SensorClock:
    """The trackpad's stamps on the host's axis, less the pad's own latency.

    Report i arrives at t_host = t_device + offset + lateness, and its stamp may itself be off by a millisecond. The
    pad samples regularly, so its stamps are filtered first: then only lateness has to be
    separated from the offset, and a low quantile of (t_host - t_device) does, where the minimum would chase the worst
    of what the filter leaves. A low quantile is itself off: too early by what the filter leaves, too late by an eighth
    of the lateness. How wide the differences spread tells which. A window of 128 reports (1.4 s) follows a drift of 200
    ppm 0.15 ms behind.
    """

    def __init__(self, latency_ns: int) -> None:
        self.relocks = 0
        self.t_filtered_ns = 0  # the newest stamp, its jitter filtered out
        self.latency_ns = latency_ns  # it may change, by little at a time
        self._arrivals: deque[tuple[int, int]] = deque()  # of the window's reports: t_host_ns, and that less its stamp
        self._differences: list[int] = []  # these, sorted
        self._t_device_ns = 0
        self._late_in_a_row = 0
        self._learned = 0  # reports since it was locked
        self._samples = SampleClock(_PERIOD_S, _PERIOD_ERROR_S, _STAMP_ERROR_S)

    @property
    def period_s(self) -> float:
        """The pad's sampling period, as its stamps show it."""
        return self._samples.period_s

    def update(self, t_device_ns: int, t_host_ns: int) -> int:
        """Return when the report stamped `t_device_ns`, read at `t_host_ns`, was sampled; never later than it was read.

        `t_filtered_ns` is that instant on the device's own axis.

        A step of the device's clock shows as a stamp that goes back, a report that is early, or lasting lateness;
        the clock then locks to this report.
        """
        difference_ns = t_host_ns - t_device_ns
        self._forget_old(t_host_ns)
        if self._differences and self._has_stepped(t_device_ns, difference_ns):
            self.reset()
            self.relocks += 1
        t_filtered_ns = self.t_filtered_ns = self._samples.filtered_ns(t_device_ns)
        self._t_device_ns = t_device_ns
        if len(self._arrivals) == _WINDOW:
            self._forget_oldest()
        self._arrivals.append((t_host_ns, t_host_ns - t_filtered_ns))
        insort(self._differences, t_host_ns - t_filtered_ns)
        self._forget_learning()
        return min(t_filtered_ns + self.offset_ns, t_host_ns - self.latency_ns)

    @property
    def offset_ns(self) -> int:
        """Sampling instant less stamp; IndexError before the first report."""
        return self._quantile_ns(_LOW) + self._correction_ns() - self.latency_ns

    def _correction_ns(self) -> int:
        """From the low quantile to where a report that is not late would be: the median where stamps alone explain the
        spread; an eighth of the spread before the quantile where lateness does (a seventh of it if that is uniform, a
        tenth if exponential); in between the stamps' share falls as its square."""
        spread_ns = min(self._quantile_ns(0.5) - self._quantile_ns(_LOW), _MOST_SPREAD_NS)
        if spread_ns == 0:
            return 0
        explained_ns = min(spread_ns, _STAMP_SPREAD_NS)
        return (9 * explained_ns * explained_ns - spread_ns * spread_ns) // (8 * spread_ns)

    def reset(self) -> None:
        """Reset: the next report gives the offset."""
        self._samples.restart()
        self._differences.clear()
        self._arrivals.clear()
        self._late_in_a_row = 0
        self._learned = 0

    def _forget_learning(self) -> None:
        """Keep only the later half of a young window: the filter's first estimates err by a stamp's whole jitter, and
        the early ones would be the low quantile for as long as they stay."""
        self._learned += 1
        if self._learned < 2 * _WINDOW and self._learned % 2 == 0 and len(self._arrivals) > 1:
            self._forget_oldest()

    def _forget_old(self, t_host_ns: int) -> None:
        while self._arrivals and not 0 <= t_host_ns - self._arrivals[0][0] <= _MAX_AGE_NS:
            self._forget_oldest()

    def _forget_oldest(self) -> None:
        _, difference_ns = self._arrivals.popleft()
        del self._differences[bisect_left(self._differences, difference_ns)]

    def _quantile_ns(self, share: float) -> int:
        """A lower quantile of the differences; IndexError while there is none."""
        return self._differences[int(share * (len(self._differences) - 1))]

    def _has_stepped(self, t_device_ns: int, difference_ns: int) -> bool:
        late_ns = difference_ns - self._quantile_ns(_LOW)
        is_late = late_ns > _MOST_EARLY_NS
        self._late_in_a_row = self._late_in_a_row + 1 if is_late else 0
        return (
            t_device_ns < self._t_device_ns - _MOST_EARLY_NS
            or not -_MOST_EARLY_NS <= late_ns <= _MOST_LATE_NS
            or self._late_in_a_row >= _LATE_IN_A_ROW
        )
