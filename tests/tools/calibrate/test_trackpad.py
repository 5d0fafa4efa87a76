"""Step 3: detection of touched marks, the fitted map, and implausible placements."""

from __future__ import annotations

import argparse
import asyncio
import json
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import pytest
from datagrams import tuio1
from input_events import END, SCREEN, lifted, packed, placed
from virtual_board import in_virtual_time

from hapticd.config.loader import from_table
from hapticd.config.sections import TrackpadConfig
from hapticd.daemon.settings import plate_from_pad
from hapticd.errors import CalibrationError
from hapticd.sim.fingers.pad_ellipse import USUAL
from hapticd.sim.fingers.paths import Line, Rest, Touch
from hapticd.sim.fingers.paths import Path as FingerPath
from hapticd.sim.fingers.sensor import Report, SensorModel, SensorSettings
from hapticd.tools import pads
from hapticd.tools.calibrate import program, trackpad
from hapticd.tools.calibrate.contacts import fit_scale, parse_prints
from hapticd.tools.calibrate.marks import TouchedMarks, fit_affine, placement
from hapticd.tools.calibrate.simulated import touch_reports
from hapticd.tools.calibrate.trackpad import parse_marks
from hapticd.tools.calibrate.verdict import Outcome, Verdict
from hapticd.values import AffineMap, RawReport
from hapticd.wire.trackpad import DEFAULT_PAD, Decoder, Pad, tuio

MARKS = parse_marks("-50,-40 50,-40 50,40 -50,40")


def options(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    program.add_arguments(parser)
    return parser.parse_args(["trackpad", *arguments])


def rests_mm(reports: Iterable[Report]) -> Sequence[tuple[float, float]]:
    """Where these reports touch a mark."""
    marks, decoder = TouchedMarks(), Decoder("mt2-usb")
    for report in reports:
        for frame in decoder.decode(report.data, round(report.t_arrive_s * 1e9)):
            marks.update(frame)
    return marks.rests_mm


def touches(paths: Sequence[FingerPath], seconds: float) -> int:
    """How many touches count of fingers on these paths."""
    return len(rests_mm(SensorModel(seed=3).reports(paths, seconds)))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_pad_anywhere_is_found_to_a_twentieth_of_a_millimetre(seed: int) -> None:
    random = np.random.default_rng(seed)
    truth = AffineMap.from_placement(
        tuple(random.uniform(-6, 6, 2)), float(random.uniform(-5, 5)), tuple(random.uniform(0.98, 1.02, 2))
    )
    found = fit_affine(rests_mm(touch_reports(MARKS, seed, SensorSettings(plate_from_pad=truth))), MARKS)
    for corner in MARKS:
        missed_mm = math.dist(found.plate_from_pad.apply(*corner), truth.apply(*corner))
        assert missed_mm < 0.05
    assert found.left_out_rms_mm < 0.1
    assert trackpad.verdict(found, {}, is_simulated=True).outcome is Outcome.PASS


def test_the_service_reads_the_same_map_from_the_settings() -> None:
    truth = AffineMap(1.01, -0.03, 0.04, 0.99, 2.5, -1.25)
    matrix = np.array([[truth.xx, truth.xy], [truth.yx, truth.yy]])
    on_pad_mm = np.linalg.solve(matrix, np.subtract(MARKS, (truth.offset_x_mm, truth.offset_y_mm)).T).T
    fit = fit_affine(on_pad_mm, MARKS)
    verdict = trackpad.verdict(fit, {"source": "sim"}, is_simulated=True)
    configured = plate_from_pad(from_table(dict(verdict.settings), where="x", folder=Path()))
    for corner in MARKS:
        assert configured.apply(*corner) == pytest.approx(truth.apply(*corner), abs=1e-3)


@pytest.mark.parametrize(
    ("order", "outcome", "sentence"),
    [
        ((1, 0, 3, 2), Outcome.FAIL, "mirrored"),
        ((3, 2, 1, 0), Outcome.FAIL, "mirrored"),
        ((2, 3, 0, 1), Outcome.WARN, "rotated by 180 degrees"),
        ((1, 2, 3, 0), Outcome.WARN, "degrees, as if x and y were swapped"),
    ],
)
def test_marks_touched_in_another_order_are_noticed(order: Sequence[int], outcome: Outcome, sentence: str) -> None:
    verdict = trackpad.verdict(fit_affine([MARKS[place] for place in order], MARKS), {}, is_simulated=False)
    assert verdict.outcome is outcome
    assert sentence in verdict.sentence


def test_a_mark_missed_by_some_millimetres_is_named_and_far_off_ones_fail() -> None:
    def verdict(missed_mm: float) -> Verdict:
        fit = fit_affine([*MARKS, (0.0, missed_mm)], [*MARKS, (0.0, 0.0)])
        return trackpad.verdict(fit, {}, is_simulated=False)

    assert verdict(2.5).outcome is Outcome.WARN
    assert "mark 5 most" in verdict(2.5).sentence
    assert verdict(12.0).outcome is Outcome.FAIL


def test_a_left_out_residual_is_what_a_fit_without_that_mark_misses() -> None:
    random = np.random.default_rng(1)
    plate = random.uniform(-60, 60, (7, 2))
    pad = plate + random.normal(0, 0.5, plate.shape)
    whole = fit_affine(pad, plate)
    for place in range(7):
        others = np.delete(np.arange(7), place)
        one = fit_affine(pad[others], plate[others]).plate_from_pad.apply(*pad[place])
        assert whole.left_out_mm[place] == pytest.approx(math.dist(one, plate[place]))


def test_a_placement_in_words_makes_the_same_map() -> None:
    where = placement(AffineMap.from_placement((1.0, 2.0), 30.0, (1.1, 0.9)))
    assert (where.rotation_deg, where.scale_x, where.scale_y) == pytest.approx((30.0, 1.1, 0.9))
    assert where.shear == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("pad_mm", "sentence"),
    [
        (MARKS[:3], "4 marks or more"),
        ([(0, 0), (10, 10), (20, 20), (30, 30)], "touches lie close to one line"),
        ([*MARKS[:3], (math.nan, 0)], "no finite position"),
    ],
)
def test_touches_that_make_no_map_are_refused(pad_mm: Sequence[tuple[float, float]], sentence: str) -> None:
    with pytest.raises(CalibrationError, match=sentence):
        fit_affine(pad_mm, MARKS[: len(pad_mm)])


