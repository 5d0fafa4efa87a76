"""The simulated trackpad: what it sends decodes to what the fingers did, within its stated errors."""

from __future__ import annotations

import math
from itertools import islice

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.sim.fingers.pad_noise import PadNoise
from hapticd.sim.fingers.paths import Circle, Path, Rest, Touch, Touches, strokes_pair
from hapticd.sim.fingers.sensor import Record, Report, SensorModel, SensorSettings, encode_mt1, encode_mt2
from hapticd.values import AffineMap, TouchFrame
from hapticd.wire.trackpad import GEOMETRY, MODELS, Decoder

QUIET = {"noise": PadNoise(0.0), "stamp_jitter_ms": 0.0}
QUANTUM_MM = 0.5 / 44.0  # half a unit of the coarser axis


def decoded(reports: list[Report], settings: SensorSettings) -> list[TouchFrame]:
    decoder = Decoder(settings.model, settings.plate_from_pad)
    frames = [frame for r in reports for frame in decoder.decode(r.data, round(r.t_arrive_s * 1e9))]
    refused = {name: n for name, n in decoder.counters.items() if n and name != "frames"}
    assert refused == {}
    return frames


RECORDS = st.lists(
    st.builds(
        Record,
        contact_id=st.integers(0, 15),
        x=st.integers(-4096, 4095),
        y=st.integers(-4096, 4095),
        state=st.integers(0, 7),
        major=st.integers(0, 255),
        minor=st.integers(0, 255),
        size=st.integers(0, 63),
        pressure=st.integers(0, 255),
        orientation=st.integers(0, 7),
        finger=st.integers(0, 7),
    ),
    max_size=15,
    unique_by=lambda record: record.contact_id,
)


@given(st.sampled_from(MODELS), RECORDS, st.booleans(), st.integers(0, 2**22))
@settings(deadline=None, max_examples=80)
def test_what_is_encoded_is_decoded(model: str, records: list[Record], button: bool, t_ms: int) -> None:
    if model == "mt1":
        report = encode_mt1(t_ms, records, button=button)
    else:
        report = encode_mt2(t_ms, records, usb=model.endswith("-usb"), button=button)
    (frame,) = Decoder(model).decode(report, 0)
    units = sum(GEOMETRY[model].units_per_mm) / 2
    orientations = 64 if model == "mt1" else 8
    back = [
        (c.contact_id, c.raw_x, c.raw_y, c.state, c.major_mm * units / 4, c.minor_mm * units / 4, c.angle_rad)
        for c in frame.contacts
    ]
    sent = [(r[0], r[1], r[2], r[3], r.major, r.minor, r.orientation * math.pi / orientations) for r in records]
    assert len(back) == len(sent)
    for got, expected in zip(back, sent, strict=True):
        assert got == pytest.approx(expected, abs=1e-9)
    pressure = [r.size / 63 if model == "mt1" else min(r.pressure / 253, 1.0) for r in records]
    assert [c.pressure_frac for c in frame.contacts] == pytest.approx(pressure)
    assert frame.button is button


@pytest.mark.parametrize("change", [{"x": 4096}, {"y": -4097}, {"contact_id": 16}, {"state": 8}, {"orientation": 8}])
def test_a_record_that_does_not_fit_is_refused(change: dict[str, int]) -> None:
    with pytest.raises(ValueError, match=next(iter(change))):
        encode_mt2(0, [Record(1, 0, 0)._replace(**change)], usb=True)


def test_more_than_fifteen_contacts_are_refused() -> None:
    with pytest.raises(ValueError, match="15"):
        encode_mt1(0, [Record(1, 0, 0)] * 16)
    with pytest.raises(ValueError, match="15"):
        SensorModel().scans([Rest((0.0, 0.0))] * 16)


@pytest.mark.parametrize("model", MODELS)
def test_positions_come_back_within_half_a_unit_wherever_the_pad_lies(model: str) -> None:
    placement = AffineMap.from_placement((3.0, -2.0), 8.0, (1.02, 0.98))
    settings = SensorSettings(model, **QUIET, plate_from_pad=placement)
    paths = [Circle((-20.0, 5.0), 25.0, 200.0), Circle((25.0, -5.0), 20.0, -150.0)]
    reports = SensorModel(settings, 3).reports(paths, 2.0)
    frames = decoded(reports, settings)
    assert len(frames) == len(reports) == pytest.approx(2.0 / 0.01125, abs=1)
    for report, frame in zip(reports, frames, strict=True):
        for path, contact in zip(paths, frame.contacts, strict=True):
            (true_mm,) = path.position_mm(np.array([report.t_sample_s]))
            assert math.dist(true_mm, (contact.x_mm, contact.y_mm)) <= 1.02 * math.sqrt(2) * QUANTUM_MM
            assert contact.touching


