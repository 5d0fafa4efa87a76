"""Another friction curve in the configuration reaches everything that speaks of friction.

A curve whose amplitudes are all halved is the default one in halves of a micrometre: with halved targets, limits and
motion every friction stays, and every amplitude halves.
"""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from hapticd.config.sections import Config
from hapticd.core.friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from hapticd.core.perception import ContactPerception
from hapticd.core.solver.instant import InstantSolver
from hapticd.daemon.machine import Machine
from hapticd.daemon.settings import friction_curve
from hapticd.design.felt_places import settle_felt, touches_at
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.score import felt
from hapticd.tools.served_friction import served_curve

AMPLITUDES_UM = tuple(DEFAULT_FRICTION_CURVE.amplitude_um(1.0 - index / 16) for index in range(17))
HALF = Config(
    plate=replace(
        Config().plate,
        friction_curve=tuple(um / 2.0 for um in AMPLITUDES_UM),
        friction_floor_frac=DEFAULT_FRICTION_CURVE.floor_frac,
    )
)
CURVE = friction_curve(HALF)
TRUTH = GroundTruth(PlateSettings.of("fingertip"))
PLACES_MM = ((-40.0, 10.0), (35.0, -20.0))


def solved_um(curve: FrictionCurve, scale: float) -> np.ndarray:
    limits_um = tuple(scale * limit_um for limit_um in TRUTH.w_limit_um)
    solver = InstantSolver(
        TRUTH.true_mode_map(),
        limits_um,
        contact_radius_mm=5.0,
        friction_curve=curve,
    )
    places = [(x_mm, y_mm, target_um) for (x_mm, y_mm), target_um in zip(PLACES_MM, (scale, 0.0), strict=True)]
    modal_um: tuple[complex, ...] = (0j,) * 4
    for _ in range(30):
        modal_um = solver.solve(places, modal_um, 10**9).modal_um
    return np.array(modal_um)


def test_friction_as_asked_is_that_of_the_curve() -> None:
    got = [
        felt(np.array(PLACES_MM)[None], padded(solved_um(curve, scale)), TRUTH.shapes, curve)[1]
        for curve, scale in ((CURVE, 0.5), (DEFAULT_FRICTION_CURVE, 1.0))
    ]
    assert got[0] == pytest.approx(got[1], abs=0.01)
    others = felt(np.array(PLACES_MM)[None], padded(solved_um(CURVE, 1.0)), TRUTH.shapes, CURVE)
    assert np.abs(others[1] - got[0]).max() > 0.05  # twice as much is asked there


def padded(modal_um: np.ndarray) -> np.ndarray:
    return np.concatenate((modal_um, np.zeros(len(TRUTH.decay_1_s) - 4)))[None]


def test_telemetry_and_score_judge_by_it() -> None:
    modal_um = solved_um(DEFAULT_FRICTION_CURVE, 1.0)
    modes, (x_mm, y_mm) = TRUTH.true_mode_map(), PLACES_MM[0]
    half, whole = (ContactPerception(curve, 5.0) for curve in (CURVE, DEFAULT_FRICTION_CURVE))
    assert half.asked(0.5, 1.0) == pytest.approx(whole.asked(1.0, 1.0), rel=1e-9)
    felt_by_half = half.felt(modes, x_mm, y_mm, tuple((modal_um / 2.0).tolist()), 1.0).friction
    assert felt_by_half == pytest.approx(
        whole.felt(modes, x_mm, y_mm, tuple(modal_um.tolist()), 1.0).friction, rel=1e-9
    )
    plate_um = padded(modal_um)
    fingers_mm = np.array(PLACES_MM)[None]
    _, judged = felt(fingers_mm, plate_um / 2.0, TRUTH.shapes, CURVE)
    assert judged == pytest.approx(felt(fingers_mm, plate_um, TRUTH.shapes)[1])


def test_the_design_of_plates_follows_it() -> None:
    found = touches_at(TRUTH.true_mode_map(), np.array(PLACES_MM)[None], 5.0)
    limits_um = np.array(TRUTH.w_limit_um)
    (half_um, half_jnd), (whole_um, whole_jnd) = (
        settle_felt(found, (scale, 0.0), scale * limits_um, curve=curve)
        for curve, scale in ((CURVE, 0.5), (DEFAULT_FRICTION_CURVE, 1.0))
    )
    assert half_jnd == pytest.approx(whole_jnd, abs=0.1)
    assert np.abs(half_um).max() < 0.6 * np.abs(whole_um).max()


def test_the_service_and_the_view_have_it() -> None:
    machine = Machine(HALF, TRUTH.true_mode_map(), write_board=lambda data: len(data))
    assert machine.scene.friction_curve.knots == CURVE.knots
    described = msgspec.to_builtins(machine.status.plate(), builtin_types=(bytes,))
    assert served_curve(described).amplitude_um(0.5) == pytest.approx(CURVE.amplitude_um(0.5))
