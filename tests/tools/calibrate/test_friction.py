"""A friction curve from noisy readings with outliers, and refusal of readings without one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.config.loader import from_table
from hapticd.core.friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from hapticd.errors import CalibrationError
from hapticd.tools.calibrate import friction, simulated
from hapticd.tools.calibrate.friction import KNOTS, fit_friction, read
from hapticd.tools.calibrate.step import Outcome

LEVELS_UM = np.repeat(np.linspace(0.0, 3.0, 25), 5)


def falling(amplitude_um: np.ndarray) -> np.ndarray:
    """The scene's built-in law as coefficients."""
    floor = np.exp(-2.0 / 0.7)
    share = np.maximum((np.exp(-amplitude_um / 0.7) - floor) / (1.0 - floor), 0.0)
    return np.asarray(0.25 + 0.55 * share)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_simulated_curve_is_found_again_and_wrong_readings_are_left_out(seed: int) -> None:
    found = fit_friction(*simulated.friction_readings(seed))
    assert found.left_out.sum() == simulated.SLIPS
    assert found.bare == pytest.approx(simulated.BARE_FRICTION, abs=0.02)
    assert found.floor == pytest.approx(simulated.FLOOR_FRICTION, abs=0.02)
    curve = FrictionCurve.from_amplitudes(found.amplitude_um.tolist())
    for share in np.linspace(0.2, 1.0, 17):  # nearer the floor amplitude hardly changes friction
        got = np.interp(curve.amplitude_um(share), np.linspace(0, 3, 301), falling(np.linspace(0, 3, 301)))
        assert got == pytest.approx(0.25 + 0.55 * share, abs=0.03)
        assert curve.amplitude_um(share) == pytest.approx(DEFAULT_FRICTION_CURVE.amplitude_um(share), abs=0.15)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**31), st.floats(0.0, 0.1), st.floats(0.01, 100.0))
def test_whatever_the_noise_the_curve_rises_strictly_and_does_not_know_the_unit(
    seed: int, noise: float, unit: float
) -> None:
    value = falling(LEVELS_UM) + noise * np.random.default_rng(seed).standard_normal(len(LEVELS_UM))
    found = fit_friction(LEVELS_UM, value)
    FrictionCurve.from_amplitudes(found.amplitude_um.tolist())  # raises unless it rises
    assert found.amplitude_um[0] == 0.0
    scaled = fit_friction(LEVELS_UM, unit * value)
    np.testing.assert_allclose(scaled.amplitude_um, found.amplitude_um, rtol=1e-6, atol=1e-9)


def test_wide_scatter_of_readings_is_a_warning_and_little_a_curve_for_the_service() -> None:
    verdict = friction.verdict(fit_friction(*simulated.friction_readings(4)), is_simulated=True)
    assert verdict.outcome is Outcome.PASS
    assert len(from_table(dict(verdict.settings), where="x", folder=Path()).plate.friction_curve) == KNOTS
    value = falling(LEVELS_UM) + 0.12 * np.random.default_rng(1).standard_normal(len(LEVELS_UM))
    assert friction.verdict(fit_friction(LEVELS_UM, value), is_simulated=True).outcome is Outcome.WARN


@pytest.mark.parametrize(
    ("amplitude_um", "value", "sentence"),
    [
        ([0, 1, 2], [1, 0.5, 0.2], "Measure bare glass"),
        ([0.5, 1, 2, 3], [1, 0.5, 0.2, 0.1], "Measure bare glass"),
        ([0, 1, 2, 3], [1, 1, 1, 1], "hardly falls"),
        ([0, 1, 2, 3], [0.2, 0.5, 0.8, 1], "hardly falls"),
        ([0, 1, 2, float("nan")], [1, 1, 1, 1], "no finite number"),
        ([0, 1, 2, 3], [1, 0.5, 0.2, float("nan")], "no finite number"),
        ([0, 1, 2, 3], [1e308, 1e307, 1e306, 1e305], "no finite number"),
        ([0, 1, 2, 3], [-0.1, -0.4, -0.7, -0.8], "readings' sign"),
        ([-1, 0, 2, 3], [1, 1, 1, 1], "negative"),
        ([], [], "Measure bare glass"),
    ],
)
def test_readings_that_show_no_curve_are_refused(amplitude_um: list[float], value: list[float], sentence: str) -> None:
    with pytest.raises(CalibrationError, match=sentence):
        fit_friction(amplitude_um, value)


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"# a dry finger\namplitude_um, friction\n0,0.8\n\n1,0.4\n", [[0.0, 1.0], [0.8, 0.4]]),
        (b"amplitude_um,friction,speed_mm_s\n0,0.8,50\n1,0.4,99\n", [[0.0, 1.0], [0.8, 0.4], [50.0, 99.0]]),
        (b"", "header"),
        (b"amplitude_um;friction\n0,0;1,0\n", "with commas between cells and points in numbers"),
        (b"amplitude_um,friction\n", "holds 0 readings"),
        (b"amplitude_um,friction\n1,2\nx,y\n", "reading 2 is not 2 numbers"),
        (b"amplitude_um,friction,speed_mm_s\n1,2\n", "reading 1 is not 3 numbers"),
        (b"\xff\x00\xfe", "cannot be read"),
        (None, "cannot be read"),
    ],
)
def test_file_is_read_with_its_columns_and_another_refused(
    content: bytes | None, found: str | list[list[float]], tmp_path: Path
) -> None:
    path = tmp_path / "friction.csv"
    if content is not None:
        path.write_bytes(content)
    if isinstance(found, str):
        with pytest.raises(CalibrationError, match=found):
            read(path)
    else:
        assert read(path).tolist() == found


