"""Where touch reports come from: what every source does, and the trackpad over hidapi.

A source hands over raw reports in the order they came, everything that was waiting in one call, so that whoever
takes them can use the newest and lose nothing of the others. What the bytes mean is not known here. The other
sources are the simulated rig (`io.socketpad`) and recordings (`io.replay`).

Ids, enable bytes and hidapi's ways: `drivers/hid/hid-magicmouse.c` and hidapi's documentation; hidapi must not be
closed while another thread reads (hidapi issue 649), so one thread does both.
"""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, cast

from ..errors import TrackpadError
from ..values import RawReport

__all__ = ["MODELS", "PADS", "HidTrackpad", "OnLink", "OnReports", "PadId", "TrackpadSource", "find_pads", "load_hid"]

OnReports = Callable[[Sequence[RawReport]], None]
OnLink = Callable[[bool, str], None]

REPORT_BYTES = 512  # the longest report is 280 bytes, and a short read would lose the rest
BATCH = 64  # the kernel keeps 63 reports
_READ_MS = 250  # and then the thread looks whether it shall stop; each look wakes the process
_ENABLE_EVERY_NS = 500_000_000
_USB, _BLUETOOTH = 1, 2  # hidapi's bus_type


@dataclass(frozen=True, slots=True)
class PadId:
    """How one trackpad on one bus is found, and the feature report that makes it speak multitouch."""

    model: str
    name: str
    bus: int
    vendor_id: int
    product_id: int
    interface: int
    enable: bytes


PADS = (
    PadId("usbc-usb", "Magic Trackpad (USB-C) on USB", _USB, 0x05AC, 0x0324, 1, b"\x02\x01"),
    PadId("mt2-usb", "Magic Trackpad 2 on USB", _USB, 0x05AC, 0x0265, 1, b"\x02\x01"),
    PadId("usbc-bt", "Magic Trackpad (USB-C) on Bluetooth", _BLUETOOTH, 0x004C, 0x0324, -1, b"\xf1\x02\x01"),
    PadId("mt2-bt", "Magic Trackpad 2 on Bluetooth", _BLUETOOTH, 0x004C, 0x0265, -1, b"\xf1\x02\x01"),
    PadId("mt1", "Magic Trackpad on Bluetooth", _BLUETOOTH, 0x05AC, 0x030E, -1, b"\xd7\x01"),
)
MODELS = tuple(pad.model for pad in PADS)


class TrackpadSource(Protocol):
    """A stream of raw reports that survives unplugging. All callbacks run on the loop.

    `on_link(True, what)` comes before the first report, `on_link(False, why)` once when the stream ends or cannot
    begin; a source that can come back keeps trying. `model` names the pad for the decoder and is known, for any
    source, when `on_link(True, ...)` is called.
    """

    @property
    def model(self) -> str | None: ...

    def start(self, loop: asyncio.AbstractEventLoop, on_reports: OnReports, on_link: OnLink) -> None: ...

    def request_enable(self) -> None:
        """Ask the pad for multitouch again: it was heard speaking as a mouse."""

    async def close(self) -> None:
        """Stop; on return no thread, task or file is left and no callback comes any more."""


class HidDevice(Protocol):
    """What is used of `hid.device`."""

    def open_path(self, path: bytes) -> None: ...
    def set_nonblocking(self, flag: bool) -> int: ...
    def send_feature_report(self, data: list[int]) -> int: ...
    def read(self, max_length: int, timeout_ms: int = 0) -> list[int]: ...
    def close(self) -> None: ...


class HidModule(Protocol):
    """What is used of the `hid` module."""

    def enumerate(self, vendor_id: int, product_id: int) -> list[dict[str, object]]: ...
    def device(self) -> HidDevice: ...


def load_hid() -> HidModule:
    """hidapi on the kernel's hidraw where there is one; plain `hid` on other systems (or in distributions' builds)."""
    for name in ("hidraw", "hid"):
        try:
            return cast(HidModule, importlib.import_module(name))
        except ImportError:
            continue
    raise TrackpadError("hidapi is not installed, so no trackpad can be read: run `pip install hidapi`.")


def find_pads(hid: HidModule, model: str = "auto") -> Iterator[tuple[PadId, bytes]]:
    """Connected trackpads and their paths, each path once; those on USB first, a cable being the better link."""
    seen = set()
    for pad in PADS:
        if model not in ("auto", pad.model):
            continue
        for node in hid.enumerate(pad.vendor_id, pad.product_id):
            path = cast(bytes, node["path"])
            if path not in seen and _is_touch_interface(pad, node):
                seen.add(path)
                yield pad, path


def _is_touch_interface(pad: PadId, node: dict[str, object]) -> bool:
    """Of a pad's nodes the one that declares a mouse; hidapi leaves a usage or bus it cannot tell at 0."""
    return (
        node.get("interface_number") == pad.interface
        and node.get("bus_type", 0) in (0, pad.bus)
        and (node.get("usage_page", 0), node.get("usage", 0)) in ((0, 0), (1, 2))
    )


