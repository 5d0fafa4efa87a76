"""Detection of touched marks, the fitted map, and implausible placements."""

from __future__ import annotations

import argparse
import asyncio
import json
import math
from collections.abc import Callable, Sequence
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
from hapticd.sim.fingers.paths import Line, Rest, Touch
from hapticd.sim.fingers.paths import Path as FingerPath
from hapticd.sim.fingers.sensor import Report, SensorModel, SensorSettings
from hapticd.tools import pads
from hapticd.tools.calibrate import program, trackpad
from hapticd.tools.calibrate.marks import TouchedMarks, fit_affine
from hapticd.tools.calibrate.simulated import frames, touch_reports
from hapticd.tools.calibrate.step import Outcome, Verdict
from hapticd.tools.calibrate.trackpad import parse_marks
from hapticd.values import AffineMap, RawReport
from hapticd.wire.trackpad import DEFAULT_PAD, Decoder, Pad, tuio

Points = Sequence[tuple[float, float]]
MARKS = parse_marks("-50,-40 50,-40 50,40 -50,40")
SECOND = Rest((0, 0), 0.05)


def rests_mm(reports: Sequence[Report]) -> Points:
    """Where these reports touch a mark."""
    marks = TouchedMarks()
    for frame in frames(reports):
        marks.update(frame)
    return marks.rests_mm


def judged(pad_mm: Points, plate_mm: Points = MARKS, **of: str) -> Verdict:
    return trackpad.verdict(fit_affine(pad_mm, plate_mm), dict(of), is_simulated=False)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_pad_anywhere_is_found_to_a_twentieth_of_a_millimetre_and_so_configured(seed: int) -> None:
    random = np.random.default_rng(seed)
    truth = AffineMap.from_placement(
        tuple(random.uniform(-6, 6, 2)), float(random.uniform(-5, 5)), tuple(random.uniform(0.98, 1.02, 2))
    )
    touched_mm = rests_mm(touch_reports(MARKS, seed, SensorSettings(plate_from_pad=truth)))
    verdict = judged(touched_mm, source="sim")
    configured = plate_from_pad(from_table(dict(verdict.settings), where="x", folder=Path()))
    for corner in MARKS:
        assert math.dist(configured.apply(*corner), truth.apply(*corner)) < 0.05
    assert fit_affine(touched_mm, MARKS).left_out_rms_mm < 0.1
    assert verdict.outcome is Outcome.PASS


@pytest.mark.parametrize(
    ("pad_mm", "outcome", "sentence"),
    [
        ([MARKS[place] for place in (1, 0, 3, 2)], Outcome.FAIL, "mirrored"),
        ([MARKS[place] for place in (3, 2, 1, 0)], Outcome.FAIL, "mirrored"),
        ([MARKS[place] for place in (2, 3, 0, 1)], Outcome.WARN, "rotated by 180 degrees"),
        ([MARKS[place] for place in (1, 2, 3, 0)], Outcome.WARN, "degrees, as if x and y were swapped"),
        ([*MARKS, (0.0, 2.5)], Outcome.WARN, "mark 5 most"),
        ([*MARKS, (0.0, 12.0)], Outcome.FAIL, "touch them again"),
    ],
)
def test_implausible_or_disagreeing_touches_are_named(pad_mm: Points, outcome: Outcome, sentence: str) -> None:
    verdict = judged(pad_mm, [*MARKS, (0.0, 0.0)][: len(pad_mm)])
    assert verdict.outcome is outcome
    assert sentence in verdict.sentence


def test_left_out_residual_is_what_a_fit_without_that_mark_misses() -> None:
    random = np.random.default_rng(1)
    plate = random.uniform(-60, 60, (7, 2))
    pad = plate + random.normal(0, 0.5, plate.shape)
    whole = fit_affine(pad, plate)
    for place in range(7):
        others = np.delete(np.arange(7), place)
        one = fit_affine(pad[others], plate[others]).plate_from_pad.apply(*pad[place])
        assert whole.left_out_mm[place] == pytest.approx(math.dist(one, plate[place]))


@pytest.mark.parametrize(
    ("pad_mm", "sentence"),
    [
        (MARKS[:3], "4 marks or more"),
        ([(0, 0), (10, 10), (20, 20), (30, 30)], "touches lie close to one line"),
        ([*MARKS[:3], (math.nan, 0)], "no finite position"),
    ],
)
def test_touches_that_make_no_map_are_refused(pad_mm: Points, sentence: str) -> None:
    with pytest.raises(CalibrationError, match=sentence):
        fit_affine(pad_mm, MARKS[: len(pad_mm)])


