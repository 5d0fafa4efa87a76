"""The sources of touch reports: over a hidapi that behaves as documented, a unix socket, and a recording."""

from __future__ import annotations

import asyncio
import functools
import os
import queue
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from asynchronous import VirtualTimeLoop, asynchronous
from listener import Listener

from hapticd.io.devices.hid_trackpad import HidTrackpad, find_pads
from hapticd.io.devices.socket_trackpad import SocketTrackpad
from hapticd.values import RawReport
from hapticd.wire.trackpad import DEFAULT_PAD, PADS

MS = 1_000_000

in_virtual_time = functools.partial(asynchronous, loop_factory=VirtualTimeLoop)


# --- hidapi -------------------------------------------------------------------------------------------------------


class FakeHid:
    """The `hidraw` module as far as it is used: nodes come and go, reads wait, and errors carry no errno."""

    def __init__(self, *nodes: dict[str, object]) -> None:
        self.nodes = list(nodes)
        self.waiting: queue.Queue[bytes] = queue.Queue()
        self.unplugged, self.idle = threading.Event(), threading.Event()
        self.refuse_open = self.refuse_feature = False
        self.opens_refused, self.granted_after = 0, -1
        self.features: queue.Queue[bytes] = queue.Queue()
        self.open_now = 0
        self.threads: set[int] = set()

    def plug(self, node: dict[str, object]) -> None:
        self.unplugged.clear()
        self.nodes = [node]

    def unplug(self) -> None:
        self.nodes = []
        self.unplugged.set()

    def enumerate(self, vendor_id: int, product_id: int) -> list[dict[str, object]]:
        return [node for node in self.nodes if (node["vendor_id"], node["product_id"]) == (vendor_id, product_id)]

    def device(self) -> FakeDevice:
        return FakeDevice(self)


class FakeDevice:
    def __init__(self, hid: FakeHid) -> None:
        self.hid = hid
        self.is_open = self.nonblocking = False

    def open_path(self, path: bytes) -> None:
        if self.hid.refuse_open or path not in [node["path"] for node in self.hid.nodes]:
            self.hid.opens_refused += 1
            self.hid.refuse_open = self.hid.refuse_open and self.hid.opens_refused != self.hid.granted_after
            raise OSError("open failed")
        self.is_open = True
        self.hid.open_now += 1

    def set_nonblocking(self, flag: bool) -> int:
        self.nonblocking = flag
        return 0

    def send_feature_report(self, data: list[int]) -> int:
        self._touch()
        if self.hid.refuse_feature:
            return -1
        self.hid.features.put(bytes(data))
        return len(data)

    def read(self, max_length: int, timeout_ms: int = 0) -> list[int]:
        self._touch()
        assert max_length >= 256, "a short read loses the rest of a report"
        assert self.nonblocking or timeout_ms > 0, "this read blocks for ever"
        if timeout_ms > 0 and self.hid.waiting.empty():
            self.hid.idle.set()
        try:
            return list(self.hid.waiting.get(timeout_ms > 0, timeout_ms / 1000 if timeout_ms else None))
        except queue.Empty:
            if self.hid.unplugged.is_set():
                raise OSError("read error") from None
            return []

    def close(self) -> None:
        if self.is_open:
            self._touch()
            self.is_open = False
            self.hid.open_now -= 1

    def _touch(self) -> None:
        if not self.is_open:
            raise ValueError("not open")
        self.hid.threads.add(threading.get_ident())


def node(model: str, path: bytes = b"/dev/hidraw3", **changes: object) -> dict[str, object]:
    ids = PADS[model].ids
    assert ids is not None
    return {
        "path": path,
        "vendor_id": ids.vendor_id,
        "product_id": ids.product_id,
        "interface_number": ids.interface,
        "bus_type": ids.bus,
        "usage_page": 1,
        "usage": 2,
    } | changes


def hid_source(hid: FakeHid, model: str = "auto", **changes: object) -> HidTrackpad:
    return HidTrackpad(model, hid=hid, rescan_s=0.005, **changes)


