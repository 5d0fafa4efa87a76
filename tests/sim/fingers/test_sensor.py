"""The simulated trackpad: what it sends decodes to what the fingers did, within its stated errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.sim.fingers.pad_noise import PadNoise
from hapticd.sim.fingers.paths import CirclePath, Path, Rest, Touch
from hapticd.sim.fingers.sensor import PadRecord, Report, SensorModel, SensorSettings, encode_mt2
from hapticd.values import AffineMap, TouchFrame
from hapticd.wire.trackpad import PADS, Decoder

MODELS = ("mt2-usb", "mt2-bt")
QUIET = {"noise": PadNoise(0.0), "stamp_jitter_ms": 0.0}
QUANTUM_MM = 0.5 / 44.0  # half a unit of the coarser axis


def decoded(reports: list[Report], settings: SensorSettings) -> list[TouchFrame]:
    decoder = Decoder(settings.pad, settings.plate_from_pad)
    frames = [frame for r in reports for frame in decoder.decode(r.data, round(r.t_arrive_s * 1e9))]
    refused = {name: n for name, n in decoder.counters.items() if n and name != "frames"}
    assert refused == {}
    return frames


RECORDS = st.lists(
    st.builds(
        PadRecord,
        contact_id=st.integers(0, 15),
        x=st.integers(-3200, 3200),  # on each of the pads, or a little beyond
        y=st.integers(-2700, 2700),
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


@given(st.sampled_from(MODELS), RECORDS, st.integers(0, 2**22))
@settings(deadline=None, max_examples=40)
def test_what_is_encoded_is_decoded(model: str, records: list[PadRecord], t_ms: int) -> None:
    (frame,) = Decoder(model).decode(encode_mt2(t_ms, records, usb=model == "mt2-usb"), 0)
    mm = 4 / (sum(PADS[model].geometry.units_per_mm) / 2)
    for contact, record in zip(frame.contacts, records, strict=True):
        assert (contact.contact_id, contact.raw_x, contact.raw_y, contact.state) == record[:4]
        shape = contact.major_mm, contact.minor_mm, contact.angle_rad, contact.pressure_frac
        expected = record.major * mm, record.minor * mm, record.orientation * math.pi / 8, record.pressure / 253
        assert shape == pytest.approx((*expected[:3], min(expected[3], 1.0)), abs=1e-9)


def test_more_than_fifteen_contacts_are_refused() -> None:
    with pytest.raises(ValueError, match="15"):
        next(SensorModel().scans([Rest((0.0, 0.0))] * 16))


@pytest.mark.parametrize("model", MODELS)
def test_positions_come_back_within_half_a_unit_wherever_the_pad_lies(model: str) -> None:
    placement = AffineMap.from_placement((3.0, -2.0), 8.0, (1.02, 0.98))
    settings = SensorSettings(PADS[model], **QUIET, plate_from_pad=placement)
    paths = [CirclePath((-20.0, 5.0), 25.0, 200.0), CirclePath((25.0, -5.0), 20.0, -150.0)]
    reports = SensorModel(settings, 3).reports(paths, 2.0)
    frames = decoded(reports, settings)
    assert len(frames) == len(reports) == pytest.approx(2.0 / 0.01125, abs=1)
    for report, frame in zip(reports, frames, strict=True):
        for path, contact in zip(paths, frame.contacts, strict=True):
            (true_mm,) = path.position_mm(np.array([report.t_sample_s]))
            assert math.dist(true_mm, (contact.x_mm, contact.y_mm)) <= 1.02 * math.sqrt(2) * QUANTUM_MM
            assert contact.touching


def contacts_of(paths: list[Path]) -> list[list[tuple[int, int, bool]]]:
    settings = SensorSettings(PADS["mt2-usb"], **QUIET)
    frames = decoded(SensorModel(settings).reports(paths, 10.0), settings)
    return [[(c.contact_id, c.state, c.touching) for c in frame.contacts] for frame in frames]


def test_a_contact_ends_with_state_7_0_an_empty_frame_and_silence() -> None:
    assert contacts_of([Touch(Rest((0.0, 0.0)), 1.0, 1.04)])[-5:] == [
        [(1, 4, True)],
        [(1, 4, True)],
        [(1, 7, False)],
        [(1, 0, False)],
        [],
    ]


def test_bad_settings_are_refused() -> None:
    with pytest.raises(ValueError, match="mt2-usb"):
        SensorModel(SensorSettings(PADS["mt1"]))
    with pytest.raises(ValueError, match="Singular"):
        SensorModel(SensorSettings(plate_from_pad=AffineMap(0.0, 0.0, 0.0, 0.0)))
