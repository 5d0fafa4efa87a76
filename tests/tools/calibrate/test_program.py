"""`hapticd calibrate`: every step on the simulated plate, and the service with the resulting configuration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from hapticd.__main__ import main
from hapticd.config import loader as config
from hapticd.config.sections import Config
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.daemon.machine import Machine
from hapticd.errors import CalibrationError, UsageError
from hapticd.files import calibration
from hapticd.sim.fingers.scenarios import SCENARIOS, SPEED_MM_S
from hapticd.sim.lockstep import Simulation
from hapticd.sim.settings import Settings
from hapticd.tools import latency
from hapticd.tools.calibrate import folder
from hapticd.tools.calibrate.step import Figure, Outcome, Verdict, in_order, judge, steps
from hapticd.tools.service import ConfigLoader

pytestmark = pytest.mark.long

SECONDS = 4.0


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory, measured: latency.MeasuredLatency) -> Path:
    """What `hapticd calibrate all --sim` leaves. Delays, which take real time, are given."""
    out = tmp_path_factory.mktemp("calibrate") / "plate"
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(latency, "measure", lambda _config, _seconds: measured)
        assert main(["calibrate", "all", "--sim", "--out", str(out), "--points", "21", "--dwell", "66"]) == 0
    return out


class Calibrated(Simulation):
    """The lock-step run with the calibrated map and models in place of the built-in ones."""

    def _new_machine(self) -> Machine:
        named = self._config
        self._modes = ModeShapes.load(named.plate.modes_file)
        measured = calibration.load(Path(named.device.calibration_file), self._modes.M)
        return Machine(named, self._modes, write_board=self._to_board, calibration=measured)


def leak_um(kind: type[Simulation], settings: Settings, seed: int) -> float:
    simulation = kind(SCENARIOS["strokes"].build(seed, SPEED_MM_S), settings, seed)
    simulation.run(SECONDS)
    return simulation.result("strokes").score.leak_um


def test_every_step_leaves_a_verdict_a_picture_and_what_the_service_is_to_know(out: Path) -> None:
    found = folder.load(out)
    assert [*found] == [*in_order()]
    for step, verdict in found.items():
        assert verdict.is_simulated
        if not steps()[step].is_of_bare_rig:
            assert b", simulated" in (out / f"{step}.png").read_bytes()[:200]  # the picture's title
        if step != "latency":
            assert verdict.outcome is Outcome.PASS, verdict.sentence
    assert {path.name for path in out.iterdir()} >= {"calibration.toml", "modes.npz", "hapticd.toml"}


def test_the_service_takes_the_configuration_and_leaks_no_more_than_with_its_own_map(out: Path) -> None:
    made = config.load(out / "hapticd.toml")
    assert made.plate.friction_curve[0] == 0.0
    assert len(made.trackpad.matrix) == 4
    for seed in (1, 2):
        built_in = leak_um(Simulation, Settings(), seed)
        calibrated = leak_um(Calibrated, Settings(config=made), seed)
        assert calibrated < 1.1 * built_in


def test_what_hapticd_run_prepares_of_it_is_the_measured_map(out: Path) -> None:
    with ConfigLoader() as config_loader:
        prepared = config_loader.prepare(config.load(out / "hapticd.toml"))
        assert prepared.modes.shapes.tobytes() == ModeShapes.load(out / "modes.npz").shapes.tobytes()
        assert [one.frequency_hz for one in prepared.calibration.modes] == pytest.approx([29195.0, 29215.0], abs=0.5)
        assert [one.q_factor for one in prepared.calibration.modes] == pytest.approx([500.0, 500.0], rel=0.03)


def test_without_a_step_the_order_and_the_results_are_shown(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "--out", str(out)]) == 0
    output = capsys.readouterr().out
    places = [output.index(f"{place}. {step}") for place, step in enumerate(in_order(), 1)]
    assert places == sorted(places)
    assert output.count("done (simulated)") == 12
    for sim, given in ((["--sim"], "--sim "), ([], "--port /dev/ttyACM0 ")):
        assert main(["calibrate", *sim, "--out", str(out / "none")]) == 0
        output = capsys.readouterr().out
        for step in ("supplies", "all"):
            assert f"hapticd calibrate {step} {given}--out" in output


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["resonance", "--sim", "--points", "2"], "--points: 2 is out of bounds"),
        (["modes"], "No scan is given"),
        (["friction"], "No readings are given"),
        (["latency"], "No devices are configured"),
        (["friction", "--sim", "--seed", "-1"], "--seed: -1 is out of bounds"),
        (["all", "--port", "/dev/none", "--marks", "1,2"], "--marks needs"),
        (["wires", "--sim", "--wiring", "paper"], "--wiring: this step knows"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(
    arguments: list[str], sentence: str, tmp_path: Path, refused: Callable[..., str]
) -> None:
    assert sentence in refused("calibrate", *arguments, "--out", str(tmp_path))


def a_verdict(step: str = "friction", outcome: Outcome = Outcome.PASS, *, is_simulated: bool = True) -> Verdict:
    figures = (Figure("noise", 0.5, "%"), Figure("period", float("inf"), "ms"))
    settings = {"plate": {"friction_curve": [0.0, 1.0]}}
    return Verdict(step, outcome, 'It "fits": 1 µm.', figures, settings, is_simulated)


def test_result_written_is_read_again_and_no_other_text_is_one(tmp_path: Path) -> None:
    written, result = a_verdict(), tmp_path / "friction.json"
    folder.save(tmp_path, written)
    parsed = folder.load(tmp_path)["friction"]
    assert [figure.value for figure in parsed.figures] == [0.5, None]
    assert replace(parsed, figures=written.figures) == written
    for text in ("", "{}", "[1]", result.read_text().replace("pass", "fine"), "[" * 100_000, '{"step": 1}'):
        result.write_text(text)
        with pytest.raises(CalibrationError, match="delete it and repeat"):
            folder.load(tmp_path)


def test_worst_finding_decides_and_all_of_its_severity_are_listed() -> None:
    look, fail = (Outcome.WARN, "Look."), (Outcome.FAIL, "Bad.")
    assert judge([], "Good.") == (Outcome.PASS, "Good.")
    assert judge([look, look], "Good.") == (Outcome.WARN, "Look. Look.")
    assert judge([look, fail, look], "Good.") == fail
    assert str(a_verdict(outcome=Outcome.WARN)).splitlines()[-1] == 'friction: WARN: It "fits": 1 µm.'


def test_a_step_that_failed_does_not_reach_the_configuration(tmp_path: Path) -> None:
    folder.save(tmp_path, a_verdict(outcome=Outcome.FAIL))
    assert config.load(tmp_path / "hapticd.toml") == Config()
    folder.save(tmp_path, a_verdict())
    assert config.load(tmp_path / "hapticd.toml").plate.friction_curve == (0.0, 1.0)


@pytest.mark.parametrize(
    ("curve_um", "sentence"), [([0.0, 181.25, 2900.0], "out of bounds"), ([0.0, 0.0, 0.0], "rising numbers")]
)
def test_settings_that_the_service_would_not_take_fail_and_spoil_no_others(
    curve_um: list[float], sentence: str, tmp_path: Path
) -> None:
    wrong = replace(a_verdict(), settings={"plate": {"friction_curve": curve_um}})
    judged = folder.accepted(wrong)
    assert judged.outcome is Outcome.FAIL
    assert sentence in judged.sentence
    folder.save(tmp_path, judged)
    assert config.load(tmp_path / "hapticd.toml") == Config()


def test_one_step_s_settings_on_a_real_plate_are_taken_before_the_others_exist() -> None:
    real = replace(a_verdict("resonance"), settings={"device": {"port": "/dev/ttyACM0", "baud": 921600}})
    assert folder.accepted(real) == real
    failed = replace(real, outcome=Outcome.FAIL)
    assert folder.accepted(failed) == failed


def test_results_of_a_real_and_of_the_simulated_plate_do_not_mix(tmp_path: Path) -> None:
    folder.save(tmp_path, a_verdict(is_simulated=False))
    with pytest.raises(CalibrationError, match="is of a real plate"):
        folder.prepare(tmp_path, is_simulated=True)
    folder.prepare(tmp_path, is_simulated=False)


def test_directory_that_cannot_be_created_is_refused(tmp_path: Path) -> None:
    (tmp_path / "modes.json").touch()
    with pytest.raises(UsageError, match="cannot be created"):
        folder.prepare(tmp_path / "modes.json" / "below", is_simulated=True)
