"""How many digits of the modes are right, and what becomes of positions that no finger has.

The references are in 40 digits: Ritz's problem from integrals in exact fractions, its eigenpair refined by Newton's
steps; Legendre products by mpmath's own; the spline by truncated powers, a basis too ill conditioned for anything less.
"""

from __future__ import annotations

import math
import warnings
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

from ..core.plate.contact_gram import ContactGram, disc_gram
from ..core.plate.mode_shapes import ModeShapes
from ..design import ModeShape, free_plate_modes
from ..sim.plate.ground_truth import DRIVEN_MODES
from .timing import optional

FloatArray = npt.NDArray[np.float64]
Exact = npt.NDArray[np.object_]
Rows = list[tuple[str, dict[str, float]]]

_DIGITS = 40
_POISSON = 0.22  # of the reference plate, as `free_plate_modes` has it
_MORE_TERMS = 10  # what another ten degrees would change
_NEWTON_STEPS = 8  # each wins six digits or more
_KNOTS = 13
_HOSTILE = (
    0.0,
    -0.0,
    5e-324,
    1e-300,
    68.75,
    -68.75,
    math.nextafter(68.75, 99.0),
    70.0,
    -1e3,
    1e17,
    1e300,
    math.inf,
    -math.inf,
    math.nan,
)


def rows(*, points: int = 200, seed: int = 1) -> Rows:
    """(name, figures) of each comparison; those with mpmath are left out where it is not installed."""
    random = np.random.default_rng(seed)
    found = [_hostile_points(), _contact_digits()]
    mpmath = optional("mpmath")
    if mpmath is None:
        return found
    with mpmath.workdps(_DIGITS):
        frequency_hz, shape = next(mode for mode in free_plate_modes() if mode[1].name == DRIVEN_MODES[0])
        found += [
            ("modes: Ritz, rounding", _ritz_digits(mpmath, frequency_hz, shape, 0)),
            ("modes: Ritz, ten more terms", _ritz_digits(mpmath, frequency_hz, shape, _MORE_TERMS)),
            ("modes: sums of Legendre products", _legendre_digits(mpmath, shape, random, points)),
            ("modes: bicubic at", _spline_digits(mpmath, random, points)),
        ]
    return found


def _digits(error: Any, scale: Any) -> float:
    """Correct decimal digits of numbers of size `scale` that err by `error` at most; 17 where nothing shows."""
    share = abs(float(error / scale))
    return 17.0 if share < 1e-17 else max(-math.log10(share), 0.0)


# --- positions that no finger has ---


def _hostile_points() -> tuple[str, dict[str, float]]:
    """At the edge, outside, not a number, huge, tiny: every way to read a map is finite, silent, and says the same."""
    axis_mm = np.linspace(-68.75, 68.75, 101)
    x, y = np.meshgrid(axis_mm, axis_mm)
    modes = ModeShapes.from_grid(axis_mm, axis_mm, np.stack((np.cos(0.24 * x), np.cos(0.24 * y))))
    contact = ContactGram(modes, 5.0)
    places = np.array([(x_mm, y_mm) for x_mm in _HOSTILE for y_mm in _HOSTILE])
    not_finite = disagree = loud = 0
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        # More points than the scalar path takes: the arrays' own arithmetic.
        values, slopes = modes.evaluate(places), modes.gradient(places)
        grams = contact.evaluate(places)
        for value, slope, gram, (x_mm, y_mm) in zip(values, slopes, grams, places.tolist(), strict=True):
            one = np.array(modes.at_with_gradient(x_mm, y_mm))
            not_finite += not (np.isfinite(one).all() and np.isfinite(gram).all())
            disagree += not (
                np.array_equal(one[:, 0], value)
                and np.array_equal(one[:, 1:], slope)
                and np.array_equal(modes.at(x_mm, y_mm), value)
            )
            loud += (math.isnan(x_mm) or math.isnan(y_mm)) and bool(one.any())
    figures: dict[str, float] = {
        "points_count": len(places),
        "not_finite_count": not_finite,
        "disagreements_count": disagree,
        "unknown_not_silent_count": loud,
        "warnings_count": len(heard),
    }
    return "modes: edge, outside, NaN, huge", figures


