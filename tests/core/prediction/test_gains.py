"""The gain tables against 40-digit arithmetic."""

from __future__ import annotations

import mpmath
import pytest

from hapticd.core.prediction.gains import MODELS, kalman_gains

START_VARIANCES = (1e4, 1e5, 1e7)
moving_models = pytest.mark.parametrize(("order", "density"), [model for model in MODELS if model[0] > 1])


def exact_gains(period_s: float, order: int, density: float, noise_mm: float, steps: int) -> list[list[float]]:
    """The matrix Riccati recursion as written in the books, in 40 digits, from the second sample on."""
    n, gains = order, []
    with mpmath.workdps(40):
        t, q, noise = mpmath.mpf(period_s), mpmath.mpf(density), mpmath.mpf(noise_mm) ** 2
        f, process = mpmath.zeros(n, n), mpmath.zeros(n, n)
        for i in range(n):
            for j in range(n):
                power = 2 * n - 1 - i - j
                process[i, j] = q * t**power / (power * mpmath.factorial(n - 1 - i) * mpmath.factorial(n - 1 - j))
                f[i, j] = t ** (j - i) / mpmath.factorial(j - i) if j >= i else 0
        p = mpmath.diag([noise, *START_VARIANCES[: n - 1]])
        for _ in range(steps):
            p = f * p * f.T + process
            spread = p[0, 0] + noise
            k = p[:, 0] / spread
            p = p - k * p[0, :]
            gains.append([*map(float, k), *[0.0] * (4 - n), float(spread)])
    return gains


@moving_models
@pytest.mark.parametrize("period_s", [0.0005, 0.06])
@pytest.mark.parametrize("noise_mm", [1e-4, 10.0])
def test_every_gain_from_the_second_sample_on_is_exact(
    order: int, density: float, period_s: float, noise_mm: float
) -> None:
    exact = exact_gains(period_s, order, density, noise_mm, 40)
    ours = kalman_gains([period_s], [density], noise_mm, order, steps=40)[:, 0, 0].tolist()
    for gain, expected in zip(ours, exact, strict=True):
        assert gain == pytest.approx(expected, rel=1e-9)