class HidTrackpad:
    """A trackpad over hidapi. `model` is one of those in `PADS`, or "auto" for whichever is connected.

    One thread owns the device from open to close and looks for it every `rescan_s` while there is none. `hid` is
    hidapi's module or anything that behaves like it. ValueError if the model is unknown, TrackpadError if there is
    no hidapi.
    """

    def __init__(
        self,
        model: str = "auto",
        *,
        hid: HidModule | None = None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        rescan_s: float = 1.0,
    ) -> None:
        if model not in ("auto", *MODELS):
            raise ValueError(f"unknown trackpad model {model!r}: use auto or one of {', '.join(MODELS)}")
        self.model = None if model == "auto" else model
        self._wanted = model
        self._hid = load_hid() if hid is None else hid
        self._clock_ns = clock_ns
        self._rescan_s = rescan_s
        self._stop, self._enable = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None
        self._last_link: tuple[bool, str] | None = None
        self._refused_path: bytes | None = None

    def start(self, loop: asyncio.AbstractEventLoop, on_reports: OnReports, on_link: OnLink) -> None:
        self._mailbox = _Mailbox(loop, on_reports, on_link)
        self._finished: asyncio.Future[None] = loop.create_future()
        self._thread = threading.Thread(target=self._run, name="trackpad", daemon=True)
        self._thread.start()

    def request_enable(self) -> None:
        self._enable.set()

    async def close(self) -> None:
        self._stop.set()
        if self._thread is None:
            return
        self._mailbox.close()
        await asyncio.shield(self._finished)
        self._thread.join()

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                self._serve()
                self._stop.wait(self._rescan_s)
        finally:
            if self._last_link is not None and self._last_link[0]:
                self._tell(False, "the trackpad's reader has stopped")
            self._mailbox.post(self._finished.set_result, None)

    def _serve(self) -> None:
        """Find a trackpad and read it until it goes."""
        try:
            found = next(find_pads(self._hid, self._wanted), None)
        except OSError as error:
            self._tell(False, f"the HID devices cannot be listed ({error})")
            return
        if found is None:
            if self._last_link is None:
                self._tell(False, "no trackpad is connected: plug one in or pair it")
            return
        pad, path = found
        device = self._hid.device()
        try:
            self._read(device, pad, path)
        except (OSError, ValueError) as error:
            self._tell(False, f"{pad.name} was lost ({error}): looking for it")
        finally:
            device.close()

    def _read(self, device: HidDevice, pad: PadId, path: bytes) -> None:
        node = os.fsdecode(path)
        try:
            device.open_path(path)
        except OSError as error:
            if path == self._refused_path:  # not at once: udev gives a new node its access after it has appeared
                reason = f"cannot be opened ({error}): give this user read and write access"
                self._tell(False, f"{pad.name} at {node} {reason}")
            self._refused_path = path
            return
        self._refused_path = None
        device.set_nonblocking(True)  # so that read without a time-out drains instead of blocking
        self.model = pad.model
        enabled = _send_enable(device, pad)
        t_enable_ns = self._clock_ns()
        self._tell(True, f"{pad.name} at {node}" + ("" if enabled else ", which refused the multitouch enable"))
        while not self._stop.is_set():
            if self._enable.is_set() and self._clock_ns() - t_enable_ns >= _ENABLE_EVERY_NS:
                self._enable.clear()
                _send_enable(device, pad)
                t_enable_ns = self._clock_ns()
            if batch := self._drain(device):
                self._mailbox.put(batch)

    def _drain(self, device: HidDevice) -> list[RawReport]:
        """Wait for a report, then take all that are there."""
        batch: list[RawReport] = []
        data = device.read(REPORT_BYTES, _READ_MS)
        while data:
            batch.append(RawReport(self._clock_ns(), bytes(data)))
            data = device.read(REPORT_BYTES) if len(batch) < BATCH else []
        return batch

    def _tell(self, is_up: bool, reason: str) -> None:
        if self._last_link != (is_up, reason):
            self._last_link = (is_up, reason)
            self._mailbox.put_link(is_up, reason)


def _send_enable(device: HidDevice, pad: PadId) -> bool:
    """A refusal is no reason to give up: the kernel's driver sends the same enable, and reports show if it worked."""
    try:
        return device.send_feature_report(list(pad.enable)) >= 0
    except OSError:
        return False


class _Mailbox:
    """From the reader's thread to the loop: reports that wait there while the loop is busy join into one batch."""

    def __init__(self, loop: asyncio.AbstractEventLoop, on_reports: OnReports, on_link: OnLink) -> None:
        self._loop = loop
        self._on_reports = on_reports
        self._on_link = on_link
        self._lock = threading.Lock()
        self._waiting: deque[RawReport] | None = None
        self._closed = False

    def close(self) -> None:
        self._closed = True

    def put(self, reports: Sequence[RawReport]) -> None:
        with self._lock:
            if self._waiting is not None:
                self._waiting.extend(reports)
                return
            self._waiting = deque(reports, maxlen=BATCH)  # a loop that hangs for longer gets the newest
            self.post(self._deliver, self._waiting)

    def put_link(self, is_up: bool, reason: str) -> None:
        with self._lock:
            self._waiting = None  # reports from now on come after this
            self.post(self._deliver_link, is_up, reason)

    def post(self, callback: Callable[..., None], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop was closed first: nobody is left to tell
            self._loop.call_soon_threadsafe(callback, *arguments)

    def _deliver(self, reports: deque[RawReport]) -> None:
        with self._lock:
            if self._waiting is reports:
                self._waiting = None
        if not self._closed:
            self._on_reports(tuple(reports))

    def _deliver_link(self, is_up: bool, reason: str) -> None:
        if not self._closed:
            self._on_link(is_up, reason)
