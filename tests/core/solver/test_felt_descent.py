"""The descent in C: against the same iteration on arrays, and what is no problem is refused."""

from __future__ import annotations

import math
from array import array
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.core.friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from hapticd.core.solver import felt_descent
from hapticd.core.solver.instant import finger_table
from hapticd.values import WEBER_FRAC

Array = npt.NDArray[np.float64]
CURVES = (DEFAULT_FRICTION_CURVE, FrictionCurve.from_amplitudes((0.0, 0.1, 0.3, 0.8, 1.4), 0.12))


def problem(seed: int) -> list[Any]:
    """The arguments of a call, for a random problem of up to 6 fingers on up to 8 modes."""
    random = np.random.default_rng(seed)
    fingers, modes, points = int(random.integers(1, 7)), int(random.integers(1, 9)), int(random.integers(2, 13))
    scale = float(random.choice([1.0, 1.0, 1.0, 0.0, 1e-200, 1e120, np.nan]))
    curve = CURVES[seed % 2]
    gains, logs = random.choice([1.0, 1.6], fingers).tolist(), random.normal(size=fingers).tolist()
    targets_um = [curve.amplitude_um(friction) for friction in random.choice([1.0, 0.9, 0.8, 0.5, 0.2, 0.0], fingers)]
    return [
        (scale * random.uniform(-1, 1, (fingers * points, modes))).tobytes(),
        np.full(points, 1.0 / points),
        finger_table(curve, targets_um, logs, gains, random.integers(0, 4, fingers).tolist()),
        curve.table,
        10.0 ** random.uniform(-3, 1, modes),
        tuple(random.normal(size=modes) + 1j * random.normal(size=modes)),
        int(random.integers(0, 5)),
        (math.inf,),
        float(random.choice([0.0, 0.03])),
        float(random.choice([0.1, 0.5])),
    ]


def iterated(given: list[Any]) -> tuple[Array, Array]:
    """One problem after its iterations, on arrays: W (M,), and the weights."""
    limits, now, c = given[4], np.array(given[5]), given[1]
    (full_um, least), (starts, origins, rates) = given[3][:2], given[3][2:].reshape(3, -1)
    targets_um, target, counted, sticky, gains, logs, _, _ = np.reshape(given[2], (8, -1))
    if given[6] > 0 and not targets_um.any():
        return 0.0 * now, logs
    phi = np.frombuffer(given[0]).reshape(len(target), len(c), len(now))
    for _ in range(given[6]):
        w = phi @ now
        r = np.sqrt(np.abs(w) ** 2 + given[8] ** 2 * (phi**2 @ np.abs(now) ** 2))
        at = r / gains[:, None]
        piece = np.maximum(np.searchsorted(starts, at, side="right") - 1, 0)
        friction = np.where(at < full_um, np.exp((origins[piece] - at) * rates[piece]), least)
        rate, got = rates[piece] / gains[:, None], friction @ c
        size = np.abs(got / target - 1.0) / WEBER_FRAC
        error = np.log(np.clip(size * (1.0 - sticky * np.maximum(1.0 - size, 0.0)), 0.3, counted))
        logs = np.clip(logs - logs.mean() + 0.3 * (error - error.mean()), -4.6, 4.6)
        slope = (np.exp(logs) / (WEBER_FRAC * target))[:, None] * c * friction * rate
        along = (1.0 - sticky)[:, None] * slope * rate
        kappa = sticky[:, None] * slope / np.sqrt(r * r + 0.2**2) + along
        outwards = np.clip((got - target) / got, -1.5, 1.0)
        even = (given[9] / (1.0 + size**2))[:, None] * ((r @ c)[:, None] - r)
        aim = np.maximum(r + even + outwards[:, None] / rate, 0.0)
        pulled = along * aim / np.maximum(np.abs(w), 1e-9)
        curvature = np.einsum("nq,nqk,nql->kl", kappa, phi, phi)
        pull = np.einsum("nq,nqk->k", pulled * w, phi)
        stay, before = 0.03 * np.trace(curvature) / len(now), now.copy()
        for k in list(range(len(now))) * 4:
            own = (1.0 + given[8] ** 2) * curvature[k, k] + stay
            rest = pull[k] + stay * before[k] - curvature[k] @ now + curvature[k, k] * now[k]
            now[k] = 1.1 * rest / own - 0.1 * now[k] if own > 0.0 else 0.0
            now[k] *= min(1.0, limits[k] / max(abs(now[k]), 1e-300))
    return now, logs


