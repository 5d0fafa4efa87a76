"""Single Kalman filters, for comparison: constant velocity, constant acceleration, Singer's, constant jerk.

Each carries its covariance along, so it suits any intervals. Those that are often used are written out on floats.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...core.prediction.gains import FloatArray, process_model, riccati_step, start_covariance
from ...core.prediction.motion import Sample, checked
from .motion import QuadraticMotion


class Covariance(NamedTuple):
    """Upper triangle of the covariance of (position, velocity, acceleration); mm and s."""

    xx: float
    xv: float
    xa: float
    vv: float
    va: float
    aa: float


class KalmanSinger(QuadraticMotion):
    """Acceleration that fades with `manoeuvre_s`, disturbed by white jerk; `damping` is the share extrapolated.

    Source: Singer, IEEE Trans. Aerospace and Electronic Systems 6(4), 1970. The process noise is the white jerk's,
    which Singer's is to within an interval over `manoeuvre_s` (1 %).
    """

    __slots__ = ("_covariance", "_damping", "_full_ax", "_full_ay", "_jerk_density", "_manoeuvre_s", "_noise_mm")

    def __init__(
        self,
        *,
        jerk_density_mm2_s5: float = 2.37e7,
        noise_mm: float = 0.07,
        manoeuvre_s: float = 0.82,
        damping: float = 0.42,
    ) -> None:
        super().__init__()
        self._jerk_density = checked("jerk_density_mm2_s5", jerk_density_mm2_s5, 1.0, 1e12)
        self._noise_mm = checked("noise_mm", noise_mm, 1e-4, 10.0)
        self._manoeuvre_s = checked("manoeuvre_s", manoeuvre_s, 0.01, 1e9)
        self._damping = checked("damping", damping, 0.0, 1.0)

    def start(self, x_mm: float, y_mm: float) -> None:
        xx, vv, aa = np.diag(start_covariance(self._noise_mm, 3)).tolist()
        self._covariance = Covariance(xx, 0.0, 0.0, vv, 0.0, aa)
        self._full_ax = self._full_ay = 0.0
        self._move(x_mm, y_mm, 0.0, 0.0)

    def step(self, sample: Sample) -> None:
        d, _, x_mm, y_mm = sample
        fading = d / self._manoeuvre_s
        kept = math.exp(-fading)
        to_v = -self._manoeuvre_s * math.expm1(-fading)
        to_x = self._manoeuvre_s * (d - to_v) if fading > 1e-3 else 0.5 * d * d * (1.0 - fading / 3.0)
        ahead = _ahead(self._covariance, d, to_x, to_v, kept, self._jerk_density)
        noise_mm2 = self._noise_mm * self._noise_mm
        spread = ahead.xx + noise_mm2
        k_x, k_v, k_a = ahead.xx / spread, ahead.xv / spread, ahead.xa / spread
        self._covariance = _measured(ahead, k_v, k_a, noise_mm2 / spread)

        ax, ay = self._full_ax, self._full_ay
        x = self._x + d * self._vx + to_x * ax
        y = self._y + d * self._vy + to_x * ay
        ex, ey = x_mm - x, y_mm - y
        vx = self._vx + to_v * ax + k_v * ex
        vy = self._vy + to_v * ay + k_v * ey
        self._full_ax, self._full_ay = kept * ax + k_a * ex, kept * ay + k_a * ey
        damping = self._damping
        self._move(x + k_x * ex, y + k_x * ey, vx, vy, damping * self._full_ax, damping * self._full_ay)


class KalmanConstantAcceleration(KalmanSinger):
    """Acceleration that does not fade, all of it extrapolated."""

    __slots__ = ()

    def __init__(self, *, jerk_density_mm2_s5: float = 1.56e7, noise_mm: float = 0.07) -> None:
        super().__init__(jerk_density_mm2_s5=jerk_density_mm2_s5, noise_mm=noise_mm, manoeuvre_s=1e9, damping=1.0)


class KalmanConstantVelocity(QuadraticMotion):
    """Velocity disturbed by white acceleration."""

    __slots__ = ("_acceleration_density", "_covariance", "_noise_mm")

    def __init__(self, *, acceleration_density_mm2_s3: float = 2.5e4, noise_mm: float = 0.07) -> None:
        super().__init__()
        self._acceleration_density = checked("acceleration_density_mm2_s3", acceleration_density_mm2_s3, 1e-3, 1e12)
        self._noise_mm = checked("noise_mm", noise_mm, 1e-4, 10.0)

    def start(self, x_mm: float, y_mm: float) -> None:
        xx, vv = np.diag(start_covariance(self._noise_mm, 2)).tolist()
        self._covariance = xx, 0.0, vv
        self._move(x_mm, y_mm, 0.0, 0.0)

    def step(self, sample: Sample) -> None:
        d, _, x_mm, y_mm = sample
        q = self._acceleration_density * d
        xx, xv, vv = self._covariance
        xx += d * (2.0 * xv + d * (vv + q / 3.0))
        xv += d * (vv + q / 2.0)
        vv += q
        noise_mm2 = self._noise_mm * self._noise_mm
        spread = xx + noise_mm2
        k_x, k_v, left = xx / spread, xv / spread, noise_mm2 / spread
        self._covariance = left * xx, left * xv, vv - k_v * xv
        x, y = self._x + d * self._vx, self._y + d * self._vy
        ex, ey = x_mm - x, y_mm - y
        self._move(x + k_x * ex, y + k_x * ey, self._vx + k_v * ex, self._vy + k_v * ey)


class KalmanConstantJerk(QuadraticMotion):
    """Jerk disturbed by white snap, in numpy's matrices; the share `damping` of the acceleration is extrapolated."""

    __slots__ = ("_covariance", "_damping", "_noise_mm", "_snap_density", "_state")

    def __init__(self, *, snap_density_mm2_s7: float = 3e9, noise_mm: float = 0.07, damping: float = 0.4) -> None:
        super().__init__()
        self._snap_density = checked("snap_density_mm2_s7", snap_density_mm2_s7, 1.0, 1e14)
        self._noise_mm = checked("noise_mm", noise_mm, 1e-4, 10.0)
        self._damping = checked("damping", damping, 0.0, 1.0)

    def start(self, x_mm: float, y_mm: float) -> None:
        self._covariance = start_covariance(self._noise_mm, 4)
        self._state: FloatArray = np.zeros((4, 2))
        self._state[0] = x_mm, y_mm
        self._move(x_mm, y_mm, 0.0, 0.0)

    def step(self, sample: Sample) -> None:
        transition, process = process_model(sample.interval_s, self._snap_density, 4)
        self._covariance, gain, _ = riccati_step(self._covariance, transition, process, self._noise_mm**2)
        ahead = transition @ self._state
        self._state = ahead + gain[:, None] * ((sample.x_mm, sample.y_mm) - ahead[0])
        (x, y), (vx, vy), (ax, ay), _ = self._state.tolist()
        self._move(x, y, vx, vy, self._damping * ax, self._damping * ay)


