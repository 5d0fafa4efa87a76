"""The trackpad over hidapi: one thread owns the device and hands its reports to the loop.

hidapi must not be closed while another thread reads (hidapi issue 649), so one thread does both.
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
from typing import Protocol, cast

from ...errors import TrackpadError, pip_install
from ...values import RawReport
from ...wire.trackpad import PADS, HidIds, Pad
from .trackpad_source import BATCH, REPORT_BYTES, OnLink, OnReports

_READ_MS = 250  # the thread polls its stop flag this often; each poll wakes the process
_ENABLE_EVERY_NS = 500_000_000


class HidDevice(Protocol):
    """The part of `hid.device` that is used."""

    def open_path(self, path: bytes) -> None: ...
    def set_nonblocking(self, flag: bool) -> int: ...
    def send_feature_report(self, data: list[int]) -> int: ...
    def read(self, max_length: int, timeout_ms: int = 0) -> list[int]: ...
    def close(self) -> None: ...


class HidModule(Protocol):
    """The part of the `hid` module that is used."""

    def enumerate(self, vendor_id: int, product_id: int) -> list[dict[str, object]]: ...
    def device(self) -> HidDevice: ...


def load_hid() -> HidModule:
    """Import hidapi: `hidraw` where it exists, else `hid` (other systems, distributions' builds)."""
    for name in ("hidraw", "hid"):
        try:
            return cast(HidModule, importlib.import_module(name))
        except ImportError:
            continue
    raise TrackpadError(f"hidapi is not installed, so no trackpad can be read: run `{pip_install('hidapi')}`.")


def find_pads(hid: HidModule, model: str = "auto") -> Iterator[tuple[Pad, bytes]]:
    """Yield connected trackpads and their paths, each path once, USB before Bluetooth (the better link)."""
    seen = set()
    listed = [(pad.ids, pad) for pad in PADS.values() if pad.ids is not None and model in ("auto", pad.model)]
    for ids, pad in sorted(listed, key=lambda one: one[0].bus):
        for node in hid.enumerate(ids.vendor_id, ids.product_id):
            path = cast(bytes, node["path"])
            if path not in seen and _is_touch_interface(ids, node):
                seen.add(path)
                yield pad, path


def _is_touch_interface(ids: HidIds, node: dict[str, object]) -> bool:
    """Select the node that declares a mouse; hidapi reports an unknown usage or bus as 0."""
    return (
        node.get("interface_number") == ids.interface
        and node.get("bus_type", 0) in (0, ids.bus)
        and (node.get("usage_page", 0), node.get("usage", 0)) in ((0, 0), (1, 2))
    )


class HidTrackpad:
    """A trackpad over hidapi. `model` is one of `PADS`, or "auto" for the first one found.

    One thread owns the device from open to close and searches for it every `rescan_s` while none is connected. `hid`
    is hidapi's module or a substitute. Raises ValueError for an unknown model, TrackpadError without hidapi.
    """

    def __init__(
        self,
        model: str = "auto",
        *,
        hid: HidModule | None = None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        rescan_s: float = 1.0,
    ) -> None:
        if model not in ("auto", *PADS):
            raise ValueError(f"unknown trackpad model {model!r}: use auto or one of {', '.join(PADS)}")
        self._requested_model = model
        self._hid = load_hid() if hid is None else hid
        self._clock_ns = clock_ns
        self._rescan_s = rescan_s
        self._stop, self._enable = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None
        self._last_link: tuple[Pad | None, str] | None = None
        self._refused_path: bytes | None = None

    @property
    def counters(self) -> dict[str, int | str]:
        """Reports that were dropped while the loop was busy."""
        return {"left_out": 0 if self._thread is None else self._mailbox.left_out}

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
            if self._last_link is not None and self._last_link[0] is not None:
                self._report_link(None, "the trackpad reader stopped")
            self._mailbox.post(self._finished.set_result, None)

    def _serve(self) -> None:
        """Find a trackpad and read it until it disconnects."""
        try:
            found = next(find_pads(self._hid, self._requested_model), None)
        except OSError as error:
            self._report_link(None, f"the HID devices cannot be listed ({error})")
            return
        if found is None:
            if self._last_link is None:
                self._report_link(None, "no trackpad is connected: plug one in or pair it")
            return
        pad, path = found
        device = self._hid.device()
        try:
            self._read(device, pad, path)
        except (OSError, ValueError) as error:
            self._report_link(None, f"{pad.name} was lost ({error}): searching for it")
        finally:
            device.close()

    def _read(self, device: HidDevice, pad: Pad, path: bytes) -> None:
        node = os.fsdecode(path)
        try:
            device.open_path(path)
        except OSError as error:
            if path == self._refused_path:  # second failure: udev grants access only after the node appears
                reason = f"cannot be opened ({error}): give this user read and write access"
                self._report_link(None, f"{pad.name} at {node} {reason}")
            self._refused_path = path
            return
        self._refused_path = None
        device.set_nonblocking(True)  # then a read without a timeout drains instead of blocking
        enabled = _send_enable(device, pad)
        t_enable_ns = self._clock_ns()
        self._report_link(pad, f"{pad.name} at {node}" + ("" if enabled else ", which refused the multitouch enable"))
        while not self._stop.is_set():
            if self._enable.is_set() and self._clock_ns() - t_enable_ns >= _ENABLE_EVERY_NS:
                self._enable.clear()
                _send_enable(device, pad)
                t_enable_ns = self._clock_ns()
            if batch := self._drain(device):
                self._mailbox.put(batch)

    def _drain(self, device: HidDevice) -> list[RawReport]:
        """Wait for a report, then read all that are queued."""
        batch: list[RawReport] = []
        data = device.read(REPORT_BYTES, _READ_MS)
        while data:
            batch.append(RawReport(self._clock_ns(), bytes(data)))
            data = device.read(REPORT_BYTES) if len(batch) < BATCH else []
        return batch

    def _report_link(self, pad: Pad | None, reason: str) -> None:
        if self._last_link != (pad, reason):
            self._last_link = (pad, reason)
            self._mailbox.put_link(pad, reason)


def _send_enable(device: HidDevice, pad: Pad) -> bool:
    """Send the multitouch enable. A refusal is not fatal: the kernel's driver sends it too."""
    try:
        return device.send_feature_report(list(pad.enable)) >= 0
    except OSError:
        return False


class _Mailbox:
    """Queue from the reader thread to the loop; reports that arrive while the loop is busy form one batch."""

    def __init__(self, loop: asyncio.AbstractEventLoop, on_reports: OnReports, on_link: OnLink) -> None:
        self._loop = loop
        self._on_reports = on_reports
        self._on_link = on_link
        self._waiting = deque[RawReport](maxlen=BATCH)  # a longer stall keeps the newest
        self._closed = False
        self.left_out = 0  # reports

    def close(self) -> None:
        self._closed = True

    def put(self, reports: Sequence[RawReport]) -> None:
        self.left_out += max(len(self._waiting) + len(reports) - BATCH, 0)
        self._waiting.extend(reports)
        self.post(self._deliver, self._waiting)

    def put_link(self, pad: Pad | None, reason: str) -> None:
        self._waiting = deque(maxlen=BATCH)  # later reports follow this event
        self.post(self._deliver_link, pad, reason)

    def post(self, callback: Callable[..., None], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(callback, *arguments)

    def _deliver(self, waiting: deque[RawReport]) -> None:
        batch = []
        while waiting:
            batch.append(waiting.popleft())
        if batch and not self._closed:
            self._on_reports(batch)

    def _deliver_link(self, pad: Pad | None, reason: str) -> None:
        if not self._closed:
            self._on_link(pad, reason)