def test_only_a_finger_that_rests_alone_for_half_a_second_touches_a_mark() -> None:
    assert touches([Touch(Rest((0, 0), 0.05), 0.0, 0.45)], 1.0) == 0
    assert touches([Touch(Rest((0, 0), 0.05), 0.0, 0.60)], 1.0) == 1
    assert touches([Line((-40, 0), (40, 0), 20.0)], 3.0) == 0
    assert touches([Rest((0, 0), 0.05), Rest((4, 0), 0.05, 7)], 1.5) == 0
    assert touches([Rest((0, 0), 0.05), Rest((40, 0), 0.05, 7)], 1.5) == 2


def test_a_finger_that_stays_counts_once_and_a_mark_is_not_touched_twice() -> None:
    again = [Touch(Rest((0, 0), 0.05), 0.0, 2.0), Touch(Rest((1, 1), 0.05), 2.5, 4.0)]
    assert touches(again, 4.0) == 1


@pytest.mark.parametrize(
    "text", ["", "1,2 3,4", "a,b c,d e,f g,h", "1,2,3 4,5 6,7 8,9", "0,0 1,0 50,50 -50,50", "nan,0 50,0 0,50 50,50"]
)
def test_marks_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(CalibrationError, match="--marks"):
        parse_marks(text)


