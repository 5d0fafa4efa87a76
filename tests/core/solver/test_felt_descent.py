"""The descent in C: against the same iteration on arrays, and what is no problem is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.core.friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.solver import felt_descent
from hapticd.core.solver.felt import UNCERTAIN_FRAC, counted_jnd, stickiness
from hapticd.values import WEBER_FRAC

Array = npt.NDArray[np.float64]
CURVES = (DEFAULT_FRICTION_CURVE, FrictionCurve.from_amplitudes((0.0, 0.1, 0.3, 0.8, 1.4), 0.12))


def problem(seed: int) -> list[Any]:
    """The arguments of a call, for a random problem of up to 6 fingers on up to 8 modes."""
    random = np.random.default_rng(seed)
    fingers, modes, points = int(random.integers(1, 7)), int(random.integers(1, 9)), int(random.integers(2, 13))
    scale = float(random.choice([1.0, 1.0, 1.0, 0.0, 1e-200, 1e120, np.nan]))
    curve = CURVES[seed % 2]
    frictions = random.choice([1.0, 0.9, 0.8, 0.5, 0.24, curve.floor_frac], fingers).tolist()
    return [
        (scale * random.uniform(-1, 1, (fingers * points, modes))).tobytes(),
        [1.0 / points] * points,
        [1.0] * fingers,
        frictions,
        counted_jnd(frictions, random.integers(0, 4, fingers).tolist()),
        stickiness(frictions),
        random.choice([1.0, 1.6], fingers).tolist(),
        curve.pieces,
        (curve.full_um, curve.floor_frac),
        tuple((10.0 ** random.uniform(-3, 1, modes)).tolist()),
        *random.normal(size=(2, modes)).tolist(),
        random.normal(size=fingers).tolist(),
        int(random.integers(0, 5)),
        0.03,
        UNCERTAIN_FRAC,
    ]


def iterated(given: list[Any]) -> tuple[Array, Array, Array]:
    """One problem after its iterations, on arrays: W (M,) in its parts, and the weights."""
    shapes, weights, _, frictions, counted, sticky, slides, pieces, (full_um, least), limits = given[:10]
    d, q, logs = map(np.array, given[10:13])
    wanted, sticky, slides, c = map(np.array, (frictions, sticky, slides, weights))
    starts, origins, decays = np.array(pieces).T
    phi = np.frombuffer(shapes).reshape(len(wanted), len(c), len(d))
    for _ in range(given[13]):
        w = phi @ (d + 1j * q)
        r = np.sqrt(np.abs(w) ** 2 + UNCERTAIN_FRAC**2 * (phi**2 @ (d * d + q * q)))
        at = r / slides[:, None]
        piece = np.maximum(np.searchsorted(starts, at, side="right") - 1, 0)
        friction = np.where(at < full_um, np.exp((origins[piece] - at) / decays[piece]), least)
        rate, got = 1.0 / decays[piece] / slides[:, None], friction @ c
        error = np.log(np.minimum(np.maximum(np.abs(got - wanted) / (WEBER_FRAC * wanted), 0.02), counted))
        logs = logs + 0.3 * (error - error.mean())
        logs = np.clip(logs - logs.mean(), -4.6, 4.6)
        slope = (np.exp(logs) / (WEBER_FRAC * wanted))[:, None] * c * friction * rate
        along = (1.0 - sticky)[:, None] * slope * rate
        kappa = sticky[:, None] * slope / np.sqrt(r * r + 0.05**2) + along
        outwards = np.clip((got - wanted) / got, -1.5, 1.0)
        aim = np.maximum(r + decays[piece] * (slides * outwards)[:, None], 0.0)
        pulled = along * aim / np.maximum(np.abs(w), 1e-9)
        curvature = np.einsum("nq,nqk,nql->kl", kappa, phi, phi)
        pull = np.einsum("nq,nqk->k", pulled * w, phi)
        stay, before = 0.03 * np.trace(curvature) / len(d), d + 1j * q
        now = before.copy()
        for k in list(range(len(d))) * 4:
            own = (1.0 + UNCERTAIN_FRAC**2) * curvature[k, k] + stay
            rest = pull[k] + stay * before[k] - curvature[k] @ now + curvature[k, k] * now[k]
            now[k] = 1.1 * rest / own - 0.1 * now[k] if own > 0.0 else 0.0
            now[k] *= min(1.0, limits[k] / max(abs(now[k]), 1e-300))
        d, q = now.real, now.imag
    return d, q, logs


def test_the_descent_is_the_iteration_on_arrays() -> None:
    compared = 0
    for seed in range(200):
        given = problem(seed)
        phi = np.frombuffer(given[0])
        if not 1e-3 < np.abs(phi).max() < 1e3:
            continue
        expected = iterated(given)
        felt_descent.descend(*given)
        for ours, arrays in zip(given[10:13], expected, strict=True):
            assert ours == pytest.approx(arrays, rel=1e-6, abs=1e-9), seed
        compared += 1
    assert compared > 50


def test_at_any_scale_amplitudes_are_finite_and_within_the_limits() -> None:
    for seed in range(300):
        given = problem(seed)
        _, rms_um = felt_descent.descend(*given)
        if given[13] > 0 and not np.isnan(np.frombuffer(given[0])).any():
            assert np.all(np.hypot(given[10], given[11]) <= given[9]), seed
            assert rms_um == felt_descent.contacts_rms_um(given[0], given[1], given[10], given[11])


@pytest.mark.parametrize("still", [1, 2, 3])
def test_still_points_get_nothing_and_the_limits_hold_whatever_the_others_get(still: int) -> None:
    for seed in range(100):
        random = np.random.default_rng(seed)
        phi, limits = random.uniform(-1.0, 1.0, (still + 2, 4)), (4.0, 3.0, 2.0, 1.0)
        frictions = [DEFAULT_FRICTION_CURVE.friction(0.0)] * still + [DEFAULT_FRICTION_CURVE.friction(1.0)] * 2
        d, q = random.normal(size=(2, 4)).tolist()
        felt_descent.descend(
            *(
                phi.tobytes(),
                [1.0],
                [0.0] * still + [1.0] * 2,
                frictions,
                [1e9] * len(phi),
                [2.0] * still + [0.0] * 2,
                [1.0] * len(phi),
            ),
            *(DEFAULT_FRICTION_CURVE.pieces, (2.0, 0.057), limits, d, q, [0.0] * len(phi), 60, 0.03, 0.01),
        )
        got = np.abs(phi @ (np.array(d) + 1j * np.array(q)))
        assert got[:still].max() < 1e-14
        assert np.all(np.hypot(d, q) <= limits)
        assert got[still:].max() > 0.01


def test_shapes_over_contacts_are_those_of_the_map_bit_for_bit_beyond_it_and_nowhere() -> None:
    disc = [(0.3, -0.2, 0.25), (0.9, 0.1, 0.5), (-1.0, 0.4, 0.25)]
    for seed in range(60):
        random = np.random.default_rng(seed)
        modes, columns, rows = int(random.integers(1, 9)), int(random.integers(4, 12)), int(random.integers(4, 12))
        x_mm, y_mm = np.linspace(-30.0, 30.0, columns), np.cumsum(random.uniform(0.5, 9.0, rows))
        plate = ModeShapes(x_mm, y_mm, random.normal(size=(modes, rows, columns)))
        centres_mm = [*random.uniform(-40.0, 60.0, (20, 2)).tolist(), [x_mm[-1], y_mm[-1]], [np.nan, 0.0]]
        centres_mm += [[np.inf, -np.inf], [float(x_mm[1]), float(y_mm[1])]]
        contacts = [(*centre_mm, *random.uniform(-6.0, 6.0, 3).tolist()) for centre_mm in centres_mm]
        found = np.frombuffer(felt_descent.contact_shapes(plate, disc, contacts)).reshape(-1, modes).tolist()
        expected = [
            list(plate.at(x + (xx * u + xy * v), y + (xy * u + yy * v)))
            for x, y, xx, xy, yy in contacts
            for u, v, _ in disc
        ]
        assert found == expected, seed


@pytest.mark.parametrize(
    ("disc", "contacts", "error"),
    [
        ([(0.0, 0.0)], [(0.0, 0.0, 5.0, 0.0, 5.0)], ValueError),
        ([(0.0, 0.0, 1.0)], [(0.0, 0.0)], ValueError),
        ([(0.0, 0.0, 1.0)], [(0.0, 0.0, 5.0, 0.0, "a")], TypeError),
        (None, [], TypeError),
    ],
)
def test_a_disc_or_contact_of_another_form_is_refused(disc: object, contacts: object, error: type[Exception]) -> None:
    plate = ModeShapes(np.arange(4.0), np.arange(5.0), np.ones((2, 5, 4)))
    with pytest.raises(error):
        felt_descent.contact_shapes(plate, disc, contacts)
    with pytest.raises(AttributeError):
        felt_descent.contact_shapes(None, [(0.0, 0.0, 1.0)], [(0.0, 0.0, 5.0, 0.0, 5.0)])


@pytest.mark.parametrize(
    ("place", "given", "error"),
    [
        (0, b"", ValueError),
        (0, bytes(24), ValueError),
        (0, None, TypeError),
        (1, ["a", "b"], TypeError),
        (2, [], ValueError),
        (3, [1.0, 1.0], ValueError),
        (4, [], ValueError),
        (5, [], ValueError),
        (7, [], ValueError),
        (7, [(0.0, 0.0)], ValueError),
        (10, [0.0, 0.0], ValueError),
        (12, [None], TypeError),
    ],
)
def test_what_is_no_list_of_the_right_length_is_refused(place: int, given: object, error: type[Exception]) -> None:
    arguments: list[object] = [
        np.array([1.0, 0.5]).tobytes(),
        [0.5, 0.5],
        [1.0],
        [0.5],
        [0.9],
        [0.0],
        [1.0],
        [(0.0, 0.0, 0.7)],
        (2.0, 0.05),
        (1.0,),
        [0.1],
        [0.0],
        [0.0],
        1,
        0.03,
        0.01,
    ]
    felt_descent.descend(*arguments)
    arguments[place] = given
    with pytest.raises(error):
        felt_descent.descend(*arguments)


def test_amplitudes_are_taken_apart_and_put_together() -> None:
    modal_um = (1.5, 2.0 - 3.0j, complex(-0.0, -1.0), np.complex128(0.5j))
    parts = felt_descent.components(modal_um)
    assert parts == ([1.5, 2.0, -0.0, 0.0], [0.0, -3.0, -1.0, 0.5])
    assert felt_descent.phasors(*parts) == modal_um
    assert {type(part) for part in parts[0] + parts[1]} == {float}
    for wrong in ("a", [None], 1.0):
        with pytest.raises(TypeError):
            felt_descent.components(wrong)
    with pytest.raises(ValueError, match="another length"):
        felt_descent.phasors([1.0], [])
    with pytest.raises(TypeError):
        felt_descent.phasors([1.0], ["a"])


def test_tables_that_are_no_arrays_of_doubles_are_refused() -> None:
    class Modes:
        tables = memoryview(bytes(16)), memoryview(np.arange(4.0)), memoryview(np.arange(5.0))

    with pytest.raises(ValueError, match="no such array"):
        felt_descent.contact_shapes(Modes(), [(0.0, 0.0, 1.0)], [(0.0, 0.0, 5.0, 0.0, 5.0)])
