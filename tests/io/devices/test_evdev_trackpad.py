"""Any Linux multitouch device as a source, over nodes that behave as the kernel's; a real kernel's: virtual_machine."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from asynchronous import asynchronous
from input_events import END, axis, lifted, packed, placed
from input_node import AXES, FakeNode
from listener import Listener

from hapticd.errors import TrackpadError
from hapticd.io.devices import evdev_trackpad, input_nodes
from hapticd.io.devices.evdev_trackpad import EvdevTrackpad
from hapticd.io.devices.input_nodes import Axis, InputNode, describe, find_nodes
from hapticd.wire.trackpad import Decoder, Pad
from hapticd.wire.trackpad.evdev import (
    EV_SYN,
    POSITION_X,
    POSITION_Y,
    SYN_DROPPED,
    TRACKING_ID,
)

MS = 1_000_000


def plugged(monkeypatch: pytest.MonkeyPatch, *nodes: FakeNode | OSError | None) -> None:
    """Each search finds the next one."""
    found = iter(nodes)

    def find(*_: object) -> Iterator[InputNode]:
        node = next(found, None)
        if isinstance(node, OSError):
            raise node
        yield from () if node is None else (node,)

    monkeypatch.setattr(evdev_trackpad, "find_nodes", find)
    monkeypatch.setattr(EvdevTrackpad, "RETRY_S", 0.0)


def contacts(listener: Listener, pad: Pad) -> list[dict[int, tuple[float, float]]]:
    decoder = Decoder(pad)
    return [
        {contact.contact_id: (contact.x_mm, contact.y_mm) for contact in frame.contacts}
        for report in listener.reports
        for frame in decoder.decode(report.data, report.t_host_ns)
    ]


@asynchronous
async def test_reports_are_the_kernels_own_bytes_one_for_each_of_its_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    node, listener = FakeNode(), Listener()
    plugged(monkeypatch, node)
    source = EvdevTrackpad("screen")
    listener.listen(source)
    await listener.until(lambda: len(listener.reports) == 1)
    assert node.claims == 1
    node.say(*placed(0, 5, 5, 1), END, *lifted(0), END, t_ns=9 * MS)
    await listener.until(lambda: len(listener.reports) == 3)
    assert [one.data for one in listener.reports[1:]] == [
        packed(9 * MS, *placed(0, 5, 5, 1), END),
        packed(9 * MS, *lifted(0), END),
    ]
    source.request_enable()
    await source.close()


@asynchronous
async def test_fingers_that_are_down_when_it_is_opened_are_seen_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    node, listener = FakeNode(), Listener()
    node.held = {3: {TRACKING_ID: 40, POSITION_X: 2000, POSITION_Y: 2000}}
    plugged(monkeypatch, node)
    source = EvdevTrackpad()
    listener.listen(source)
    await listener.until(lambda: bool(listener.reports))
    (pad, _), *_ = listener.links
    assert pad is not None
    assert contacts(listener, pad)[0] == {40: (0.0, 0.0)}
    await source.close()


@asynchronous
async def test_after_dropped_events_all_slots_are_reported_and_the_finger_stays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    node, listener = FakeNode(), Listener()
    plugged(monkeypatch, node)
    source = EvdevTrackpad(clock_ns=lambda: 0)
    listener.listen(source)
    await listener.until(lambda: bool(listener.reports))
    node.say(*placed(0, 2000, 2000, 1), END)
    await listener.until(lambda: len(listener.reports) == 2)
    node.held = {0: {TRACKING_ID: 1, POSITION_X: 2100, POSITION_Y: 2000}}
    node.say((EV_SYN, SYN_DROPPED, 0), axis(POSITION_X, 2050), END)
    await listener.until(lambda: len(listener.reports) >= 4)
    pad = listener.links[0][0]
    assert pad is not None
    assert contacts(listener, pad)[:3] == [{}, {1: (0.0, 0.0)}, {1: (10.0, 0.0)}]
    await source.close()


@asynchronous
async def test_a_finger_that_lies_still_is_reported_again_and_a_lifted_one_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    node, listener = FakeNode(), Listener()
    plugged(monkeypatch, node)
    source = EvdevTrackpad()
    listener.listen(source)
    await listener.until(lambda: bool(listener.reports))
    t_ns = listener.reports[0].t_host_ns
    node.say(*placed(0, 2000, 2000, 1), END, t_ns=t_ns)
    await listener.until(lambda: len(listener.reports) >= 4)
    pad = listener.links[0][0]
    assert pad is not None
    assert contacts(listener, pad)[1:] == [{1: (0.0, 0.0)}] * (len(listener.reports) - 1)
    node.say(*lifted(0), END, t_ns=t_ns)
    await listener.until(lambda: contacts(listener, pad)[-1] == {})
    assert source._repeats._timer is None
    await source.close()


@asynchronous
async def test_it_is_found_again_after_it_was_unplugged_with_other_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, listener = FakeNode(), FakeNode(AXES | {POSITION_X: Axis(0, 0, 8000, 10)}), Listener()
    plugged(monkeypatch, None, first, None, None, second)
    source = EvdevTrackpad("screen")
    listener.listen(source)
    await listener.until(lambda: len(listener.reports) == 1)
    first.unplug()
    await listener.until(lambda: len(listener.reports) == 2)
    said = [(pad is not None, reason) for pad, reason in listener.links]
    assert said == [
        (False, "no multitouch device 'screen' is connected: plug one in, or see hapticd doctor"),
        (True, "screen at /dev/input/event7"),
        (False, "/dev/input/event7 was lost (end of file): searching for it"),
        (True, "screen at /dev/input/event7"),
    ]
    assert [pad.geometry.width_mm for pad, _ in listener.links if pad] == [400.0, 800.0]
    await source.close()


@asynchronous
async def test_a_node_that_fails_is_one_line_and_is_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    class Gone(FakeNode):
        def claim(self) -> None:
            raise OSError(errno.EBUSY, "Device or resource busy")

    refused, node, listener = OSError(errno.EACCES, "Permission denied"), FakeNode(), Listener()
    plugged(monkeypatch, refused, Gone(), node)
    source = EvdevTrackpad("/dev/input/event7")
    listener.listen(source)
    await listener.until(lambda: bool(listener.reports))
    assert listener.links[0][1] == "/dev/input/event7 cannot be opened (Permission denied): see hapticd doctor"
    assert len(listener.links) == 2
    await source.close()


@asynchronous
async def test_a_device_without_a_size_is_a_sentence_and_sizes_can_be_given(monkeypatch: pytest.MonkeyPatch) -> None:
    sizeless = AXES | {POSITION_X: Axis(0, 0, 4000, 0)}
    plugged(monkeypatch, FakeNode(sizeless))
    listener = Listener()
    source = EvdevTrackpad()
    listener.listen(source)
    await listener.until(lambda: bool(listener.links))
    assert "measure its active area, and set trackpad.size_mm" in listener.links[0][1]
    await source.close()
    pad = describe(FakeNode(sizeless), (344.0, 194.0))
    assert (pad.geometry.width_mm, pad.geometry.height_mm) == (344.0, 194.0)


@pytest.mark.parametrize(
    ("axes", "word"),
    [
        ({}, "declares no range"),
        ({POSITION_X: Axis(0, 5, 5, 1), POSITION_Y: Axis(0, 0, 9, 1)}, "declares no range"),
        ({POSITION_X: Axis(0, 0, 4, 10), POSITION_Y: Axis(0, 0, 4, 10)}, "says it is 0.4 x 0.4 mm"),
    ],
)
def test_a_device_with_impossible_ranges_is_refused_in_a_sentence(axes: dict[int, Axis], word: str) -> None:
    with pytest.raises(TrackpadError, match=word):
        describe(FakeNode(axes), ())


def test_a_device_is_what_it_declares() -> None:
    pad = describe(FakeNode(), ())
    assert (pad.name, pad.layout, pad.source) == ("screen", "evdev", "evdev")
    assert (pad.geometry.y_min_raw, pad.geometry.y_max_raw) == (-4000, 0)
    assert (pad.geometry.width_mm, pad.geometry.height_mm) == (400.0, 200.0)
    assert (pad.geometry.pressure_max_raw, pad.geometry.quarter_turn_raw) == (255, 90)
    bare = {code: AXES[code] for code in (POSITION_X, POSITION_Y)}
    assert describe(FakeNode(bare, name=""), ()) == replace(
        pad, name="event7", geometry=replace(pad.geometry, pressure_max_raw=0, quarter_turn_raw=0)
    )
    assert FakeNode(bare).slot_count() == 0


def test_a_file_that_is_no_input_device_is_not_chosen(tmp_path: Path) -> None:
    (tmp_path / "event0").touch()
    assert list(find_nodes("", tmp_path)) == []
    with pytest.raises(OSError, match="Inappropriate ioctl"):
        next(find_nodes(str(tmp_path / "event0")))
    with pytest.raises(OSError, match="No such file"):
        next(find_nodes(str(tmp_path / "event1")))
    assert list(find_nodes("a name", tmp_path / "missing")) == []


def test_nodes_are_looked_at_in_the_order_of_their_numbers_and_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def opened(path: Path) -> FakeNode:
        asked.append(path.name)
        if path.name == "event3":
            raise PermissionError
        return FakeNode(name=path.name)

    for number in (10, 2, 3):
        (tmp_path / f"event{number}").touch()
    monkeypatch.setattr(input_nodes, "InputNode", opened)
    assert [node.name for node in find_nodes("event10", tmp_path)] == ["event10"]
    assert asked == ["event2", "event3", "event10"]
