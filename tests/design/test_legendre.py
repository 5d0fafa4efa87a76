"""The basis against NumPy's series, whose derivatives are recurrences of their own."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Legendre

from hapticd.design import legendre


@pytest.mark.parametrize("order", [0, 1, 2, 4])
def test_values_and_derivatives_are_exact_to_rounding(order: int) -> None:
    s = np.array([-1.0, -0.93, 0.1, 1.0])
    exact = np.stack([np.sqrt(n + 0.5) * Legendre.basis(n).deriv(order)(s) for n in range(35)], axis=1)
    for found, wanted in zip(legendre.values(s, 34, order), exact, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-13 * np.abs(wanted).max())
