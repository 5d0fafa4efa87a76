"""The verdict of a self-calibration: what it adopts, and when it must say that it does not know."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from hapticd.design.touch import judge
from hapticd.design.touch.judge import calibrate
from hapticd.design.touch.model import Calibration
from hapticd.design.touch.observations import in_sessions, in_windows
from hapticd.design.touch.posture import MOVED_MM, pose_share
from hapticd.design.touch.waves import Waves

from .synthetic import WAVE_RAD_MM, Touching, mode_map
from .test_fit import NOMINAL, WRONG

SWAPPED = replace(WRONG, sense=np.array(((1.0, 0.3), (-0.3, 1.0)), np.complex128))  # so it seems


def is_nominal(found: Calibration) -> bool:
    return not found.pad.any() and np.array_equal(found.sense, np.eye(2)) and not found.waves.any()


def test_what_held_out_touches_confirm_is_adopted() -> None:
    far_off = replace(WRONG, pad=WRONG.pad * (2.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0))
    judged = calibrate(Touching(far_off, seconds=8.0).windows(), mode_map())
    assert judged.refusal == ""
    assert np.abs(judged.fitted.pad - far_off.pad)[:2].max() < 0.03
    # The rest may be the fingers' posture, and the map's.
    assert np.array_equal(judged.calibration.pad[:5], pose_share(np.zeros((1, 2))) * judged.fitted.pad[:5])
    assert judged.latency_s == pytest.approx(3e-3, abs=0.3e-3)
    assert judged.gain_frac > 0.1
    assert "touch there next" in judged.map_refusal


@pytest.fixture
def without_map(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(judge, "_with_map", lambda judged, *_: judged)


@pytest.mark.usefixtures("without_map")
def test_a_pad_that_was_moved_is_followed() -> None:
    moved = replace(WRONG, pad=WRONG.pad * (4.0, 4.0, 1.0, 1.0, 1.0, 1.0, 1.0))  # by 2 mm
    judged = calibrate(Touching(moved, seconds=8.0).windows(), mode_map())
    assert judged.refusal == ""
    assert np.abs(judged.calibration.pad[:2] - (1.0 - MOVED_MM**2 / 4.0) * moved.pad[:2]).max() < 0.05


def with_posture(x_mm: float, seed: int) -> Touching:
    """A session whose fingers are all off by as much along x, of a pad that is off by 0.7 mm."""
    pad = WRONG.pad.copy()
    pad[0] = 0.7 + x_mm
    return Touching(replace(WRONG, pad=pad), seconds=8.0, seed=seed)


@pytest.mark.long
@pytest.mark.usefixtures("without_map")
def test_what_the_fingers_of_each_session_share_is_not_the_pads_place() -> None:
    sessions = [with_posture(x_mm, seed) for x_mm, seed in ((-0.3, 1), (0.3, 2))]
    alone = calibrate(sessions[0].windows(), mode_map())
    both = calibrate(in_windows(*in_sessions([one.shown() for one in sessions]), 0.01), mode_map())
    assert alone.refusal == both.refusal == ""
    assert alone.fitted.pad[0] == pytest.approx(0.4, abs=0.03)
    assert both.fitted.pad[:2] == pytest.approx((0.7, WRONG.pad[1]), abs=0.03)
    assert 0.7 > both.calibration.pad[0] > 0.7 * pose_share(np.zeros((1, 2)))[0]


@pytest.mark.usefixtures("without_map")
def test_modes_turned_into_each_other_are_no_mistake_but_swapped_sensors_are() -> None:
    turned = replace(WRONG, sense=np.array(((1.0, 0.15), (-0.15, 1.0)), np.complex128))
    judged = calibrate(Touching(turned, seconds=8.0).windows(), mode_map())
    assert judged.refusal == ""
    assert np.abs(judged.calibration.sense - turned.sense)[0, 1] < 0.05
    swapped = Touching(SWAPPED, seconds=8.0).windows()
    judged = calibrate(swapped, mode_map())
    assert "far from the calibration before" in judged.refusal
    assert judged.map_refusal == judged.refusal
    assert judged.waves is None
    assert is_nominal(judged.calibration)


def test_sensors_that_seem_swapped_without_the_map_are_none_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def mapped(judged: judge.TouchCalibration, *_: object) -> judge.TouchCalibration:
        assert np.abs(judged.fitted.sense[0, 1]) > judge.MOST_CROSSTALK
        return replace(judged, fitted=WRONG, calibration=WRONG)

    monkeypatch.setattr(judge, "_with_map", mapped)
    judged = calibrate(Touching(SWAPPED, seconds=8.0).windows(), mode_map())
    assert judged.refusal == ""
    assert np.array_equal(judged.calibration.sense, WRONG.sense)


@pytest.mark.parametrize(
    ("bar", "value", "refusal"),
    [
        ("MOST_DRIFT_HZ", 0.0, r"Mode \d moved by \d+ Hz while the plate was touched"),
        ("MOST_SIGMAS", 0.1, "The fit is far from the calibration before"),
    ],
)
def test_fit_beyond_what_a_laboratory_meets_is_refused(
    bar: str, value: float, refusal: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(judge, bar, value)
    judged = calibrate(Touching(WRONG, seconds=8.0).windows(), mode_map())
    assert re.match(refusal, judged.refusal)
    assert judged.map_refusal == judged.refusal
    assert is_nominal(judged.calibration)


@pytest.mark.parametrize(
    ("touching", "refusal"),
    [
        (Touching(NOMINAL, seconds=8.0), "confirm no change"),
        pytest.param(Touching(WRONG, seconds=6.0, at_rest=True, fingers=1), "node lines", marks=pytest.mark.long),
        (Touching(WRONG, seconds=3.0), "Only 3"),
    ],
    ids=["as calibrated", "at rest", "short"],
)
def test_parameters_that_touches_do_not_show_stay_as_they_are(touching: Touching, refusal: str) -> None:
    judged = calibrate(touching.windows(), mode_map())
    assert refusal in judged.refusal
    assert is_nominal(judged.calibration)


@pytest.mark.long
def test_loads_that_no_position_explains_are_not_adopted() -> None:
    windows = Touching(WRONG, seconds=8.0).windows()
    rng = np.random.default_rng(3)
    # The instants, and so the positions, of other windows.
    shuffled = replace(windows, t_s=windows.t_s[rng.permutation(len(windows))])
    judged = calibrate(shuffled, mode_map())
    assert judged.refusal
    assert is_nominal(judged.calibration)


def test_windows_hold_the_same_fingers_throughout() -> None:
    touching = Touching(WRONG, seconds=3.0)
    first, second = touching.windows().tracks
    late = second.t_s > 1.5  # the second finger is down from the middle on
    part = replace(second, t_s=second.t_s[late], xy_mm=second.xy_mm[late], velocity_mm_s=second.velocity_mm_s[late])
    cut = in_windows(touching.ticks(np.random.default_rng(1)), [first, part], 0.01)
    assert {tuple(row) for row in cut.track.tolist()} == {(0, -1), (0, 1)}
    position, _ = cut.fingers_mm()
    down = np.isfinite(position[..., 0]).all(axis=1)
    assert np.array_equal(down, cut.track >= 0)


def test_gains_stay_as_calibrated_and_the_map_moves_the_plate_as_found() -> None:
    modes = mode_map()
    waves = Waves(modes, WAVE_RAD_MM)
    sense = np.array(((1.0, 0.01j), (0.02, 1.08 * np.exp(0.03j))))
    found = replace(NOMINAL, sense=sense, waves=np.random.default_rng(3).normal(0.0, 0.01, (2, len(waves))))
    kept = judge._with_gains_in_map(found, waves)
    assert np.abs(np.diag(kept.sense)) == pytest.approx(1.0)
    reading_um = np.array((0.3 - 1.0j, 2.0))
    before_um, after_um = (
        np.tensordot(
            one.sense @ reading_um, modes.shapes + waves.on_grid(one.waves, modes.x_mm, modes.y_mm), axes=(0, 0)
        )
        for one in (found, kept)
    )
    assert after_um == pytest.approx(before_um)


def test_pads_share_of_a_pose_grows_with_sessions_and_falls_with_their_distance() -> None:
    one, two, five = (pose_share(np.zeros((sessions, 2))) for sessions in (1, 2, 5))
    assert (one < two).all()
    assert (two < five).all()
    assert (five < 1.0).all()
    apart = pose_share(np.array(((0.8, 0.0), (-0.8, 0.0))))
    assert apart[0] < two[0]
    assert np.array_equal(apart[2:], two[2:])
    assert np.array_equal(pose_share(np.array(((0.8, 0.3),))), one)  # alone it is its own mean