@pytest.mark.parametrize(
    ("model", "ids", "enable"),
    [
        ("mt1", {"vendor_id": 0x05AC, "product_id": 0x030E, "interface_number": -1, "bus_type": 2}, "d701"),
        ("mt2-usb", {"vendor_id": 0x05AC, "product_id": 0x0265, "interface_number": 1, "bus_type": 1}, "0201"),
        ("mt2-bt", {"vendor_id": 0x004C, "product_id": 0x0265, "interface_number": -1, "bus_type": 2}, "f10201"),
        ("usbc-usb", {"vendor_id": 0x05AC, "product_id": 0x0324, "interface_number": 1, "bus_type": 1}, "0201"),
        ("usbc-bt", {"vendor_id": 0x004C, "product_id": 0x0324, "interface_number": -1, "bus_type": 2}, "f10201"),
    ],
)
@asynchronous
async def test_each_trackpad_is_known_by_its_ids_and_gets_its_enable(
    model: str, ids: dict[str, object], enable: str
) -> None:
    hid, listener = FakeHid({"path": b"/dev/hidraw7", "usage_page": 1, "usage": 2} | ids), Listener()
    source = hid_source(hid)
    listener.listen(source)
    await listener.until(lambda: bool(listener.links))
    assert listener.links[0][0] is PADS[model]
    assert "/dev/hidraw7" in listener.links[0][1]
    assert hid.features.get_nowait() == bytes.fromhex(enable)
    await source.close()


def test_of_a_pads_nodes_only_the_touch_interface_counts_and_each_path_once() -> None:
    hid = FakeHid(
        node("mt2-usb", b"wrong interface", interface_number=0),
        node("mt2-usb", b"wrong usage", usage=1),
        node("mt2-usb", b"wrong bus", bus_type=2),
        node("mt2-bt", b"bluetooth"),
        node("mt2-usb", b"usb"),
        node("mt2-usb", b"usb"),
        node("mt1", b"usage unknown", usage_page=0, usage=0),
    )
    assert [(pad.model, path) for pad, path in find_pads(hid)] == [
        ("mt2-usb", b"usb"),
        ("mt2-bt", b"bluetooth"),
        ("mt1", b"usage unknown"),
    ]
    assert [path for _, path in find_pads(hid, "mt2-bt")] == [b"bluetooth"]


@asynchronous
async def test_an_unplugged_pad_is_reported_once_and_enabled_again_after_reconnecting() -> None:
    hid, listener = FakeHid(node("mt2-usb")), Listener()
    source = hid_source(hid)
    listener.listen(source)
    await listener.until(lambda: len(listener.links) == 1)
    hid.unplug()
    await listener.until(lambda: len(listener.links) == 2)
    assert listener.links[1] == (None, "Magic Trackpad 2 on USB was lost (read error): searching for it")
    hid.plug(node("mt2-bt", b"/dev/hidraw9"))
    await listener.until(lambda: len(listener.links) == 3)
    assert listener.links[2] == (PADS["mt2-bt"], "Magic Trackpad 2 on Bluetooth at /dev/hidraw9")
    assert [hid.features.get_nowait() for _ in range(2)] == [b"\x02\x01", b"\xf1\x02\x01"]
    await source.close()
    assert hid.open_now == 0


@asynchronous
async def test_a_missing_pad_is_reported_once_and_an_inaccessible_one_with_a_remedy() -> None:
    hid, listener = FakeHid(), Listener()
    source = hid_source(hid)
    listener.listen(source)
    await listener.until(lambda: len(listener.links) == 1)
    assert listener.links == [(None, "no trackpad is connected: plug one in or pair it")]
    hid.refuse_open = True
    hid.plug(node("mt2-usb"))
    await listener.until(lambda: len(listener.links) == 2)
    assert listener.links[1] == (
        None,
        "Magic Trackpad 2 on USB at /dev/hidraw3 cannot be opened (open failed): give this user read and write access",
    )
    hid.refuse_open = False
    await listener.until(lambda: len(listener.links) == 3)
    assert listener.links[2][0]
    await source.close()