def test_the_descent_is_the_iteration_on_arrays() -> None:
    compared = 0
    for seed in range(200):
        given = problem(seed)
        if not 1e-3 < np.abs(np.frombuffer(given[0])).max() < 1e3:
            continue
        modal_um, logs = iterated(given)
        ((found_um, _),) = felt_descent.descend(*given)
        assert found_um == pytest.approx(modal_um, rel=1e-6, abs=1e-9), seed
        assert np.reshape(given[2], (8, -1))[5] == pytest.approx(logs, rel=1e-6, abs=1e-9), seed
        compared += 1
    assert compared > 50


def test_instants_of_one_call_are_those_of_calls_that_follow_each_other() -> None:
    for seed in range(50):
        first, second = problem(seed), problem(seed)
        second[0] = np.roll(np.frombuffer(first[0]), 1).tobytes()
        both = [first[0] + second[0], first[1], first[2] + second[2], *first[3:7], (0.4, 0.3), *first[8:]]
        found = felt_descent.descend(*both)
        for given, most_step_um in ((first, 0.4), (second, 0.3)):
            given[7] = (most_step_um,)
            ((modal_um, limited),) = felt_descent.descend(*given)
            assert repr(found.pop(0)) == repr((modal_um, limited))
            second[5], size = modal_um, len(given[2]) // 8
            second[2][5 * size : 6 * size] = given[2][5 * size : 6 * size]
        assert repr(both[2]) == repr(first[2] + second[2])


def test_at_any_scale_amplitudes_are_finite_and_within_the_limits() -> None:
    for seed in range(300):
        given = problem(seed)
        ((found_um, _),) = felt_descent.descend(*given)
        if given[6] > 0 and not np.isnan(np.frombuffer(given[0])).any():
            assert np.all(np.abs(found_um) <= given[4]), seed


def test_no_mode_moves_by_more_than_the_most_and_without_iterations_none_moves() -> None:
    for seed in range(100):
        given = problem(seed)
        given[6], given[7] = 0, (0.3,)
        assert felt_descent.descend(*given)[0][0] == given[5]
        given[6] = 4
        steps_um = np.abs(np.subtract(felt_descent.descend(*given)[0][0], given[5]))
        assert not any(given[2][: len(given[2]) // 8]) or np.isnan(steps_um).any() or steps_um.max() <= 0.3 + 1e-12


@pytest.mark.parametrize("still", [1, 2, 3])
def test_still_points_get_nothing_and_the_limits_hold_whatever_the_others_get(still: int) -> None:
    for seed in range(100):
        random = np.random.default_rng(seed)
        phi, limits_um = random.uniform(-1.0, 1.0, (still + 2, 4)), np.array([4.0, 3.0, 2.0, 1.0])
        targets_um, modal_um = [0.0] * still + [1.0] * 2, tuple(random.normal(size=4) + 1j * random.normal(size=4))
        fingers = array("d", targets_um + [1.0] * (7 * len(phi)))
        curve, one = DEFAULT_FRICTION_CURVE.table, np.ones(1)
        given = phi.tobytes(), one, fingers, curve, limits_um, modal_um, 60, (math.inf,)
        ((modal_um, _),) = felt_descent.descend(*given)
        got = np.abs(phi @ modal_um)
        assert got[:still].max() < 1e-14
        assert np.all(np.abs(modal_um) <= limits_um)
        assert got[still:].max() > 0.01


@pytest.mark.parametrize("place", range(6))
def test_arrays_whose_lengths_do_not_fit_are_refused(place: int) -> None:
    given = next(one for one in map(problem, range(99)) if len(one[4]) > 1 and len(one[2]) > 8)
    felt_descent.descend(*given)
    given[place] = (1j,) if place == 5 else np.array(np.frombuffer(given[place])[: 4 if place == 3 else -3])
    with pytest.raises(ValueError, match="lengths"):
        felt_descent.descend(*given)
    given[place] = [1.0]
    with pytest.raises(TypeError):
        felt_descent.descend(*given)