def test_noise_and_stamp_jitter_are_as_large_as_stated() -> None:
    settings = SensorSettings(noise=PadNoise(0.05))
    reports = SensorModel(settings, 1).reports([Rest((10.0, -10.0))], 60.0)
    frames = decoded(reports, settings)
    x_mm, y_mm = np.array([(f.contacts[0].x_mm, f.contacts[0].y_mm) for f in frames]).T
    for axis_mm, true_mm in ((x_mm, 10.0), (y_mm, -10.0)):
        assert axis_mm.std() == pytest.approx(math.hypot(0.05, 1 / 46 / math.sqrt(12)), rel=0.05)
        assert axis_mm.mean() == pytest.approx(true_mm, abs=0.005)
    stamp_error_ms = np.array([f.t_ns * 1e-6 - r.t_sample_s * 1e3 for f, r in zip(frames, reports, strict=True)])
    stamp_error_ms -= stamp_error_ms.mean()
    assert stamp_error_ms.std() == pytest.approx(math.sqrt(1 / 3 + 1 / 12), rel=0.05)
    assert np.ptp(stamp_error_ms) <= 3.0


def reported_mm(path: Path, seconds: float, noise: PadNoise) -> np.ndarray:  # type: ignore[type-arg]
    settings = SensorSettings(stamp_jitter_ms=0.0, noise=noise)
    frames = decoded(SensorModel(settings, 1).reports([path], seconds), settings)
    return np.array([(frame.contacts[0].x_mm, frame.contacts[0].y_mm) for frame in frames])


@pytest.mark.parametrize("correlation", [0.0, 0.65, 0.9])
def test_filtered_noise_is_as_large_as_white_noise_and_correlated(correlation: float) -> None:
    x_mm = reported_mm(Rest((10.0, -10.0)), 60.0, PadNoise(0.1, correlation))[:, 0] - 10.0
    assert x_mm.std() == pytest.approx(0.1, rel=0.1)
    assert np.mean(x_mm[1:] * x_mm[:-1]) / np.mean(x_mm**2) == pytest.approx(correlation, abs=0.06)


def test_a_time_error_shifts_positions_along_the_way_alone() -> None:
    circle = Circle((0.0, 0.0), 30.0, 200.0)
    errors_mm = reported_mm(circle, 60.0, PadNoise(0.0, time_error_ms=0.8))
    radius_mm = np.hypot(*errors_mm.T)
    angle_rad = np.unwrap(np.arctan2(errors_mm[:, 1], errors_mm[:, 0]))
    places = np.arange(len(angle_rad))
    along_mm = 30.0 * (angle_rad - np.polyval(np.polyfit(places, angle_rad, 1), places))
    assert radius_mm.std() < QUANTUM_MM
    assert along_mm.std() == pytest.approx(0.8e-3 * 200.0, rel=0.2)


def test_a_pad_that_holds_repeats_the_report_of_a_resting_finger_and_follows_a_moving_one() -> None:
    resting = reported_mm(Rest((10.0, -10.0)), 20.0, PadNoise(0.01, hold_mm=0.1))
    assert np.mean(np.all(np.diff(resting, axis=0) == 0.0, axis=1)) > 0.95
    circle = Circle((0.0, 0.0), 30.0, 100.0)
    moving, free = (reported_mm(circle, 5.0, PadNoise(0.0, hold_mm=hold_mm)) for hold_mm in (0.1, 0.0))
    assert np.hypot(*(moving - free).T).max() < 0.1 + 2.0 * QUANTUM_MM


def test_reports_arrive_a_latency_after_they_were_sampled_at_88_9_hz() -> None:
    reports = SensorModel(SensorSettings(latency_s=0.013)).reports([Rest((0.0, 0.0))], 5.0)
    np.testing.assert_allclose([r.t_arrive_s - r.t_sample_s for r in reports], 0.013)
    np.testing.assert_allclose(np.diff([r.t_sample_s for r in reports]), 0.01125)


