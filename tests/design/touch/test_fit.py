"""The fit of pad and sensors to touches: what it finds, and that its derivatives are those of its residual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hapticd.design.touch.fit import fit
from hapticd.design.touch.model import LATENCY, Apart, Calibration, FitState, Free, Model, stepped
from hapticd.design.touch.waves import Waves

from .synthetic import WAVE_RAD_MM, Touching, mode_map

NOMINAL = Calibration.nominal(2)
WRONG = Calibration(
    pad=np.array((0.4, -0.3, 0.006, 0.002, -0.002, 0.003, 0.0)),
    sense=np.array(((1.0, 0.03), (-0.02, 0.97 + 0.02j))),
    waves=np.zeros((2, 0)),
)


def test_pad_latency_and_sensors_are_found_together() -> None:
    found = fit(Touching(WRONG).windows(), mode_map(), Free(pad=True, sense=True), NOMINAL).calibration
    away = np.abs(found.pad - WRONG.pad)
    assert away[:2].max() < 0.02  # mm
    assert away[2] < np.radians(0.03)
    assert away[3:5].max() < 1e-3
    assert away[LATENCY] < 1.0e-3  # the centroid's shift has the rest
    assert np.abs(found.sense - WRONG.sense).max() < 0.02


@pytest.mark.long
def test_errors_are_within_the_stated_sigma() -> None:
    ratios = []
    for seed in range(1, 5):
        found = fit(Touching(WRONG, seed=seed, seconds=6.0).windows(), mode_map(), Free(pad=True, sense=True), NOMINAL)
        ratios.append(((found.calibration.pad - WRONG.pad) / found.sigma.pad)[:5])
    assert 0.3 < float(np.sqrt(np.mean(np.square(ratios)))) < 2.5


def test_loads_that_change_with_the_force_are_followed() -> None:
    windows = Touching(NOMINAL, seconds=6.0, fingers=1, noise_um_s=0.3, noise_mm=0.005).windows()
    found = fit(windows, mode_map(), Free(), NOMINAL)
    expected = 100.0 * (1.0 + 0.3 * np.sin(2.0 * np.pi * 0.8 * (windows.start_s + 0.01)))
    assert np.median(np.abs(found.loads[:, 0] - expected)) < 6.0


def test_a_finger_that_is_no_point_passes_for_no_error_of_the_sensors() -> None:
    windows = Touching(WRONG, noise_um_s=0.3, radii_mm=(4.0, 6.0)).windows()
    found = fit(windows, mode_map(), Free(pad=True, sense=True), NOMINAL).calibration
    assert np.abs(found.sense - WRONG.sense).max() < 0.02
    assert np.abs(found.pad - WRONG.pad)[:2].max() < 0.06


def test_fingers_that_each_keep_to_their_side_turn_and_stretch_no_pad() -> None:
    windows = Touching(WRONG, seconds=8.0, seed=3).windows()
    biases_mm = np.array(((0.5, -0.2), (-0.5, 0.2)))
    tracks = tuple(replace(one, xy_mm=one.xy_mm + mm) for one, mm in zip(windows.tracks, biases_mm, strict=True))
    biased = replace(windows, tracks=tracks)
    alike, apart = (
        fit(biased, mode_map(), Free(True, True, apart=each), NOMINAL) for each in (Apart.NONE, Apart.TOUCHES)
    )
    assert np.abs(alike.calibration.pad - WRONG.pad)[2:5].max() > 5e-3
    assert np.abs(apart.calibration.pad - WRONG.pad)[:2].max() < 0.03  # mm
    assert np.abs(apart.calibration.pad - WRONG.pad)[2:5].max() < 1.5e-3


@pytest.fixture(scope="module")
def linearised() -> tuple[Model, FitState]:
    modes = mode_map()
    windows = Touching(WRONG, seconds=1.0).windows()
    waves = Waves(modes, WAVE_RAD_MM)
    model = Model(windows, modes, WRONG, waves)
    rng = np.random.default_rng(5)
    lacking = 0.01 * rng.standard_normal((2, len(waves)))
    loads = 100.0 + 10.0 * rng.standard_normal(windows.track.shape) + 5j
    rates = np.zeros((2, model.terms.shape[-1]), np.complex128)
    own = np.asarray(50.0 * (rng.standard_normal((2, model.splines.shape[-1])) + 1j), np.complex128)
    spread_mm2, apart_mm = np.array((8.0, 12.0)), np.array(((0.3, -0.2),))
    return model, FitState(replace(WRONG, waves=lacking), rates, own, loads, spread_mm2, apart_mm)


@pytest.mark.parametrize("place", [*range(7), "apart", "sensors and map"])
def test_derivatives_are_those_of_the_residual(linearised: tuple[Model, FitState], place: int | str) -> None:
    """By central differences, along one number of the pad, or a random step of the others."""
    model, state = linearised
    pad, apart_mm = np.zeros(7), np.zeros((1, 2))
    sense, waves = np.zeros(3, np.complex128), np.zeros_like(state.calibration.waves)
    free, bar, rng = Free(True, True, True), 1e-3, np.random.default_rng(6)
    if place == "sensors and map":
        sense = 1e-5 * (rng.standard_normal(3) + 1j * rng.standard_normal(3))
        waves, bar = 1e-5 * rng.standard_normal(waves.shape), 5e-4  # surfaces are in single precision
    else:  # the slope of what the map lacks is left out
        state = replace(state, calibration=replace(state.calibration, waves=waves))
    if isinstance(place, int):
        pad[place] = 1e-5
        # The latency's is by the smoothed velocity, which is not quite the slope of the interpolated positions.
        bar = 0.02 if place == LATENCY else bar
    elif place == "apart":
        free, apart_mm = Free(apart=Apart.TOUCHES), np.array(((1e-5, -2e-5),))
    ends = []
    for sign in (1.0, -1.0):
        found = stepped(state.calibration, sign * pad, sign * sense, sign * waves)
        ends.append(model.residual(replace(state, calibration=found, apart_mm=state.apart_mm + sign * apart_mm)))
    numeric = (ends[0] - ends[1]) / 2.0
    step = np.concatenate((waves.ravel(), pad, sense.real, sense.imag)) if free.pad else apart_mm.ravel()
    point = model.at(state, (np.arange(len(numeric)), slice(None)), free)
    moves = np.pad(step, (0, len(point.places)))[point.places]
    for mode in range(2):
        rows = np.sum([one @ moves[at] for at, one in point.of_mode(mode, np.ones(numeric.shape[:2]))[1]], axis=0)
        assert np.abs(numeric[..., mode] - rows[:, ::2] - 1j * rows[:, 1::2]).max() < bar * np.abs(numeric).max()


def test_a_tick_at_which_the_plate_does_not_follow_its_reference_counts_less() -> None:
    """The slope of a transient is not the reference's."""
    windows = Touching(WRONG, seconds=6.0).windows()
    random = np.random.default_rng(7)
    is_behind = (np.floor(windows.start_s / 0.1) % 4 == 0)[:, None, None]
    off_um_s = 100.0 * is_behind * np.exp(2j * np.pi * random.random(windows.slope_um_s.shape))
    turned = np.exp(2j * np.pi * random.random(windows.slope_um_s.shape))
    transient = replace(
        windows, behind_um_s=windows.behind_um_s + off_um_s, slope_um_s=windows.slope_um_s + 0.3 * off_um_s * turned
    )
    found = fit(transient, mode_map(), Free(pad=True, sense=True), NOMINAL).calibration
    assert np.abs(found.pad - WRONG.pad)[:2].max() < 0.045  # 0.09 where all ticks count alike
