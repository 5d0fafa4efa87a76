"""The fitted map, its expected leak, and the verdicts on unsound scans."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.__main__ import main
from hapticd.config.sections import SimConfig
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.design import CartographyFit, Pose, free_plate_modes
from hapticd.design.contact_pairs import random_fingers
from hapticd.errors import CalibrationError, ModesError
from hapticd.formats.mode_map import LoweredScan, Scan, SweptModes, read_scan, read_swept
from hapticd.sim.plate.ground_truth import DRIVEN_MODES, GroundTruth, PlateSettings
from hapticd.tools.calibrate import folder, modes, resonance, simulated
from hapticd.tools.calibrate.modes import TARGETS_UM, ExpectedLeak, expected_leak, fit_map, solved_um
from hapticd.tools.calibrate.step import Outcome

pytestmark = pytest.mark.long

SIZE_MM = (137.5, 137.5)
POINTS_MM = np.random.default_rng(5).uniform(-60.0, 60.0, (2000, 2))


def driven_scan(plate: SimConfig, count: int) -> Scan:
    scan = simulated.scan(1, plate)
    return Scan(scan.points_mm, scan.readings[:, :count])


@pytest.fixture(scope="module")
def found() -> modes.FittedMap:
    return fit_map(driven_scan(SimConfig(), 2), SIZE_MM, normalise=False)


def test_the_map_is_the_plate_within_one_percent_from_readings_with_two(found: modes.FittedMap) -> None:
    truth = GroundTruth().shapes(POINTS_MM)[:, :2]
    error = found.fit.modes.evaluate(POINTS_MM) - truth
    assert np.sqrt((error**2).mean(axis=0)).max() < 0.01 * np.abs(truth).max()
    assert found.fit.noise_rms == pytest.approx([simulated.SCAN_NOISE_FRAC] * 2, rel=0.1)
    assert [name for name, _ in found.like] == [*DRIVEN_MODES]
    assert min(correlation for _, correlation in found.like) > 0.99


def test_the_expected_leak_is_what_the_true_plate_gives_the_sticky_finger(found: modes.FittedMap) -> None:
    fitted = found.fit.modes
    pairs_mm = random_fingers(SIZE_MM, 600, seed=9)
    sticky = GroundTruth().shapes(pairs_mm[:, TARGETS_UM.index(0.0)])[:, :2]
    true_um = float(np.linalg.norm(np.einsum("nm,nm->n", sticky, solved_um(fitted, pairs_mm)))) / np.sqrt(600.0)
    assert 0.4 * true_um < found.leak.rms_um < min(2.5 * true_um, found.leak.most_um)
    twice = expected_leak(fitted, 2.0 * found.fit.map_error_rms, SIZE_MM)
    assert twice.rms_um == pytest.approx(2.0 * found.leak.rms_um)
    ten = ModeShapes(fitted.x_mm, fitted.y_mm, np.tile(fitted.shapes, (5, 1, 1)))  # scanned, eight amplifiers
    assert expected_leak(ten, np.full(10, 0.01), SIZE_MM).rms_um > 0.0


def test_a_grain_of_wax_carried_over_the_plate_gives_the_map_with_its_signs(tmp_path: Path) -> None:
    """50 mg lower a mode by 36 Hz at its largest; a sweep finds that to 0.2 Hz."""
    points_mm = simulated.scan(1, SimConfig()).points_mm
    pair = [shape for _, shape in free_plate_modes() if shape.name in DRIVEN_MODES]
    phi = np.stack([shape.evaluate(points_mm) for shape in pair], axis=1)
    lowered_hz = 36.0 * phi**2 + np.random.default_rng(3).normal(0.0, 0.2, phi.shape)
    lowered_hz[7, 1] = np.nan
    path = tmp_path / "wax.csv"
    header = "x_mm,y_mm,lowered_hz_1,lowered_hz_2"
    np.savetxt(path, np.hstack((points_mm, lowered_hz)), delimiter=",", header=header, comments="")
    scan = read_scan(path)
    assert isinstance(scan, LoweredScan)
    fitted = fit_map(modes._with_signs(scan, SIZE_MM), SIZE_MM, normalise=True).fit.modes
    truth = np.stack([shape.evaluate(POINTS_MM) for shape in pair], axis=1)
    found = fitted.evaluate(POINTS_MM)
    found *= (found * truth).sum(axis=0) / (found**2).sum(axis=0)
    assert np.sqrt(((found - truth) ** 2).mean(axis=0)).max() < 0.01 * np.abs(truth).max()


def test_lowered_frequencies_of_no_free_plate_s_mode_have_no_signs() -> None:
    points_mm = simulated.scan(1, SimConfig()).points_mm
    noise_hz = np.random.default_rng(3).uniform(0.0, 1.0, (len(points_mm), 1)) ** 8
    with pytest.raises(CalibrationError, match="lowered_hz_1 is like no mode of a free plate"):
        modes._with_signs(LoweredScan(points_mm, noise_hz), SIZE_MM)


def test_a_plate_of_four_modes_is_calibrated_for_its_contacts() -> None:
    plate = SimConfig(plate="fingertip", modes=4)
    scan = driven_scan(plate, 4)
    found = fit_map(scan, (190.0, 190.0), normalise=False)
    verdict = modes.verdict(found, len(scan.points_mm), (190.0, 190.0), plate)
    assert verdict.outcome is Outcome.PASS
    assert [name for name, _ in found.like] == ["12x0+0x12", "1x12", "12x0-0x12", "12x1"]
    assert verdict.settings["sim"] == {"plate": "fingertip", "modes": 4}
    assert verdict.settings["limits"]["w_limit_um"] == pytest.approx([6.0, 5.43, 3.81, 3.87], abs=0.01)
    assert folder.accepted(verdict) == verdict


def test_modes_that_amplifiers_move_are_used_and_the_others_are_compensated(
    tmp_path: Path,
) -> None:
    scan = simulated.scan(1, SimConfig(plate="fingertip", modes=4))
    assert scan.swept is not None
    order = [4, 0, 1, 2, 3]  # the file's first mode is hardly moved, and its share is that of the patches
    swept = SweptModes(*(one[order] for one in scan.swept))
    np.savez(tmp_path / "scan.npz", points_mm=scan.points_mm, readings=scan.readings[:, order], **swept._asdict())
    read = read_scan(tmp_path / "scan.npz")
    fit = fit_map(read, (190.0, 190.0), normalise=False).fit
    choice, maps = modes.chosen(fit, swept, (190.0, 190.0))
    assert choice.drive_hz == pytest.approx(26186.0, abs=30.0)
    rest = "mode 1 stays undriven, its share is compensated"
    assert choice.sentence(5) == f"use modes 2, 3, 4, 5; drive {choice.drive_hz:.0f} Hz; {rest}"
    pushed = maps.shapes - fit.modes.shapes[1:]
    assert np.linalg.matrix_rank(pushed.reshape(4, -1), tol=1e-6) == 1
    damaged = swept._replace(q_factor=np.zeros(5))
    np.savez(tmp_path / "scan.npz", points_mm=scan.points_mm, readings=scan.readings[:, order], **damaged._asdict())
    with pytest.raises(ModesError, match="frequency_hz, q_factor, gain_um_per_v_s: give"):
        read_scan(tmp_path / "scan.npz")


def test_resonance_names_modes_to_drive_and_to_compensate(tmp_path: Path) -> None:
    """The sensors of a copy see its undriven modes by a hundredth."""
    named = ["--sim", "--plate", "fingertip", "--copy", "17", "--out", str(tmp_path)]
    assert main(["calibrate", "resonance", *named, "--points", "21", "--dwell", "66"]) == 0
    swept = read_swept(tmp_path / resonance.SWEEP_FILE)
    named_hz = [figure.value for figure in folder.load(tmp_path)["resonance"].figures if "to scan" in figure.name]
    assert named_hz == pytest.approx(swept.frequency_hz[4:])
    assert main(["calibrate", "modes", *named]) == 0
    verdict = folder.load(tmp_path)["modes"]
    assert verdict.outcome is Outcome.PASS
    assert re.match(r"use modes 1, 2, 3, 4; drive \d+ Hz; modes? 5.* undriven, .* compensated", verdict.sentence)
    truth = GroundTruth(PlateSettings.of("fingertip#17"))
    assert swept.frequency_hz[:4] == pytest.approx(truth.frequency_hz[:4], abs=0.5)
    found, true = (one.evaluate(POINTS_MM) for one in (ModeShapes.load(tmp_path / "modes.npz"), truth.true_mode_map()))
    assert np.abs(found - true).max() < 0.5 * np.abs(truth.true_mode_map(4).evaluate(POINTS_MM) - true).max()


def same_twice(fit: CartographyFit) -> CartographyFit:
    shape = fit.modes.shapes[0]
    return replace(fit, modes=ModeShapes.from_grid(fit.modes.x_mm, fit.modes.y_mm, np.stack((shape, -0.5 * shape))))


def test_the_service_takes_a_map_of_one_mode_and_a_person_is_asked_to_look(found: modes.FittedMap) -> None:
    fit = found.fit
    one = ModeShapes.from_grid(fit.modes.x_mm, fit.modes.y_mm, fit.modes.shapes[:1])
    alone = replace(found, fit=replace(fit, modes=one, noise_rms=fit.noise_rms[:1], across_rms=fit.across_rms[:1]))
    alone = replace(alone, like=found.like[:1])
    verdict = modes.verdict(alone, 900, SIZE_MM, None)

    assert verdict.outcome is Outcome.WARN
    assert "1 mode where a plate usually has 2" in verdict.sentence
    assert verdict.settings["limits"] == {"w_limit_um": [4.0]}
    assert folder.accepted(verdict) == verdict


@pytest.mark.parametrize(
    ("change", "outcome", "sentence"),
    [
        (lambda f: replace(f, fit=same_twice(f.fit)), Outcome.FAIL, "Modes 1 and 2 have the same shape"),
        (lambda f: replace(f, leak=ExpectedLeak(0.5, 0.9)), Outcome.FAIL, "would leak 0.50 um"),
        (lambda f: replace(f, leak=ExpectedLeak(0.1, 0.2)), Outcome.WARN, "would leak 0.10 um"),
        (
            lambda f: replace(f, fit=replace(f.fit, noise_rms=np.array([0.02, 0.5]))),
            Outcome.FAIL,
            "Mode 2 is mostly noise",
        ),
        (lambda f: replace(f, like=()), Outcome.WARN, "Theory has no mode of this wavelength"),
        (lambda f: replace(f, beyond=9.0), Outcome.FAIL, "9.0 times beyond the largest readings"),
        (lambda f: replace(f, like=(("11x0", 0.99), ("5x10", 0.4))), Outcome.WARN, "Mode 2 is like the free plate's"),
        (lambda f: replace(f, fit=replace(f.fit, left_out=200)), Outcome.WARN, "200 of 900 readings are wrong"),
        (
            lambda f: replace(f, fit=replace(f.fit, pose=Pose(0.05, 0.5, 0.0))),
            Outcome.WARN,
            "The scan lay +2.9 degrees",
        ),
        (
            lambda f: replace(f, fit=replace(f.fit, across_rms=np.array([0.02, 0.3]))),
            Outcome.WARN,
            "Mode 2 does not move in one phase",
        ),
    ],
)
def test_a_fault_of_the_scan_is_reported(
    found: modes.FittedMap, change: Callable[[modes.FittedMap], modes.FittedMap], outcome: Outcome, sentence: str
) -> None:
    verdict = modes.verdict(change(found), 900, SIZE_MM, None)
    assert verdict.outcome is outcome
    assert sentence in verdict.sentence


GRID_MM = np.stack(np.meshgrid(np.linspace(-60, 60, 20), np.linspace(-60, 60, 20)), axis=-1).reshape(-1, 2)
NOISE = np.random.default_rng(1).integers(-3, 4, (400, 1))


def test_readings_that_are_no_modes_fail() -> None:
    found = fit_map(Scan(GRID_MM, 1e11 * NOISE), SIZE_MM, normalise=True)
    assert modes.verdict(found, 400, SIZE_MM, None).outcome is Outcome.FAIL


@pytest.mark.parametrize(
    ("points_mm", "readings", "sentence"),
    [
        (np.zeros((5, 2)), np.ones((5, 2)), "The scan cannot be fitted"),
        *((GRID_MM * scale, NOISE, "give positions in mm, or the plate's size") for scale in (0.0, 1e-3)),
        *((GRID_MM, np.full((400, 2), value), "The scan cannot be fitted") for value in (0.0, 1e-200, np.inf, np.nan)),
    ],
)
def test_scan_that_is_none_is_refused(
    points_mm: npt.NDArray[np.float64], readings: npt.NDArray[np.float64], sentence: str
) -> None:
    with pytest.raises(CalibrationError, match=sentence):
        fit_map(Scan(points_mm, readings), SIZE_MM, normalise=True)


@pytest.mark.parametrize("text", ["137", "1x2x3", "axb", "nanx100", "1x100", "infx100"])
def test_a_size_that_no_plate_has_is_refused(text: str) -> None:
    with pytest.raises(CalibrationError, match="--size"):
        modes.parse_size(text)
    assert modes.parse_size("160X114.9") == (160.0, 114.9)
