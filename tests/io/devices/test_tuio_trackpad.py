"""A TUIO tracker as a source, on loopback."""

from __future__ import annotations

import socket

import pytest
from asynchronous import asynchronous, until
from datagrams import bundle, message, tuio1
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
async def test_a_still_contact_is_repeated_while_a_tracker_may_be_silent(free: str) -> None:
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
        for number in range(1, 11):
            tracker.send(tuio1(number, {}))
        await until(lambda: source.counters["left_out"] == 8)
    assert len(listener.reports) == 2  # one as of any sender, then one as of the tracker
    await source.close()


EXPENSIVE = bundle(*[message("/tuio/2Dcur", "set", *[10**18] * 31, times=range(1, 32)) for _ in range(13)])
OF_OTHERS = {
    "expensive": EXPENSIVE,
    "of another name": tuio1(5, {9: (0.1, 0.1)}, source="other"),
    "of the same name": tuio1(5, {9: (0.1, 0.1)}),
    "of one message": message("/tuio/2Dcur", "alive"),
}


@pytest.mark.parametrize("kind", OF_OTHERS)
@asynchronous
async def test_while_a_tracker_sends_other_sockets_do_not_count(
    free: str, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tuio_trackpad, "BURST_NS", 1_000_000_000)  # a garbage collection may fall into it
    listener, source = Listener(), TuioTrackpad(free, PAD)
    listener.listen(source)
    await listener.until(lambda: bool(listener.links))
    sent = [tuio1(number, {1: (0.5, 0.5)}) for number in range(1, 31)]
    with sender(free) as tracker, sender(free) as other:
        for data in sent[:2]:
            tracker.send(data)
        await listener.until(lambda: len(listener.reports) >= 2)
        for data in sent[2:]:
            other.send(OF_OTHERS[kind])
            tracker.send(data)
            await until(lambda: any(one.data == data for one in listener.reports))  # noqa: B023 - awaited here
    await source.close()
    assert [one.data for one in listener.reports if one.data != tuio.REPEAT] == sent
    assert (source.counters["other_sender"], source.counters["left_out"]) == (28, 0)


@asynchronous
async def test_messages_alone_are_one_batch_also_where_each_comes_from_a_new_socket(free: str) -> None:
    listener, source = Listener(), TuioTrackpad(free, PAD)
    listener.listen(source)
    await listener.until(lambda: bool(listener.links))
    alone = [
        message("/tuio/2Dcur", "alive", 7),
        message("/tuio/2Dcur", "set", 7, 0.5, 0.5),
        message("/tuio/2Dcur", "fseq", 1),
    ]
    for data in alone:
        with sender(free) as tracker:
            tracker.send(data)
    await listener.until(lambda: len(listener.reports) >= 3)
    await source.close()
    assert [one.data for one in listener.reports[:3]] == alone
    assert (source.counters["frames"], source.counters["contacts"]) == (1, 1)


@pytest.mark.parametrize(("configured", "is_taken"), [("", True), ("127.0.0.1", True), ("192.0.2.1", False)])
@asynchronous
async def test_only_the_configured_address_may_send(free: str, configured: str, is_taken: bool) -> None:
    listener, source = Listener(), TuioTrackpad(free, PAD, configured)
    listener.listen(source)
    await listener.until(lambda: bool(listener.links))
    with sender(free) as tracker:
        tracker.send(tuio1(1, {}))
        await until(lambda: source.counters["frames" if is_taken else "other_address"] == 1)
        port = tracker.getsockname()[1]
    await source.close()
    found = source.counters["sender"], source.counters["refused_address"]
    assert found == ((f"127.0.0.1 port {port}", "") if is_taken else ("", "127.0.0.1"))


@asynchronous
async def test_an_address_that_is_taken_is_one_line_and_is_tried_again(
    free: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(TuioTrackpad, "RETRY_S", 0.0)
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