def test_the_device_clock_wraps_early_or_starts_as_configured() -> None:
    def stamps_ms(settings: SensorSettings, seed: int) -> list[int]:
        reports = SensorModel(settings, seed).reports([Rest((0.0, 0.0))], 11.0)
        return [r.data[9] >> 3 | r.data[10] << 5 | r.data[11] << 13 for r in reports]

    for seed in range(5):
        assert min(np.diff(stamps_ms(SensorSettings(), seed))) < -(2**20)
    assert stamps_ms(SensorSettings(**QUIET, t_device_start_ms=1000), 0)[0] in range(1000, 1012)


def contacts_of(paths: list[Path], model: str = "mt2-usb", t_end_s: float = 10.0) -> list[list[tuple[int, int, bool]]]:
    settings = SensorSettings(model, **QUIET)
    frames = decoded(SensorModel(settings).reports(paths, t_end_s), settings)
    return [[(c.contact_id, c.state, c.touching) for c in frame.contacts] for frame in frames]


def test_a_contact_ends_with_state_7_then_0_then_an_empty_frame_and_then_the_pad_is_silent() -> None:
    assert contacts_of([Touch(Rest((0.0, 0.0)), 1.0, 1.04)])[-5:] == [
        [(1, 4, True)],
        [(1, 4, True)],
        [(1, 7, False)],
        [(1, 0, False)],
        [],
    ]


def test_an_mt1_contact_starts_with_state_3_and_ends_only_with_0() -> None:
    frames = contacts_of([Touch(Rest((0.0, 0.0)), 1.0, 1.03)], "mt1")
    assert frames[0] == [(1, 3, True)]
    assert frames[-4:] == [[(1, 4, True)], [(1, 7, True)], [(1, 0, False)], []]


def test_an_id_is_used_again_once_its_contact_has_ended_and_not_before() -> None:
    first = Touches((Touch(Rest((0.0, 0.0)), 0.0, 0.5), Touch(Rest((30.0, 0.0)), 0.51, 1.0)))
    second = Touch(Rest((-30.0, 0.0)), 0.7, 1.2)
    ids_down = [{i for i, _, touching in frame if touching} for frame in contacts_of([first, second])]
    in_turn = [ids for ids, before in zip(ids_down, [None, *ids_down], strict=False) if ids != before]
    assert in_turn == [{1}, set(), {2}, {1, 2}, {1}, set()]


def test_a_finger_outside_the_pad_is_not_sensed() -> None:
    frames = contacts_of([Rest((0.0, 61.0)), Rest((0.0, 59.0))], t_end_s=0.1)
    assert frames
    assert all(len(frame) == 1 for frame in frames)


def test_lost_and_duplicated_reports_come_as_often_as_stated() -> None:
    paths = list(strokes_pair(2))
    plain = SensorModel(SensorSettings(), 4).reports(paths, 60.0)
    faulty = SensorModel(SensorSettings(lost_frac=0.1, duplicate_frac=0.2), 4).reports(paths, 60.0)
    distinct = dict.fromkeys(report.data for report in faulty)
    assert len(distinct) / len(plain) == pytest.approx(0.9, abs=0.02)
    assert (len(faulty) - len(distinct)) / len(plain) == pytest.approx(0.18, abs=0.02)
    assert set(distinct) <= {report.data for report in plain}


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others() -> None:
    paths = list(strokes_pair(1))
    first, again, other = (SensorModel(seed=seed).reports(paths, 3.0) for seed in (5, 5, 6))
    assert first == again
    assert {r.data for r in first}.isdisjoint(r.data for r in other)


def test_more_reports_go_on_where_fewer_end() -> None:
    paths = list(strokes_pair(1))
    sensor = SensorModel(seed=7)
    reports, more = sensor.reports(paths, 3.0), sensor.reports(paths, 4.5)
    assert more[: len(reports)] == reports
    assert len(more) > len(reports) + 100
    times = [report.t_arrive_s for report in more]
    assert times == sorted(times)


def test_scans_continue_without_touch() -> None:
    scans = list(islice(SensorModel().scans([]), 200))
    np.testing.assert_allclose(np.diff([scan.t_sample_s for scan in scans]), 0.01125)
    assert not any(scan.reports for scan in scans)


def test_bad_settings_are_refused() -> None:
    with pytest.raises(ValueError, match="mt2-usb"):
        SensorModel(SensorSettings("mt9"))
    with pytest.raises(ValueError, match="Singular"):
        SensorModel(SensorSettings(plate_from_pad=AffineMap(0.0, 0.0, 0.0, 0.0)))
