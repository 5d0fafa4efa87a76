"""`hapticd calibrate touch`: from a recording to a verdict, a picture, and settings that mend what was wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.board_values import BoardCalibration, ModeCalibration
from hapticd.config import loader as config_loader
from hapticd.config.sections import Config, RecordConfig, TrackpadConfig, UncertaintyConfig
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.daemon.settings import plate_from_pad
from hapticd.design.touch.contacts import spreads_of
from hapticd.design.touch.fit import Fit
from hapticd.design.touch.guide import GUIDED_S
from hapticd.design.touch.judge import TouchCalibration
from hapticd.design.touch.model import Calibration
from hapticd.design.touch.waves import Waves
from hapticd.errors import CalibrationError
from hapticd.files import calibration as calibration_file
from hapticd.files.recording.kinds import Record
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.sim import lockstep
from hapticd.sim.settings import Settings
from hapticd.tools.calibrate import folder, touch
from hapticd.tools.record import attach, simulated
from hapticd.tools.touch_correction import contact_settings, joined, known_better
from hapticd.tools.touch_recording import COLLECTED, Collected, Touched, read
from hapticd.tools.touch_recording import touched as touched_by
from hapticd.values import Knot, LimitReason, SafeDrive
from hapticd.wire.commands import encode_reference

Recorded = Callable[[TrackpadConfig, int, float], Path]
MISPLACED = TrackpadConfig(offset_mm=(0.8, -0.6), latency_ms=13.0)  # the simulated pad lies at 0, 0 and takes 10 ms


def played(pad: TrackpadConfig, telemetry_hz: int = 500) -> Settings:
    return Settings(config=Config(trackpad=pad, record=RecordConfig(telemetry_hz=telemetry_hz)))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Return a recording of strokes, without the ground truth."""

    @cache
    def make(pad: TrackpadConfig, telemetry_hz: int, seconds: float) -> Path:
        path = tmp_path_factory.mktemp("touch") / "session.mcap"
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(simulated, "_put_truth", lambda *_: None)
            simulated.run("strokes", path, settings=played(pad, telemetry_hz), seed=1, seconds=seconds)
        return path

    return make


@pytest.mark.parametrize("has_pulse", [False, True])
def test_a_reference_is_read_with_and_without_a_pulse_of_the_sync_output(has_pulse: bool) -> None:
    drive = SafeDrive(0, (Knot(0, (1.0, 0.5j)), Knot(8_000_000, (0.25, 0.0))), LimitReason.NONE)
    collected = Collected()
    collected.take(Record("written", 1, 0, {"line": encode_reference(7, drive, 1000, has_pulse)}))
    (frame,) = collected.frames
    assert frame.modal_um.tolist() == [[1.0, 0.5j], [0.25, 0.0]]


def test_ticks_at_the_voltage_limit_have_the_slope_of_those_before_and_after(recorded: Recorded) -> None:
    recording, seen = open_recording(recorded(TrackpadConfig(), 500, 2.5)), Collected()
    for record in recording.records():
        if record.kind in COLLECTED:
            seen.take(record)
    header = recording.header
    free = touched_by(seen, header, "the touching").ticks
    limited = range(100, len(seen.samples) - 1, 10)
    for index in limited:
        seen.samples[index] = replace(seen.samples[index], saturated=True)
    ticks = touched_by(seen, header, "the touching").ticks
    assert len(ticks.t_s) == pytest.approx(len(free.t_s), abs=3)
    voltages_v = [mode.voltage_v for index in limited for mode in seen.samples[index].modes]
    at = np.flatnonzero(np.isin(free.voltage_v, voltages_v).all(axis=1))
    assert len(at) > 30
    where = np.searchsorted(ticks.t_s, free.t_s[at] - 1e-6)
    moved_um_s = np.abs(ticks.slope_um_s[where] - free.slope_um_s[at])
    assert (moved_um_s > 0.0).mean() > 0.9  # by what was measured, no longer by the reference
    assert np.median(moved_um_s) < 0.1 * np.median(np.abs(free.slope_um_s[at]))