def _ahead(p: Covariance, d: float, to_x: float, to_v: float, kept: float, jerk_density: float) -> Covariance:
    """F P F' + Q with F = (1 d to_x; 0 1 to_v; 0 0 kept)."""
    q = jerk_density * d
    x_a = p.xa + d * p.va + to_x * p.aa  # covariance of the position ahead with the acceleration now
    v_a = p.va + to_v * p.aa
    return Covariance(
        xx=p.xx + d * (2.0 * p.xv + d * p.vv) + to_x * (p.xa + d * p.va + x_a) + q * d**4 / 20.0,
        xv=p.xv + d * p.vv + to_x * p.va + to_v * x_a + q * d**3 / 8.0,
        xa=kept * x_a + q * d * d / 6.0,
        vv=p.vv + to_v * (p.va + v_a) + q * d * d / 3.0,
        va=kept * v_a + q * d / 2.0,
        aa=kept * kept * p.aa + q,
    )


def _measured(p: Covariance, k_v: float, k_a: float, left: float) -> Covariance:
    """After one position; `left` is 1 - k_x without its cancellation when the sample is trusted."""
    return Covariance(left * p.xx, left * p.xv, left * p.xa, p.vv - k_v * p.xv, p.va - k_v * p.xa, p.aa - k_a * p.xa)