# --- speed ------------------------------------------------------------------------------------------------------


def sliding(v0_mm_s: float, seed: int) -> tuple[np.ndarray, ...]:
    """Readings at random speeds; bare glass rubs a little more at speed, and some readings are wrong."""
    random = np.random.default_rng(seed)
    speed_mm_s = np.exp(random.uniform(*np.log((20.0, 300.0)), len(LEVELS_UM)))
    friction = falling(LEVELS_UM / (1.0 + speed_mm_s / v0_mm_s)) * (speed_mm_s / 100.0) ** 0.1
    friction += 0.02 * random.standard_normal(len(LEVELS_UM))
    friction[random.choice(len(friction), 3, replace=False)] += 0.3
    return LEVELS_UM, friction, speed_mm_s


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("v0_mm_s", [100.0, 400.0])
def test_the_speed_that_needs_twice_the_amplitude_is_found_with_the_curve(v0_mm_s: float, seed: int) -> None:
    found = fit_friction(*sliding(v0_mm_s, seed))
    assert found.speed.speed_mm_s == pytest.approx(v0_mm_s, rel=0.35)
    half_um = DEFAULT_FRICTION_CURVE.amplitude_um(0.5)
    for speed_mm_s in (50.0, 100.0, 200.0):  # the errors of the curve at rest and of v0 cancel
        needed_um = found.amplitude_um[KNOTS // 2] * (1.0 + speed_mm_s / found.speed.speed_mm_s)
        assert needed_um == pytest.approx(half_um * (1.0 + speed_mm_s / v0_mm_s), rel=0.12)
    made = friction.verdict(found, is_simulated=False)
    assert "needs twice the amplitude of one at rest" in made.sentence
    assert from_table(dict(made.settings), where="x", folder=Path()).plate.friction_speed_mm_s > 0.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_readings_without_an_effect_of_speed_give_none(seed: int) -> None:
    amplitude_um, value, speed_mm_s = sliding(np.inf, seed)
    found = fit_friction(amplitude_um, value, speed_mm_s)
    assert found.speed.speed_mm_s == np.inf
    assert found.speed.sentence.startswith("Speed changes nothing that the readings show, from 2")
    found = fit_friction(amplitude_um, np.exp(-amplitude_um), speed_mm_s)  # as a sensor without noise has it
    assert (found.speed.speed_mm_s, found.bare) == (np.inf, pytest.approx(1.0))


def test_readings_that_cannot_show_an_effect_of_speed_say_so() -> None:
    amplitude_um, value, speed_mm_s = sliding(100.0, 1)
    at_one_speed = np.where(amplitude_um > 0.0, speed_mm_s, 100.0)
    few_fast = np.where((amplitude_um > 0.0) & (amplitude_um < 2.0), 20.0, 200.0 + speed_mm_s)
    few_fast[amplitude_um > 2.2] = 20.0
    for speeds, sentence in (
        (None, "have no speed_mm_s"),
        (np.full(len(value), 50.0), "less than a factor of 3"),
        (at_one_speed, "not measured at several speeds"),
        (few_fast, "fewer than 4 amplitudes each"),
    ):
        found = fit_friction(amplitude_um, value, speeds)
        assert found.speed.speed_mm_s == np.inf
        assert sentence in found.speed.sentence
    with pytest.raises(CalibrationError, match="A speed is not above 0"):
        fit_friction(amplitude_um, value, -speed_mm_s)
