"""A TUIO tracker as a source, on loopback."""

from __future__ import annotations

import socket

import pytest
from asynchronous import asynchronous, until
from datagrams import tuio1, tuio2
from listener import Listener

from hapticd.io.devices import tuio_trackpad
from hapticd.io.devices.tuio_trackpad import TuioTrackpad
from hapticd.wire.trackpad import Decoder, tuio

PAD = tuio.surface(400.0, 200.0)


@pytest.fixture
def free() -> str:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{one.getsockname()[1]}"


def sender(address: str) -> socket.socket:
    endpoint = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    host, _, port = address.rpartition(":")
    endpoint.connect((host, int(port)))
    return endpoint


@asynchronous
async def test_a_trackers_frames_are_reports_and_other_datagrams_go_no_further(free: str) -> None:
    listener, source = Listener(), TuioTrackpad(free, PAD)
    listener.listen(source)
    await listener.until(lambda: bool(listener.links))
    assert listener.links == [(PAD, f"TUIO tracker at {free}")]
    sent = [tuio1(1, {1: (0.5, 0.5)}), tuio2(2, 0, {1: (0.5, 0.5)}), tuio1(3, {})]
    with sender(free) as tracker:
        for data in (b"hello", sent[0], bytes(3000), sent[2]):
            tracker.send(data)
        await listener.until(lambda: len(listener.reports) >= 2)
    source.request_enable()
    await source.close()
    assert [one.data for one in listener.reports if one.data in sent] == [sent[0], sent[2]]


@asynchronous
async def test_a_contact_that_lies_still_is_repeated_for_as_long_as_a_tracker_may_be_silent(free: str) -> None:
    listener, source = Listener(), TuioTrackpad(free, PAD)
    listener.listen(source)
    await listener.until(lambda: bool(listener.links))
    with sender(free) as tracker:
        tracker.send(tuio1(1, {1: (0.5, 0.5)}))
        await listener.until(lambda: len(listener.reports) >= 4)
        decoder = Decoder(PAD)
        frames = [frame for one in listener.reports for frame in decoder.decode(one.data, one.t_host_ns)]
        assert all(len(frame.contacts) == 1 for frame in frames)
        assert sorted({frame.t_ns for frame in frames}) == [frame.t_ns for frame in frames]
    assert source._still._longest_rest_ns == 2_500_000_000
    await source.close()


@asynchronous
async def test_datagrams_beyond_the_time_budget_are_left_out_and_counted(
    free: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tuio_trackpad, "BURST_NS", 1)
    listener, source = Listener(), TuioTrackpad(free, PAD, clock_ns=lambda: 1)  # no time passes
    listener.listen(source)
    await listener.until(lambda: bool(listener.links))
    with sender(free) as tracker:
        for number in range(10):
            tracker.send(tuio1(number, {}))
        await until(lambda: source.left_out == 9)
    assert len(listener.reports) == 1
    await source.close()


@asynchronous
async def test_an_address_that_is_taken_is_one_line_and_is_tried_again(
    free: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tuio_trackpad, "_RETRY_S", 0.0)
    listener, source = Listener(), TuioTrackpad(free, PAD)
    host, _, port = free.rpartition(":")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind((host, int(port)))
        listener.listen(source)
        await listener.until(lambda: bool(listener.links))
    await listener.until(lambda: len(listener.links) == 2)
    assert listener.links[0] == (
        None,
        f"{free} cannot be bound (Address already in use): does another program listen there?",
    )
    assert listener.links[1] == (PAD, f"TUIO tracker at {free}")
    await source.close()
