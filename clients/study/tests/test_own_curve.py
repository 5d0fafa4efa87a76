"""A participant's own friction curve, from its file to the amplitudes of a trial."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import pytest

from hapticd_contract.surfaces import Surface
from hapticd_contract.targets import ClientTargets, FingerTarget
from hapticd_study import own_curve
from hapticd_study.experiment import StudyError
from hapticd_study.own_curve import OwnCurve

CURVE = OwnCurve((0.0, 0.5, 3.0), 0.1)
SERVED = {"friction_curve": [(0.0, 1.0), (0.5, 0.55), (3.0, 0.1)]}  # of its plate's reply


def calibrated(folder: Path, text: str) -> Path:
    path = own_curve.path_of(folder, "P03")
    path.parent.mkdir(parents=True)
    path.write_text(text, encoding="utf-8")
    return folder


def test_the_calibrated_curve_passes_through_session_and_service_unchanged(tmp_path: Path) -> None:
    text = own_curve.settings({own_curve.KEY: {"amplitude_um": [0, 0.5, 3.0], "floor_frac": 0.1}})
    assert tomllib.loads(text)["plate"] == {"friction_curve": [0.0, 0.5, 3.0], "friction_floor_frac": 0.1}
    about = {own_curve.KEY: own_curve.measured(calibrated(tmp_path, text), "P03")}
    assert own_curve.of_session(about) == CURVE
    assert (own_curve.of_session({}), own_curve.settings({})) == (None, "")


def test_the_logarithm_of_friction_is_straight_between_the_amplitudes() -> None:
    assert [CURVE.friction_to_um(friction) for friction in (1.0, 0.5, 0.0)] == pytest.approx([0.0, 0.5, 3.0])
    relative = math.sqrt(0.55 * 0.1)  # half way of the logarithm
    assert CURVE.friction_to_um((relative - 0.1) / 0.9) == pytest.approx(1.75)
    assert CURVE.is_served(SERVED)
    assert not OwnCurve((0.0, 0.6, 3.0), 0.1).is_served(SERVED)
    assert not CURVE.is_served({})


def test_frictions_become_amplitudes_and_all_else_stays() -> None:
    scene = ClientTargets(
        client="study",
        targets=(FingerTarget(1, friction=0.5), FingerTarget("virtual", amplitude_um=1.25)),
        surfaces=(Surface(name="floor", friction=1.0, circle_mm=20.0),),
    )
    felt = CURVE.felt_by(scene)
    assert felt.targets == (FingerTarget(1, amplitude_um=pytest.approx(0.5)), scene.targets[1])
    assert felt.surfaces == (Surface(name="floor", amplitude_um=0.0, circle_mm=20.0),)


@pytest.mark.parametrize("text", ["", "[plate", "[plate]\nfriction_curve = [0.0, 1.0]\n", "plate = 3"])
def test_a_file_without_a_curve_is_named(text: str, tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"participants/P03/hapticd\.toml: has no friction curve"):
        own_curve.measured(calibrated(tmp_path, text), "P03")
    with pytest.raises(StudyError, match="calibrate friction --participant P04"):
        own_curve.measured(tmp_path, "P04")


@pytest.mark.parametrize(
    ("um", "floor"), [([1.0, 0.5], 0.1), ([0.0, 0.5, 0.5], 0.1), ([0.0], 0.1), ([0.0, math.inf], 0.1), ([0.0, 1.0], 1)]
)
def test_what_is_no_curve_is_refused(um: list[float], floor: float) -> None:
    with pytest.raises(StudyError, match="is no friction curve"):
        own_curve.of_session({own_curve.KEY: {"amplitude_um": um, "floor_frac": floor}})