def test_recordings_of_several_sessions_are_one_as_the_last_would_have_shown_them(recorded: Recorded) -> None:
    misplaced, right = (read(recorded(pad, 500, 2.5)) for pad in (MISPLACED, TrackpadConfig()))
    rows = ((2.0, 0.0), (0.0, 3.0))
    seen = tuple(ModeCalibration(mode, 29195.0, 500.0, 7.5, 0.1, sense=row) for mode, row in enumerate(rows))
    header = replace(right.header, calibration=BoardCalibration(seen))
    right = right._replace(header=header, drive_hz=right.drive_hz - 1.0)
    both = joined({Path("monday"): misplaced, Path("tuesday"): right})
    assert [one.session for one in both.tracks] == [0, 0, 1, 1]
    since_s = both.ticks.t_s[len(misplaced.ticks.t_s)] - right.ticks.t_s[0]
    for monday, tuesday in zip(both.tracks[:2], both.tracks[2:], strict=True):
        at_mm, _ = tuesday.at(monday.t_s[5:-5] + since_s)
        assert np.abs(at_mm - monday.xy_mm[5:-5]).max() < 0.1
    first = both.ticks.measured_um[: len(misplaced.ticks.t_s)]
    assert first == pytest.approx(misplaced.ticks.measured_um * (2, 3))
    assert both.ticks.turning_rad_s[0] - misplaced.ticks.turning_rad_s[0] == pytest.approx(2.0 * np.pi)
    axis = np.linspace(-60.0, 60.0, 5)
    other = replace(header, modes=ModeShapes(axis, axis, np.ones((3, 5, 5))))
    with pytest.raises(CalibrationError, match=r"monday: is of a plate of 2 modes, and tuesday of 3: give"):
        joined({Path("monday"): misplaced, Path("tuesday"): right._replace(header=other)})


def test_a_recording_without_control_ticks_and_a_missing_one_are_refused(
    recorded: Recorded, tmp_path: Path, refused: Callable[..., str]
) -> None:
    for path, why in (
        (recorded(TrackpadConfig(), 0, 1.0), "set record.telemetry_hz = 500"),
        (tmp_path / "none.mcap", "is not a file: give a recording"),
    ):
        assert why in refused("calibrate", "touch", str(path), "--out", str(tmp_path / "out"))


def test_a_short_recording_is_refused_and_changes_no_setting(
    recorded: Recorded, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["calibrate", "touch", str(recorded(MISPLACED, 500, 2.5)), "--out", str(out)]) == 1
    assert "Nothing is adopted. Only" in capsys.readouterr().out
    assert {path.name for path in out.iterdir()} == {"hapticd.toml", "touch.json", "touch.png"}
    assert folder.merged(folder.load(out).values()) == {}


def judged(found: Calibration, waves: Waves | None = None) -> TouchCalibration:
    """A calibration that is adopted."""
    return TouchCalibration(found, found, Calibration.nominal(2), 60.0, 1e-3, 1e-4, 0.1, 0.1, "", "", waves, None)


