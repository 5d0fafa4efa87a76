"""The ellipse of a contact: true sizes from the pad's, whatever it reports, and as still as the finger."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.prediction.motion import AdaptivePredictor
from hapticd.core.touch.contact_ellipse import LEAST_MM, MOST_MM, PLAY_MM, ContactTracker, EllipseScale
from hapticd.core.touch.fingers import Fingers
from hapticd.sim.fingers.fingertip import Fingertip
from hapticd.sim.fingers.pad_ellipse import USUAL
from hapticd.sim.fingers.paths import Path, Rest
from hapticd.sim.fingers.sensor import SensorModel
from hapticd.values import Contact, TouchFrame
from hapticd.wire.trackpad import DEFAULT_PAD, Decoder

MS = 1_000_000
AS_REPORTED = EllipseScale(1.0, 0.0)
PAD = EllipseScale(USUAL.scale, USUAL.offset_mm)
ANY = st.floats(allow_nan=True, allow_infinity=True) | st.sampled_from((0.0, -1.0, 1e-300, 1e300, math.inf, math.nan))
AXES = st.floats(0.1, 30.0)
ANGLES = st.floats(-10.0, 10.0)


def matrix_of(major_mm: float, minor_mm: float, angle_rad: float, scale: EllipseScale = AS_REPORTED) -> np.ndarray:  # type: ignore[type-arg]
    """The matrix of a first report."""
    contact = ContactTracker(scale)
    contact.update(major_mm, minor_mm, angle_rad)
    assert contact.ellipse is not None
    xx, xy, yy = contact.ellipse
    return np.array(((xx, xy), (xy, yy)))


def test_an_ellipse_s_axes_and_angle_are_those_of_its_matrix() -> None:
    values, vectors = np.linalg.eigh(matrix_of(11.0, 8.0, 0.4))
    assert values == pytest.approx([4.0, 5.5])
    assert abs(vectors[:, 1] @ (math.cos(0.4), math.sin(0.4))) == pytest.approx(1.0)
    assert matrix_of(10.0, 10.0, 1.3) == pytest.approx(5.0 * np.eye(2))
    assert np.linalg.eigvalsh(matrix_of(8.0, 6.0, 0.4, EllipseScale(1.2, 0.6))) == pytest.approx([3.9, 5.1])


@given(ANY, ANY, ANY, st.lists(st.tuples(AXES, AXES, ANGLES), max_size=5))
def test_whatever_a_pad_reports_an_ellipse_is_finite_and_within_the_bounds(
    major_mm: float, minor_mm: float, angle_rad: float, others: list[tuple[float, float, float]]
) -> None:
    contact = ContactTracker(PAD)
    for report in (*others, (major_mm, minor_mm, angle_rad), *others):
        contact.update(*report)
    is_ellipse = major_mm > 0.0 and minor_mm > 0.0
    assert (contact.ellipse is not None) == (is_ellipse or bool(others))
    if contact.ellipse is not None:
        xx, xy, yy = contact.ellipse
        values = np.linalg.eigvalsh(((xx, xy), (xy, yy)))
        assert LEAST_MM - 1e-9 <= values[0] <= values[1] <= MOST_MM + 1e-9


@pytest.mark.parametrize("report", [(0.0, 0.0, 0.0), (math.nan, 8.0, 0.0), (8.0, -1.0, 0.0)])
def test_what_is_no_ellipse_leaves_the_ellipse_as_it_was(report: tuple[float, float, float]) -> None:
    contact = ContactTracker(AS_REPORTED)
    contact.update(*report)
    assert contact.ellipse is None
    contact.update(11.0, 8.0, 0.4)
    before = contact.ellipse
    contact.update(*report)
    assert contact.ellipse == before


@given(AXES, AXES, ANGLES, st.floats(-1e-6, 1e-6), st.floats(-1e-6, 1e-6), st.floats(-1e-6, 1e-6))
def test_an_ellipse_is_continuous_in_axes_and_angle(
    major_mm: float, minor_mm: float, angle_rad: float, more_mm: float, longer_mm: float, turn_rad: float
) -> None:
    here = matrix_of(major_mm, minor_mm, angle_rad)
    there = matrix_of(major_mm + more_mm, minor_mm + longer_mm, angle_rad + turn_rad)
    assert np.abs(there - here).max() <= 2e-5


def test_an_ellipse_follows_a_harder_press_within_five_reports_without_a_step() -> None:
    contact = ContactTracker(AS_REPORTED)
    contact.update(8.0, 8.0, 0.0)
    found = []
    for _ in range(12):
        contact.update(13.0, 13.0, 0.0)
        assert contact.ellipse is not None
        found.append(contact.ellipse[0])
    assert found == sorted(found)
    assert found[4] > 6.5 - PLAY_MM - 0.1
    assert found[-1] == pytest.approx(6.5 - PLAY_MM, abs=0.01)


def sensed(path: Path, tip: Fingertip, seed: int) -> list[Contact]:
    decoder = Decoder(DEFAULT_PAD)
    return [
        contact
        for report in SensorModel(seed=seed).reports([path], 10.0, [tip])
        for frame in decoder.decode(report.data, round(report.t_arrive_s * 1e9))
        for contact in frame.contacts
    ]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_under_a_resting_finger_the_ellipse_stays_to_the_last_bit_for_seconds(seed: int) -> None:
    contact, ellipses = ContactTracker(PAD), []
    for one in sensed(Rest((3.0 * seed, 2.0), 0.05, seed), Fingertip(5.5, 4.0, 0.7), seed):
        contact.update(one.major_mm, one.minor_mm, one.angle_rad)
        ellipses.append(contact.ellipse)
    changes = sum(ellipse != before for ellipse, before in zip(ellipses[1:], ellipses, strict=False))
    assert changes <= 0.01 * len(ellipses)
    assert len({one.major_mm for one in sensed(Rest((3.0, 2.0)), Fingertip(), 1)}) > 5  # what it is hidden from


def frame(t_ns: int, major_mm: float) -> TouchFrame:
    return TouchFrame(t_ns, (Contact(1, 0.0, 0.0, major_mm, 7.0, 0.0, 0.5, True, 4, 0, 0),), False)


def test_only_fingers_of_a_calibrated_pad_have_ellipses_and_a_new_finger_has_its_own() -> None:
    plain = Fingers(AdaptivePredictor, sensor_latency_ns=0, silence_ns=40 * MS)
    pad = Fingers(AdaptivePredictor, sensor_latency_ns=0, silence_ns=40 * MS, ellipse_scale=AS_REPORTED)
    for fingers in (plain, pad):
        fingers.touch(frame(1000 * MS, 9.0), 1000 * MS)
    assert plain.ellipses([1, "virtual"]) is None
    assert pad.ellipses([1, "virtual"]) == [(4.5, 0.0, 3.5), None]
    pad.touch(TouchFrame(1011 * MS, (), False), 1011 * MS)
    pad.touch(frame(1022 * MS, 12.0), 1022 * MS)
    assert pad.ellipses([2]) == [(6.0, 0.0, 3.5)]
    pad.lift_all()
    pad.touch(frame(1033 * MS, 0.0), 1033 * MS)
    assert pad.ellipses([3]) == [None]