@asynchronous
async def test_a_pad_in_mouse_mode_is_enabled_again_at_most_twice_a_second() -> None:
    hid, listener, now_ns = FakeHid(node("mt2-usb")), Listener(), 0
    source = hid_source(hid, clock_ns=lambda: now_ns)
    listener.listen(source)
    await listener.until(lambda: bool(listener.links))
    hid.features.get_nowait()
    source.request_enable()
    hid.waiting.put(b"\x02\x00\x01")
    await listener.until(lambda: len(listener.reports) == 1)
    hid.waiting.put(b"\x02\x00\x02")
    await listener.until(lambda: len(listener.reports) == 2)
    assert hid.features.empty()
    now_ns = 500 * MS
    assert hid.features.get(timeout=5) == b"\x02\x01"
    await source.close()


def test_the_thread_that_reads_is_the_one_that_closes_and_nothing_is_left() -> None:
    threads_before = set(threading.enumerate())

    async def main() -> None:
        hid, listener = FakeHid(node("mt2-usb")), Listener()
        source = hid_source(hid)
        listener.listen(source)
        await listener.until(lambda: bool(listener.links))
        events = list(listener.events)
        await source.close()
        await source.close()
        hid.waiting.put(b"\x02\x00")
        await asyncio.sleep(0)
        assert listener.events == events
        assert hid.open_now == 0
        assert len(hid.threads) == 1
        assert len(asyncio.all_tasks()) == 1

    asyncio.run(main())
    assert set(threading.enumerate()) == threads_before


# --- a unix socket --------------------------------------------------------------------------------------------------


@pytest.fixture
def rig_path(tmp_path: Path) -> Iterator[Path]:
    fds_before = set(os.listdir("/proc/self/fd"))
    yield tmp_path / "trackpad.sock"
    assert len(os.listdir("/proc/self/fd")) == len(fds_before)


def listening(path: Path) -> socket.socket:
    path.unlink(missing_ok=True)
    server = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    server.bind(str(path))
    server.listen()
    return server


@in_virtual_time
async def test_the_rigs_packets_come_as_batches_and_its_end_is_an_unplug(rig_path: Path) -> None:
    listener, source = Listener(), SocketTrackpad(rig_path, clock_ns=lambda: 77)
    with listening(rig_path) as server:
        listener.listen(source)
        await listener.until(lambda: bool(listener.links))
        rig, _ = server.accept()
    with rig:
        for i in range(70):
            rig.send(bytes((0x31, i)))
        await listener.until(lambda: len(listener.reports) == 70)
        assert [len(item) for item in listener.events if isinstance(item, list)] == [64, 6]
        assert listener.reports == [RawReport(77, bytes((0x31, i))) for i in range(70)]
        rig.send(b"\x31last")
    await listener.until(lambda: len(listener.links) == 2)
    assert listener.events[-2:-1] == [[b"\x31last"]]
    assert listener.links[1] == (
        None,
        f"the simulated trackpad at {rig_path} was lost (closed by the rig): reconnecting",
    )
    await source.close()


@in_virtual_time
async def test_a_missing_rig_is_reported_once_and_retried_until_it_exists(rig_path: Path) -> None:
    loop, listener, source = asyncio.get_running_loop(), Listener(), SocketTrackpad(rig_path)
    source.start(loop, listener.on_reports, listener.on_link)
    await asyncio.sleep(10)
    assert len(listener.links) == 1
    assert not listener.links[0][0]
    assert str(rig_path) in listener.links[0][1]
    with listening(rig_path) as server:
        t_listening_s = loop.time()
        await listener.until(lambda: len(listener.links) == 2)
        assert loop.time() - t_listening_s <= 1.0
        server.accept()[0].close()
    await listener.until(lambda: len(listener.links) == 3)
    assert [pad for pad, _ in listener.links] == [None, DEFAULT_PAD, None]
    await source.close()
    events = list(listener.events)
    await asyncio.sleep(10)
    assert listener.events == events