@pytest.mark.parametrize(
    ("paths", "seconds", "count"),
    [
        ([Touch(SECOND, 0.0, 0.45)], 1.0, 0),
        ([Touch(SECOND, 0.0, 0.60)], 1.0, 1),
        ([Line((-40, 0), (40, 0), 20.0)], 3.0, 0),
        ([SECOND, Rest((4, 0), 0.05, 7)], 1.5, 0),
        ([SECOND, Rest((40, 0), 0.05, 7)], 1.5, 2),
        ([Touch(SECOND, 0.0, 2.0), Touch(Rest((1, 1), 0.05), 2.5, 4.0)], 4.0, 1),
    ],
    ids=["too short", "long enough", "moving", "beside another", "far from another", "a mark twice"],
)
def test_finger_that_rests_alone_for_half_a_second_touches_a_mark_once(
    paths: Sequence[FingerPath], seconds: float, count: int
) -> None:
    assert len(rests_mm(SensorModel(seed=3).reports(paths, seconds))) == count


@pytest.mark.parametrize(
    "text", ["", "1,2 3,4", "a,b c,d e,f g,h", "1,2,3 4,5 6,7 8,9", "0,0 1,0 50,50 -50,50", "nan,0 50,0 0,50 50,50"]
)
def test_marks_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(CalibrationError, match="--marks"):
        parse_marks(text)


class PlayedPad:
    """A pad that gives the reports of a simulated one in the loop's time."""

    def __init__(self, marks: Points) -> None:
        self.marks, self.is_closed = marks, False
        self.counters: dict[str, int | str] = {}

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

    def request_enable(self) -> None:
        raise AssertionError("it speaks multitouch")

    async def close(self) -> None:
        self.is_closed = True


def test_each_mark_is_prompted_until_all_are_touched_or_time_is_over(capsys: pytest.CaptureFixture[str]) -> None:
    pad = PlayedPad(MARKS)
    found, touched_mm = in_virtual_time(trackpad.touch_marks(pad, MARKS, 60.0))
    assert found is DEFAULT_PAD
    assert pad.is_closed
    np.testing.assert_allclose(touched_mm, MARKS, atol=0.05)
    output = capsys.readouterr().out
    assert [f"touch mark {place} of 4" in output for place in (1, 2, 3, 4, 5)] == [True] * 4 + [False]
    pad = PlayedPad(MARKS[:2])
    with pytest.raises(CalibrationError, match="2 of 4 marks were touched in 5 s"):
        in_virtual_time(trackpad.touch_marks(pad, MARKS, 5.0))
    assert pad.is_closed


@pytest.mark.parametrize("pad", [SCREEN, tuio.surface(400.0, 200.0)])
@pytest.mark.parametrize(
    "truth",
    [
        AffineMap(0.0, 0.9, 1.2, 0.0, 3.0, -2.0),  # mirrored, turned by a quarter, two scales
        AffineMap(-1.0, 0.0, 0.0, -1.0, 0.0, 0.0),  # upside down
        AffineMap.from_placement((5.0, 1.0), -30.0, (1.4, -0.7)),
    ],
)
def test_touchscreen_or_tracker_that_lies_anyhow_is_placed_by_four_marks(truth: AffineMap, pad: Pad) -> None:
    reports, touched = screen_touches(truth, MARKS, pad), TouchedMarks()
    decoder = Decoder(pad)
    for t_ns, data in reports:
        for frame in decoder.decode(data, t_ns):
            touched.update(frame)
    verdict = judged(touched.rests_mm, source=pad.source)
    assert verdict.outcome is Outcome.PASS
    table = {"trackpad": {**verdict.settings["trackpad"], "size_mm": [400, 200]}}
    placed_at = Decoder(pad, plate_from_pad(from_table(table, where="test", folder=None)))
    seen = [frame.contacts[0] for t_ns, data in reports for frame in placed_at.decode(data, t_ns) if frame.contacts]
    assert all(min(math.dist((one.x_mm, one.y_mm), mark) for mark in MARKS) < 0.1 for one in seen)


def screen_touches(truth: AffineMap, marks_mm: Points, pad: Pad) -> list[tuple[int, bytes]]:
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


def test_touchscreen_of_an_impossible_size_is_to_be_measured() -> None:
    verdict = judged([(x / 3, y / 3) for x, y in MARKS], source="evdev")
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
def test_device_of_the_configuration_is_named_in_the_resulting_one(device: dict[str, object], tmp_path: Path) -> None:
    config, parser = tmp_path / "hapticd.toml", argparse.ArgumentParser()
    program.add_arguments(parser)
    config.write_text("[trackpad]\n" + "".join(f"{name} = {json.dumps(value)}\n" for name, value in device.items()))
    chosen = pads.chosen(parser.parse_args(["trackpad", "--config", str(config)]))
    assert pads.settings(chosen, "mt1") == device
    assert from_table({"trackpad": device}, where="test", folder=None).trackpad == chosen
    assert pads.chosen(parser.parse_args(["trackpad"])) == TrackpadConfig(source="hid")