class PlayedPad:
    """A pad that gives the reports of a simulated one in the loop's time."""

    def __init__(self, marks: Sequence[tuple[float, float]]) -> None:
        self.marks, self.is_closed = marks, False

    def start(
        self,
        loop: asyncio.AbstractEventLoop,
        on_reports: Callable[[Sequence[RawReport]], None],
        on_link: Callable[[Pad | None, str], None],
    ) -> None:
        on_link(DEFAULT_PAD, "played")
        for report in touch_reports(self.marks, 1):
            raw = RawReport(round(report.t_arrive_s * 1e9), report.data)
            loop.call_later(report.t_arrive_s, on_reports, (raw,))

    @property
    def counters(self) -> dict[str, int | str]:
        return {}

    def request_enable(self) -> None:
        raise AssertionError("it speaks multitouch")

    async def close(self) -> None:
        self.is_closed = True


def test_each_mark_is_prompted_until_all_are_touched(capsys: pytest.CaptureFixture[str]) -> None:
    pad = PlayedPad(MARKS)
    found, touched = in_virtual_time(trackpad.touch_marks(pad, MARKS, 60.0))
    assert found is DEFAULT_PAD
    assert pad.is_closed
    np.testing.assert_allclose(touched.rests_mm, MARKS, atol=0.05)
    output = capsys.readouterr().out
    assert [f"touch mark {place} of 4" in output for place in (1, 2, 3, 4, 5)] == [True] * 4 + [False]


def test_marks_that_are_not_touched_in_time_are_one_sentence() -> None:
    pad = PlayedPad(MARKS[:2])
    with pytest.raises(CalibrationError, match="2 of 4 marks were touched in 5 s"):
        in_virtual_time(trackpad.touch_marks(pad, MARKS, 5.0))
    assert pad.is_closed


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_prints_of_two_sizes_give_the_law_of_the_pad_s_ellipses(seed: int) -> None:
    prints_mm = parse_prints("8x8 11x8 13x10 14x14", len(MARKS))
    touched = trackpad._played(MARKS, seed, prints_mm)
    found = fit_scale(touched.axes_mm, prints_mm)
    for reported_mm in (6.0, 9.0, 12.0):
        true_mm = USUAL.scale * reported_mm + USUAL.offset_mm
        assert found.scale * reported_mm + found.offset_mm == pytest.approx(true_mm, abs=0.35)
    assert found.rms_mm < 0.3


def test_the_step_calibrates_ellipses_where_prints_are_given_and_leaves_them_off_where_not(tmp_path: Path) -> None:
    found = trackpad.run(options("--sim", "--prints", "11x9", "--out", str(tmp_path)))
    pad = from_table(dict(found.settings), where="x", folder=Path()).trackpad
    assert pad.ellipse_scale * 8.0 + pad.ellipse_offset_mm == pytest.approx(10.0, abs=0.3)
    assert pad.ellipse_offset_mm == 0.0
    without = trackpad.run(options("--sim", "--out", str(tmp_path)))
    assert from_table(dict(without.settings), where="x", folder=Path()).trackpad.ellipse_scale == 0.0


def test_prints_that_disagree_with_the_ellipses_are_a_warning_and_those_of_no_pad_are_refused() -> None:
    fit = fit_affine(MARKS, MARKS)
    scale = fit_scale([(8.0, 7.0), (10.0, 9.0), (9.0, 8.0)], [(10.0, 8.0), (10.0, 9.0), (14.0, 13.0)])
    verdict = trackpad.verdict(fit, {}, scale, is_simulated=False)
    assert verdict.outcome is Outcome.WARN
    assert "as firmly as for each print" in verdict.sentence
    with pytest.raises(CalibrationError, match="reports no ellipses"):
        fit_scale([(0.0, 0.0)], [(10.0, 8.0)])
    with pytest.raises(CalibrationError, match="do not grow with the prints"):
        fit_scale([(8.0, 7.0), (10.0, 9.0)], [(14.0, 13.0), (8.0, 7.0)])


@pytest.mark.parametrize("text", ["11", "11x8x3", "axb", "11x8 9x9", "3x3", "nanx8", "10x30"])
def test_prints_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(CalibrationError, match="--prints"):
        parse_prints(text, len(MARKS))


