"""The fingers on the pad: which are down, and where each of them will be.

A report's contacts become fingers (`tracking`), its stamp an instant of the host (`sensor_clock`), and every finger has
a predictor of its own (`prediction`) from its landing until it is lifted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from mypy_extensions import mypyc_attr

from ...values import Finger, FingerFrame, TouchFrame
from ..plate.contact import EllipseForm
from .contact_form import ContactForm, EllipseScale
from .sensor_clock import SensorClock
from .tracking import Tracker

OLD_IN_A_ROW: Final = 3  # a frame out of order comes alone; several in a row: the pad's clock was reset
SILENT_PERIODS: Final = 3.5  # of a slow pad, which may lose two reports in a row: 40 ms at 11.25 ms
LONGEST_SILENCE_NS: Final = 80_000_000  # whatever period was measured
MAX_HORIZON_NS: Final = 50_000_000  # predictors are judged up to here; a knot beyond would be a guess


@mypyc_attr(allow_interpreted_subclasses=True)  # a base class: native calls cost a tenth of a protocol's
class FingerPredictor:
    """Where a finger will be; see `core.prediction.predictor.TouchPredictor`."""

    def update(self, t_ns: int, t_stamp_ns: int, x_mm: float, y_mm: float, period_s: float) -> None:
        """Take a sample: when it was taken, its filtered stamp, its position, the sampler's period."""
        raise NotImplementedError

    def predict(self, t_ns: int) -> tuple[float, float]:
        """Return the position in mm at `t_ns`."""
        raise NotImplementedError

    def covariance(self, t_ns: int) -> tuple[float, float, float]:
        """Return xx, xy, yy in mm^2 of the predicted position's error at `t_ns`."""
        raise NotImplementedError


class Fingers:
    """Tracked fingers with their predictors, from the trackpad's frames."""

    def __init__(
        self,
        make_predictor: Callable[[], FingerPredictor],
        *,
        sensor_latency_ns: int,
        silence_ns: int,
        ellipse_scale: EllipseScale | None = None,
    ) -> None:
        """`sensor_latency_ns`: the pad's own; `silence_ns`: without a report for so long the pad counts as silent, and
        a slow one after SILENT_PERIODS; `ellipse_scale`: that of the pad's ellipses, where they are used.
        """
        self.down: tuple[Finger, ...] = ()
        self.predictors: dict[int, FingerPredictor] = {}  # of those that are down, by finger id
        self.released: set[int] = set()  # of those: held still unless they have a target
        self.t_sample_ns = 0  # when the newest report was sampled, on the host's axis
        self.period_s = 0.0  # from one report to the next, as stamps show it; 0 before the first
        self.make_predictor = make_predictor
        self._ellipse_scale = ellipse_scale
        self._forms: dict[int, ContactForm] = {}  # with `ellipse_scale`, of those that are down
        self._least_silence_ns = self._silence_ns = silence_ns
        self._tracker = Tracker()
        self._sensor_clock = SensorClock(sensor_latency_ns)
        self._t_stamp_ns: int | None = None
        self._t_frame_ns = 0
        self._t_read_ns = 0
        self._old_in_a_row = 0

    @property
    def newest_id(self) -> int:
        """The largest finger id so far; 0 before the first finger."""
        return self._tracker.newest_id

    def touch(self, frame: TouchFrame, t_read_ns: int) -> FingerFrame:
        """Take one report: track its contacts and feed the predictors, on the host's time axis."""
        if frame.t_ns == self._t_stamp_ns:
            return FingerFrame(frame.t_ns, self.down, ())  # a pad whose clock stands still counts as silent
        self._t_stamp_ns = frame.t_ns
        self._t_read_ns = t_read_ns
        self._old_in_a_row = self._old_in_a_row + 1 if frame.t_ns < self._t_frame_ns else 0
        if self._old_in_a_row == OLD_IN_A_ROW:
            self.lift_all()
        t_sample_ns = self._sensor_clock.update(frame.t_ns, t_read_ns)
        tracked = self._tracker.update(frame)
        for finger_id in tracked.lifted:
            self._forget(finger_id)
        if tracked.t_ns != frame.t_ns:
            return tracked  # an old frame holds no news
        self._t_frame_ns = frame.t_ns
        self.t_sample_ns = t_sample_ns
        t_stamp_ns, period_s = self._sensor_clock.t_filtered_ns, self._sensor_clock.period_s
        self.period_s = period_s
        slow_ns = min(round(SILENT_PERIODS * period_s * 1e9), LONGEST_SILENCE_NS)
        self._silence_ns = max(self._least_silence_ns, slow_ns)
        for finger_id, _, x_mm, y_mm, is_new, _, major_mm, minor_mm, angle_rad in tracked.fingers:
            if is_new:
                self.predictors[finger_id] = self.make_predictor()
            self.predictors[finger_id].update(t_sample_ns, t_stamp_ns, x_mm, y_mm, period_s)
            if self._ellipse_scale is not None:
                if is_new:
                    self._forms[finger_id] = ContactForm(self._ellipse_scale)
                self._forms[finger_id].update(major_mm, minor_mm, angle_rad)
        self.down = tracked.fingers
        return tracked

    def lift_all(self) -> None:
        """Lift every finger and reset the clock: the pad is gone or silent."""
        for finger in self.down:
            self._forget(finger.finger_id)
        self.down = ()
        self._tracker.reset()
        self._sensor_clock.reset()
        self._t_frame_ns = self._old_in_a_row = 0

    def are_silent(self, t_now_ns: int) -> bool:
        """Whether fingers are down and no report came for too long."""
        return len(self.down) > 0 and t_now_ns - self._t_read_ns > self._silence_ns

    def release(self, keys: Sequence[int | str]) -> None:
        """Mark those of these fingers that are down as released, until they are lifted."""
        self.released.update(key for key in keys if isinstance(key, int) and key in self.predictors)

    def hold_all(self) -> None:
        """Mark all fingers that are down as released: surfaces decide what they feel, also after the last has ended."""
        if len(self.released) < len(self.predictors):
            self.released.update(self.predictors)

    def predicted_mm(self, finger_id: int, t_ns: int) -> tuple[float, float]:
        """Return where a finger that is down will be at an instant, at most MAX_HORIZON_NS after the newest sample."""
        t_latest_ns = self.t_sample_ns + MAX_HORIZON_NS
        return self.predictors[finger_id].predict(t_ns if t_ns < t_latest_ns else t_latest_ns)

    def variances_mm2(self, keys: Sequence[int | str], t_ns: int) -> list[float]:
        """Return the variance of each predicted place, the mean of both axes; 0 for virtual fingers."""
        variances_mm2 = []
        for key in keys:
            xx_mm2 = yy_mm2 = 0.0
            if isinstance(key, int):
                t_latest_ns = self.t_sample_ns + MAX_HORIZON_NS
                xx_mm2, _, yy_mm2 = self.predictors[key].covariance(t_ns if t_ns < t_latest_ns else t_latest_ns)
            variances_mm2.append(0.5 * (xx_mm2 + yy_mm2))
        return variances_mm2

    def forms(self, keys: Sequence[int | str]) -> list[EllipseForm | None] | None:
        """Return the form of each contact, None where the pad reports none, as for virtual fingers; None for all where
        the pad's ellipses are not used."""
        if self._ellipse_scale is None:
            return None
        return [self._forms[key].form if isinstance(key, int) else None for key in keys]

    def _forget(self, finger_id: int) -> None:
        self.predictors.pop(finger_id, None)
        self._forms.pop(finger_id, None)
        self.released.discard(finger_id)