def _contact_digits() -> tuple[str, dict[str, float]]:
    """The mean of x^2 over a disc, half a disc and a quarter of one, whose values geometry knows."""
    axis_mm = np.linspace(-10.0, 10.0, 9)
    x, _ = np.meshgrid(axis_mm, axis_mm)
    modes = ModeShapes.from_grid(axis_mm, axis_mm, np.stack((np.ones_like(x), 10.0 - x)))
    radius_mm = 5.0
    known = {(0.0, 0.0): 100.0 + radius_mm**2 / 4.0, (10.0, 0.0): radius_mm**2 / 4.0, (10.0, -10.0): radius_mm**2 / 4.0}
    found = disc_gram(modes, list(known), radius_mm)[:, 1, 1]
    errors = [abs(got - value) / value for got, value in zip(found, known.values(), strict=True)]
    return "modes: contact discs", {"correct_digits_count": _digits(max(errors), 1.0)}


# --- Ritz ---


def _ritz_digits(mpmath: Any, frequency_hz: float, shape: ModeShape, more: int) -> dict[str, float]:
    """Of the frequency and the shape's coefficients, against Ritz's problem with `more` degrees along each axis."""
    eigenvalue, vector = _ritz_reference(mpmath, shape, more)
    size_mm, speed = mpmath.mpf(shape.size_mm[0]), _wave_speed(mpmath)
    true_hz = mpmath.sqrt(eigenvalue) * speed * (2000 / size_mm) ** 2 / (2 * mpmath.pi)
    padded = _padded(shape.coefficients, more)
    padded = padded / math.sqrt(float((padded**2).sum()))
    error = np.abs(vector - padded).max()
    return {
        "frequency_digits_count": _digits(frequency_hz - true_hz, true_hz),
        "shape_digits_count": _digits(error, np.abs(vector).max()),
    }


def _wave_speed(mpmath: Any) -> Any:
    """omega / k^2 of the reference plate in m^2/s."""
    young_pa, thickness_m = mpmath.mpf(72500000000), mpmath.mpf(2) / 1000
    stiffness_nm = young_pa * thickness_m**3 / (12 * (1 - mpmath.mpf(_POISSON) ** 2))
    return mpmath.sqrt(stiffness_nm / (2500 * thickness_m))


def _ritz_reference(mpmath: Any, shape: ModeShape, more: int) -> tuple[Any, Exact]:
    """(k a / 2)^4 and the unit coefficients of the mode near `shape` on a square plate, in a basis of `more` degrees.

    Newton's steps on K v = k v, |v| = 1: residuals in full precision, corrections in double.
    """
    start = _padded(shape.coefficients, more)
    degree = len(start) - 1
    kept = [np.arange(parity, degree + 1, 2) for parity in (1, 0)]  # X is odd along x and even along y
    orders = ((2, 2), (1, 1), (0, 2))
    parts = [[_overlap(mpmath, degree, *order)[np.ix_(mine, mine)] for order in orders] for mine in kept]
    poisson = mpmath.mpf(_POISSON)
    v = start[np.ix_(*kept)] + mpmath.mpf(0)
    v = v / mpmath.sqrt((v * v).sum())
    eigenvalue = (v * _stiff(parts, v, poisson)).sum()
    for _ in range(_NEWTON_STEPS):
        residual = _stiff(parts, v, poisson) - eigenvalue * v
        right = np.append(-residual.ravel(), (1 - (v * v).sum()) / 2).astype(np.float64)
        step = np.linalg.solve(_bordered(parts, v, eigenvalue), right)
        v, eigenvalue = v + step[:-1].reshape(v.shape), eigenvalue + step[-1]
    vector = np.zeros_like(start, object)
    vector[np.ix_(*kept)] = v
    return eigenvalue, vector


def _stiff(parts: Any, v: Exact, poisson: Any) -> Any:
    """Stiffness times the coefficients v (nx, ny)."""
    (bend_x, twist_x, cross_x), (bend_y, twist_y, cross_y) = parts
    mixed = cross_x @ v @ cross_y + cross_x.T @ v @ cross_y.T
    return bend_x @ v + v @ bend_y + poisson * mixed + 2 * (1 - poisson) * (twist_x @ v @ twist_y)


def _bordered(parts: Any, v: Exact, eigenvalue: Any) -> FloatArray:
    """The Jacobian of Newton's steps, in double."""
    (bend_x, twist_x, cross_x), (bend_y, twist_y, cross_y) = ([p.astype(np.float64) for p in part] for part in parts)
    matrix = np.kron(bend_x, np.eye(len(bend_y))) + np.kron(np.eye(len(bend_x)), bend_y)
    matrix += _POISSON * (np.kron(cross_x, cross_y.T) + np.kron(cross_x.T, cross_y))
    matrix += 2.0 * (1.0 - _POISSON) * np.kron(twist_x, twist_y) - float(eigenvalue) * np.eye(v.size)
    border = v.astype(np.float64).reshape(-1, 1)
    result: FloatArray = np.block([[matrix, -border], [border.T, np.zeros((1, 1))]])
    return result