def test_with_the_map_sensors_are_known_better_but_for_their_common_gain(
    recorded: Recorded,
) -> None:
    touched = read(recorded(TrackpadConfig(), 500, 2.5))
    config = touched.header.config
    modes = tuple(ModeCalibration(mode, 29195.0, 500.0, 7.5, 0.1) for mode in range(2))
    waves = Waves(touched.header.modes, 0.23)

    def left(before: UncertaintyConfig, sigma: float, *, has_sensors: bool = True) -> tuple[UncertaintyConfig, float]:
        """What is not known after touching, and by how much the limit of a reference is nearer to the mode's."""
        before_config = replace(config, uncertainty=before)
        calibration = BoardCalibration(modes if has_sensors else ())
        header = replace(touched.header, config=before_config, calibration=calibration)
        sure = Calibration(np.zeros(7), np.full((2, 2), sigma + 0j), np.zeros((2, 0)))
        found = replace(judged(Calibration.nominal(2), waves), sigma=sure)
        known = replace(before, **known_better(touched._replace(header=header), found))
        after = replace(before_config, uncertainty=known).reference_limit_um
        return known, after[0] - before_config.reference_limit_um[0]

    usual = UncertaintyConfig()
    known, nearer_um = left(usual, 0.004)
    assert known == replace(usual, sensors_frac=0.004, gain_frac=usual.sensors_frac)
    assert nearer_um > 0.05
    again, nearer_um = left(known, 0.004)
    assert again == known
    assert nearer_um == 0.0
    known, nearer_um = left(replace(usual, map_frac=0.003, sensors_frac=0.003), 0.002)
    assert known.sensors_frac == 0.002
    assert nearer_um >= 0.0
    assert left(usual, 0.05)[0] == left(usual, 0.004, has_sensors=False)[0] == usual
    mapped = replace(judged(Calibration.nominal(2), waves), map_sigma=np.full((3, 3), 0.014))
    header = replace(touched.header, config=replace(config, uncertainty=usual))
    assert known_better(touched._replace(header=header), mapped) == {"map_frac": 0.014}
    assert known_better(touched, judged(Calibration.nominal(2))) == {}


def test_modes_that_are_mixed_otherwise_than_in_the_map_stay_within_their_limits(recorded: Recorded) -> None:
    """Sensors alone are corrected, by what turns two modes into each other; that may be the map's error."""
    touched = read(recorded(TrackpadConfig(), 500, 2.5))
    config = touched.header.config
    modes = tuple(ModeCalibration(mode, 29195.0, 500.0, 7.5, 0.1) for mode in range(2))
    touched = touched._replace(header=replace(touched.header, calibration=BoardCalibration(modes)))
    sense = np.array([[1.0, 0.155], [-0.148, 1.0]], np.complex128)
    found = judged(replace(Calibration.nominal(2), sense=sense))
    known = replace(config, uncertainty=replace(config.uncertainty, **known_better(touched, found)))
    true_um = np.abs(np.linalg.inv(sense)) @ known.reference_limit_um
    assert (true_um < 0.95 * np.array(config.limits.w_limit_um)).all()
    again = touched._replace(header=replace(touched.header, config=known))
    assert known_better(again, found) == {}
    assert known_better(touched, replace(found, refusal="as it was")) == {}


def test_what_is_adopted_is_written_as_the_service_loads_it(recorded: Recorded, tmp_path: Path) -> None:
    turned = TrackpadConfig(offset_mm=(2.0, -1.0), matrix=(0.0, -0.99, 1.01, 0.0), latency_ms=12.0)
    touched = read(recorded(turned, 500, 2.5))
    before = [ModeCalibration(mode, 29195.0 + 20.0 * mode, 500.0, 7.5, 0.1) for mode in range(2)]
    before[1] = replace(before[1], sense=(0.01 + 0.0j, 1.02 + 0.0j))
    touched = touched._replace(header=replace(touched.header, calibration=BoardCalibration(tuple(before), 29211.5)))
    waves = Waves(touched.header.modes, 0.23)
    pad = np.array((0.3, -0.2, 0.004, 0.002, -0.001, 0.0015, 0.0))
    sense = np.array(((1.0, 0.02j), (-0.01, 0.97)))
    lacking = np.zeros((2, len(waves)))
    lacking[1, 3] = 0.02
    found = judged(Calibration(pad, sense, lacking), waves)

    settings = touch.saved(touched, found, tmp_path)

    (tmp_path / "hapticd.toml").write_text(folder.as_toml(settings))
    config = config_loader.load(tmp_path / "hapticd.toml")
    matrix, offset_mm = found.calibration.affine
    moved_mm = matrix @ plate_from_pad(Config(trackpad=turned)).apply(30.0, -20.0) + offset_mm
    assert plate_from_pad(config).apply(30.0, -20.0) == pytest.approx(moved_mm, abs=1e-3)
    assert config.trackpad.latency_ms == pytest.approx(13.5)
    assert config.uncertainty == replace(UncertaintyConfig(), **known_better(touched, found))
    loaded = calibration_file.load(tmp_path / "touch-calibration.toml", 2)
    assert loaded.drive_hz == 29211.5
    weights = np.array([one.sense for one in loaded.modes])
    assert np.allclose(weights, sense @ ((1.0, 0.0), (0.01, 1.02)), atol=1e-5)
    assert [one.gain_um_per_v_s for one in loaded.modes] == [7.5, 7.5]
    change = ModeShapes.load(tmp_path / "touch-modes.npz").shapes - touched.header.modes.shapes
    assert not change[0].any()
    assert np.sqrt(np.mean(change[1] ** 2)) == pytest.approx(0.02, rel=0.2)


