"""Lab Streaming Layer: names and units of the channels, and samples at the daemon's own time."""

from __future__ import annotations

import importlib
import math

import pytest
from tools.stream.daemon_states import finger, plate_state
from tools.stream.fake_lsl import FakeLsl

from hapticd.tools.stream import lsl
from hapticd_client import Marker


def test_each_stream_describes_all_its_channels_with_their_units() -> None:
    fake = FakeLsl()
    lsl.Outlets(fake, "here", fingers=2, modes=2, clock_offset_s=0.0)
    assert {name: info.kind for name, info in fake.infos.items()} == {
        "hapticd-fingers": "MoCap",
        "hapticd-modes": "Haptics",
        "hapticd-markers": "Markers",
    }
    for name, info in fake.infos.items():
        assert info.source == f"{name.replace('-', ':')}:here"  # by which a recorder finds the stream again
        (channels,) = info.description.children
        assert len(channels.children) == info.channels
        assert info.rate_hz == 0.0
    described = [channel.values for channel in fake.infos["hapticd-fingers"].description.children[0].children]
    assert described[1] == {"label": "finger_1_x_mm", "unit": "millimeters", "type": "PositionX"}
    assert described[5] == {"label": "finger_1_target_um", "unit": "micrometers", "type": "Amplitude"}
    assert fake.infos["hapticd-markers"].form == "string"


def test_samples_fit_their_channels_and_carry_the_daemon_s_time() -> None:
    fake = FakeLsl()
    outlets = lsl.Outlets(fake, "here", fingers=2, modes=2, clock_offset_s=100.0)
    outlets.push(plate_state(finger(4, -3.0, target_um=1.0), markers=(Marker(4_990_000_000, "study", "trial 1"),)))
    ((values, t_s),) = fake.pushed["hapticd-fingers"]
    assert len(values) == fake.infos["hapticd-fingers"].channels
    assert values[:3] == [4.0, -3.0, 2.0]
    assert values[5] == 1.0
    assert all(map(math.isnan, values[7:]))
    assert t_s == pytest.approx(105.01)
    assert fake.pushed["hapticd-modes"] == [([1.5, 0.0, 1.25, 0.5, -0.5, 0.25, -0.5, 0.0], t_s)]
    assert fake.pushed["hapticd-markers"] == [(["study: trial 1"], pytest.approx(104.99))]


def test_liblsl_takes_the_outlets_as_they_are() -> None:
    try:
        pylsl = importlib.import_module("pylsl")
    except (ImportError, RuntimeError, OSError) as error:
        pytest.skip(f"pylsl with its liblsl cannot be loaded: {error}")
    fake = FakeLsl()
    _, outlets = [lsl.Outlets(one, "test", fingers=1, modes=2, clock_offset_s=0.0) for one in (fake, pylsl)]
    outlets.push(plate_state(finger(4, -3.0), markers=(Marker(1, "study", "trial 1"),)))
    info = outlets._fingers.get_info()
    described = (info.name(), info.type(), info.channel_count(), info.nominal_srate())
    assert described == ("hapticd-fingers", "MoCap", fake.infos["hapticd-fingers"].channels, 0.0)
    assert "<unit>millimeters</unit>" in info.as_xml()