def _overlap(mpmath: Any, degree: int, left: int, right: int) -> Exact:
    """Integrals of products of derivatives of orthonormal Legendre polynomials, from exact fractions."""
    k, n = np.indices((degree + 1, degree + 1))
    derivative = np.where((k < n) & ((n - k) % 2 == 1), 2 * k + 1, 0).astype(object)
    weights = np.array([Fraction(2, 2 * j + 1) for j in range(degree + 1)], object)
    plain = np.linalg.matrix_power(derivative, left).T @ (weights[:, None] * np.linalg.matrix_power(derivative, right))
    norm = [mpmath.sqrt(mpmath.mpf(2 * j + 1) / 2) for j in range(degree + 1)]
    exact = [[mpmath.mpf(f.numerator) / f.denominator for f in map(Fraction, row)] for row in plain]
    return np.array(exact, object) * np.outer(norm, norm)


def _padded(coefficients: FloatArray, more: int) -> FloatArray:
    return np.pad(coefficients, (0, more))


# --- evaluation ---


def _legendre_digits(mpmath: Any, shape: ModeShape, random: np.random.Generator, points: int) -> dict[str, float]:
    """Of the sum that a `ModeShape` is, at random points, against the peak of 1."""
    places = random.uniform(-68.75, 68.75, (min(points, 25), 2))
    errors = []
    for (x_mm, y_mm), found in zip(places.tolist(), shape.evaluate(places).tolist(), strict=True):
        along_x, along_y = (_orthonormal(mpmath, x, len(shape.coefficients)) for x in (x_mm, y_mm))
        errors.append(abs(found - along_x @ shape.coefficients @ along_y))
    return {"correct_digits_count": _digits(max(errors), 1.0)}


def _orthonormal(mpmath: Any, position_mm: float, terms: int) -> Exact:
    s = mpmath.mpf(position_mm) * 2 / mpmath.mpf(137.5)
    return np.array([mpmath.legendre(n, s) * mpmath.sqrt(mpmath.mpf(2 * n + 1) / 2) for n in range(terms)], object)


def _spline_digits(mpmath: Any, random: np.random.Generator, points: int) -> dict[str, float]:
    """Of value and slope on an uneven grid, against the same not-a-knot spline, relative to the largest."""
    knots_mm = np.cumsum(random.uniform(1.0, 3.0, _KNOTS))
    values = random.standard_normal((1, _KNOTS, _KNOTS))
    modes = ModeShapes.from_grid(knots_mm, knots_mm, values)
    collocation = mpmath.matrix([[*_powers(mpmath, knots_mm, t)[0]] for t in knots_mm.tolist()])
    weights = np.array((collocation**-1).tolist(), object)
    true, found = [], []
    for x_mm, y_mm in random.uniform(knots_mm[0], knots_mm[-1], (points, 2)).tolist():
        (x, x_slope), (y, y_slope) = (_powers(mpmath, knots_mm, t) @ weights for t in (x_mm, y_mm))
        true.append([y @ values[0] @ x, y @ values[0] @ x_slope, y_slope @ values[0] @ x])
        found.append(modes.at_with_gradient(x_mm, y_mm)[0])
    error, size = (
        np.abs(np.array(true, object) - np.array(found)).max(axis=0),
        np.abs(np.array(true, object)).max(axis=0),
    )
    return {
        "correct_digits_count": _digits(error[0], size[0]),
        "slope_digits_count": min(_digits(error[axis], size[axis]) for axis in (1, 2)),
    }


def _powers(mpmath: Any, knots_mm: FloatArray, at_mm: float) -> Exact:
    """The cubics 1, t, t^2, t^3 and (t - knot)^3 beyond each inner knot but the outer two; and their slopes: (2, n)."""
    t = mpmath.mpf(at_mm)
    beyond = [max(t - mpmath.mpf(knot), mpmath.mpf(0)) for knot in knots_mm[2:-2].tolist()]
    values = [mpmath.mpf(1), t, t**2, t**3, *(b**3 for b in beyond)]
    slopes = [mpmath.mpf(0), mpmath.mpf(1), 2 * t, 3 * t**2, *(3 * b**2 for b in beyond)]
    return np.array([values, slopes], object)