def with_contacts(touched: Touched) -> Touched:
    """The same as if it were of a plate of four modes, whose fingers are contacts."""
    config = touched.header.config
    limits = replace(config.limits, w_limit_um=(4.0,) * 4)
    return touched._replace(header=replace(touched.header, config=replace(config, limits=limits)))


def of_size(touched: Touched, radius_mm: float, sigma_mm2: float = 0.1) -> TouchCalibration:
    """A verdict on touches that all have this size."""
    found, count = Calibration.nominal(2), len(touched.tracks)
    spread_mm2 = np.repeat(spreads_of(np.array((radius_mm,)), touched.header.modes), count)
    nothing = np.zeros(0)
    fit = Fit(
        *(found, found, np.zeros((7, 7)), nothing, nothing, nothing, np.zeros(0, complex), spread_mm2),
        np.full(count, sigma_mm2),
        *(np.zeros((0, 0)), np.zeros((count, 2)), None),
    )
    return replace(judged(found), fit=fit)


def test_the_size_of_contacts_is_adopted_with_the_law_of_the_pads_ellipses(recorded: Recorded, tmp_path: Path) -> None:
    touched = read(recorded(TrackpadConfig(), 500, 2.5))
    assert contact_settings(touched, of_size(touched, 5.5)) == {}  # on two modes fingers are points
    touched = with_contacts(touched)
    found = of_size(touched, 5.5)
    settings = touch.saved(touched, found, tmp_path)
    (tmp_path / "hapticd.toml").write_text(folder.as_toml(settings))
    config = config_loader.load(tmp_path / "hapticd.toml")
    assert config.solver.contact_radius_mm == pytest.approx(5.5, abs=0.02)
    axis_mm = np.mean([track.axis_mm for track in touched.tracks])
    law = config.trackpad
    assert law.ellipse_scale * axis_mm + law.ellipse_offset_mm == pytest.approx(11.0, abs=0.1)
    verdict = touch.verdict(found, settings, has_sensors=True, is_simulated=False)
    assert verdict.sentence == "Adopted: pad, the contacts' size."
    known = replace(found, map_sigma=np.array(((0.02, 0.02, 0.02), (0.02, 0.01, 0.02), (0.02, 0.02, 0.03))))
    with_map = touch.verdict(known, settings, has_sensors=True, is_simulated=False)
    assert "by 1.0 % of its peak in the middle of the plate, by 3.0 % in the upper right" in with_map.sentence
    places = [figure.name for figure in with_map.figures if figure.name.startswith("map, one sigma")]
    assert (len(places), places[0]) == (9, "map, one sigma, lower left")
    assert ("radius of a contact, mean", 5.5) in [(figure.name, round(figure.value, 1)) for figure in verdict.figures]


