"""A participant's own friction curve, from its measurement to the amplitudes of a trial."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.config.loader import load, with_friction
from hapticd.config.sections import Config
from hapticd.core.friction import FrictionCurve
from hapticd.daemon.settings import friction_curve
from hapticd.tools import run
from hapticd.tools.study import own_curve
from hapticd.tools.study.experiment import StudyError
from hapticd_contract.surfaces import Surface
from hapticd_contract.targets import ClientTargets, FingerTarget

CURVE = FrictionCurve.from_amplitudes((0.0, 0.5, 3.0))


def readings(folder: Path, scale_um: float) -> Path:
    """Friction of a finger that needs this much amplitude, without noise."""
    amplitudes_um = np.repeat(np.linspace(0.0, 4.0 * scale_um, 12), 3)
    rows = [f"{um},{0.2 + 0.6 * np.exp(-um / scale_um)}" for um in amplitudes_um.tolist()]
    path = folder / f"{scale_um:g}.csv"
    path.write_text("\n".join(["amplitude_um,friction", *rows]), encoding="utf-8")
    return path


def test_each_participant_has_the_amplitudes_that_were_measured_for_it(tmp_path: Path) -> None:
    out = tmp_path / "calibration"
    for name, scale_um in (("P03", 0.4), ("P04", 0.8)):
        command = ["calibrate", "friction", "--readings", str(readings(tmp_path, scale_um)), "--out", str(out)]
        assert main([*command, "--participant", name]) == 0
    assert not (out / "hapticd.toml").exists()  # the plate's own curve is another step
    abouts = [{own_curve.KEY: own_curve.measured(out, name)} for name in ("P03", "P04")]
    first, second = (own_curve.of_session(about) for about in abouts)
    assert first is not None
    assert second is not None
    assert second.amplitude_um(0.5) == pytest.approx(2.0 * first.amplitude_um(0.5), rel=0.1)


def test_frictions_become_amplitudes_and_all_else_stays() -> None:
    scene = ClientTargets(
        client="study",
        targets=(FingerTarget(1, friction=0.5), FingerTarget("virtual", amplitude_um=1.25)),
        surfaces=(Surface(name="floor", friction=1.0, circle_mm=20.0),),
    )
    felt = own_curve.felt_by(CURVE, scene)
    assert felt.targets == (FingerTarget(1, amplitude_um=0.5), FingerTarget("virtual", amplitude_um=1.25))
    assert felt.surfaces == (Surface(name="floor", amplitude_um=0.0, circle_mm=20.0),)


def test_a_participant_without_a_curve_is_told_how_to_measure_it(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="measure P03's curve with `hapticd calibrate friction --participant P03"):
        own_curve.measured(tmp_path, "P03")
    assert own_curve.of_session({}) is None
    with pytest.raises(StudyError, match="is no friction curve"):
        own_curve.of_session({own_curve.KEY: {"amplitude_um": [1.0, 0.5], "floor_frac": 0.1}})


def test_a_service_that_was_started_with_the_curve_has_it_and_another_has_not(tmp_path: Path) -> None:
    out = tmp_path / "calibration"
    command = ["calibrate", "friction", "--readings", str(readings(tmp_path, 0.4)), "--out", str(out)]
    assert main([*command, "--participant", "P03"]) == 0
    about = {own_curve.KEY: own_curve.measured(out, "P03")}
    curve = own_curve.of_session(about)
    assert curve is not None

    def served(configured: Config) -> dict[str, object]:
        law = friction_curve(configured)
        return {"friction_curve": [[um, law.friction(um)] for _, um in reversed(law.knots)]}

    started = with_friction(Config(), own_curve.path_of(out, "P03"))
    assert own_curve.is_served(curve, served(started))
    assert not own_curve.is_served(curve, served(Config()))
    assert not own_curve.is_served(curve, {})
    rehearsed = tmp_path / "rehearsal.toml"
    rehearsed.write_text(own_curve.settings(about), encoding="utf-8")
    assert load(rehearsed).plate == started.plate
    assert own_curve.settings({}) == ""


def test_a_running_service_reads_the_next_participants_curve_at_its_reload(tmp_path: Path) -> None:
    out, now = tmp_path / "calibration", tmp_path / "now.toml"
    parser = argparse.ArgumentParser()
    run.add_arguments(parser)
    options, served = parser.parse_args(["--sim", "--friction", str(now)]), []
    for name, scale_um in (("P03", 0.4), ("P04", 0.8)):
        command = ["calibrate", "friction", "--readings", str(readings(tmp_path, scale_um)), "--out", str(out)]
        assert main([*command, "--participant", name]) == 0
        shutil.copyfile(own_curve.path_of(out, name), now)
        served.append(run._configuration(options).plate)
    assert served == [with_friction(Config(), own_curve.path_of(out, name)).plate for name in ("P03", "P04")]
    assert served[0] != served[1]


def test_a_name_that_is_no_participants_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["calibrate", "friction", "--readings", str(readings(tmp_path, 0.4)), "--out", str(tmp_path / "c")]
    assert main([*command, "--participant", "../P03"]) == 2
    assert "--participant" in capsys.readouterr().err