@pytest.mark.parametrize("pad", [SCREEN, tuio.surface(400.0, 200.0)])
@pytest.mark.parametrize(
    "truth",
    [
        AffineMap(0.0, 0.9, 1.2, 0.0, 3.0, -2.0),  # mirrored, turned by a quarter, two scales
        AffineMap(-1.0, 0.0, 0.0, -1.0, 0.0, 0.0),  # upside down
        AffineMap.from_placement((5.0, 1.0), -30.0, (1.4, -0.7)),
    ],
)
def test_a_touchscreen_or_tracker_that_lies_anyhow_is_placed_by_four_marks(truth: AffineMap, pad: Pad) -> None:
    reports, touched = screen_touches(truth, MARKS, pad), TouchedMarks()
    decoder = Decoder(pad)
    for t_ns, data in reports:
        for frame in decoder.decode(data, t_ns):
            touched.update(frame)
    verdict = trackpad.verdict(fit_affine(touched.rests_mm, MARKS), {"source": pad.source}, is_simulated=False)
    assert verdict.outcome is Outcome.PASS
    config = from_table(
        {"trackpad": {**verdict.settings["trackpad"], "size_mm": [400, 200]}}, where="test", folder=None
    )
    placed_at = Decoder(pad, plate_from_pad(config))
    seen = [
        (frame.contacts[0].x_mm, frame.contacts[0].y_mm)
        for t_ns, data in reports
        for frame in placed_at.decode(data, t_ns)
        if frame.contacts
    ]
    assert all(min(math.dist(one, mark) for mark in MARKS) < 0.1 for one in seen)


def screen_touches(truth: AffineMap, marks_mm: Sequence[tuple[float, float]], pad: Pad) -> list[tuple[int, bytes]]:
    """A finger rests on each mark for 0.6 s, in the units of a device that lies so on the plate."""
    matrix = np.linalg.inv([[truth.xx, truth.xy], [truth.yx, truth.yy]])
    t_ns, found = 0, []
    for number, mark in enumerate(marks_mm):
        x_mm, y_mm = matrix @ (np.array(mark) - (truth.offset_x_mm, truth.offset_y_mm))
        for index in range(73):
            is_there = index < 72
            if pad.source == "tuio":
                place = (0.5 + x_mm / 400.0, 0.5 - y_mm / 200.0)
                data = tuio1(len(found) + 1, {number: place} if is_there else {})
            else:
                first = placed(0, round(2000 + 10 * x_mm), round(2000 - 20 * y_mm), number)
                data = packed(t_ns, *(lifted(0) if not is_there else [] if index else first), END)
            found.append((t_ns, data))
            t_ns += 8_333_333
    return found


def test_a_touchscreen_of_a_size_that_cannot_be_is_told_to_be_measured() -> None:
    fit = fit_affine([(x / 3, y / 3) for x, y in MARKS], MARKS)
    verdict = trackpad.verdict(fit, {"source": "evdev"}, is_simulated=False)
    assert verdict.outcome is Outcome.FAIL
    assert "trackpad.size_mm" in verdict.sentence


@pytest.mark.parametrize(
    "device",
    [
        {"source": "hid", "device": "mt1"},
        {"source": "evdev"},
        {"source": "evdev", "device": "wall", "size_mm": [344.0, 194.0]},
        {"source": "tuio", "tuio_sender": "192.168.7.20", "size_mm": [400.0, 200.0]},
    ],
)
def test_a_device_of_the_configuration_is_named_in_the_one_that_comes_of_it(
    device: dict[str, object], tmp_path: Path
) -> None:
    config = tmp_path / "hapticd.toml"
    config.write_text("[trackpad]\n" + "".join(f"{name} = {json.dumps(value)}\n" for name, value in device.items()))
    chosen = pads.chosen(options("--config", str(config)))
    assert pads.settings(chosen, "mt1") == device
    assert from_table({"trackpad": device}, where="test", folder=None).trackpad == chosen
    assert pads.chosen(options()) == TrackpadConfig(source="hid")