def test_impossible_or_unknown_size_and_uncalibrated_sensors_are_not_adopted(
    recorded: Recorded, tmp_path: Path
) -> None:
    touched = read(recorded(TrackpadConfig(), 500, 2.5))
    assert set(touch.saved(touched, judged(Calibration.nominal(2)), tmp_path)) == {"trackpad"}
    assert list(tmp_path.iterdir()) == []
    touched = with_contacts(touched)
    assert contact_settings(touched, of_size(touched, 1.5)) == {}
    assert contact_settings(touched, of_size(touched, 5.5, sigma_mm2=20.0)) == {}
    unknown = replace(of_size(touched, 5.5), refusal="The touches do not tell where the pad lies.")
    assert contact_settings(touched, unknown) == {}
    without = touched._replace(tracks=tuple(replace(track, axis_mm=np.nan) for track in touched.tracks))
    assert set(contact_settings(without, of_size(touched, 5.5))) == {"solver"}


@pytest.mark.long
def test_a_misplaced_pad_is_mended_in_part_by_ten_seconds_of_strokes(
    recorded: Recorded, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = recorded(MISPLACED, 500, 12.0), tmp_path / "out"
    before = path.read_bytes()
    assert main(["calibrate", "touch", str(path), "--out", str(out)]) == 0
    assert "touch: PASS: Adopted: pad." in capsys.readouterr().out
    assert path.read_bytes() == before
    found = config_loader.load(out / "hapticd.toml").trackpad
    assert np.hypot(*found.offset_mm) < 0.75  # of 1 mm: most of it may be the fingers' posture
    assert found.latency_ms == pytest.approx(10.0, abs=1.0)
    assert np.allclose(found.matrix, (1.0, 0.0, 0.0, 1.0), atol=2e-3)
    mended = replace(found, source="sim")
    leaks = [
        lockstep.run("strokes", settings=played(pad, 0), seed=11, seconds=4.0).score.leak_um
        for pad in (TrackpadConfig(), MISPLACED, mended)
    ]
    assert leaks[1] > 3.0 * leaks[0]
    assert leaks[2] < 0.75 * leaks[1]


def test_it_says_where_to_touch_from_the_recording_s_start_on_and_ends() -> None:
    said: list[str] = []
    begun: list[float] = []
    t_s = 0.0
    guide = touch.Guide(lambda: begun.append(t_s), said.append, lambda: t_s)
    guide.notify(attach.WAITING)
    t_s = 5.0
    assert not guide.is_ended()
    assert said == [attach.WAITING]
    guide.notify(attach.BEGUN)
    guide.notify(attach.LATE)
    assert begun == [5.0]
    ends = []
    for tick in range(round(10 * GUIDED_S) + 1):
        t_s = 5.0 + 0.1 * tick
        ends.append(guide.is_ended())
    assert ends.index(True) == round(10 * GUIDED_S)
    assert said[3] == " 60 s left: stroke the lower left quarter with one finger, the upper right one with another"
    assert 60 <= len(said) < 80


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("--guided", "session.mcap"), "either a RECORDING"),
        ((), "either a RECORDING"),
        (("session.mcap", "--sim"), "only with --guided"),
    ],
)
def test_what_does_not_go_together_is_refused(
    arguments: tuple[str, ...], why: str, tmp_path: Path, refused: Callable[..., str]
) -> None:
    assert why in refused("calibrate", "touch", *arguments, "--out", str(tmp_path / "out"))


@pytest.mark.long
def test_simulated_fingers_are_recorded_and_calibrated_by(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(touch, "GUIDED_S", 2.0)
    out = tmp_path / "out"
    for _ in range(2):  # the recording of the run before is replaced
        assert main(["calibrate", "touch", "--guided", "--sim", "--out", str(out)]) == 1
        assert "Nothing is adopted. Only 2.0 s of touching" in capsys.readouterr().out
    assert (out / "touch.mcap").is_file()
