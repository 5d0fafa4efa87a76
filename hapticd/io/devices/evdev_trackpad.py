"""Any Linux multitouch device: its input events, read on the loop, grabbed so that no pointer moves.

Reports are the kernel's own bytes, one for each SYN_REPORT, so recordings hold what the kernel said. What it does not
send again is reported in the same form: all slots, after it dropped events and when the device was opened; and the last
report repeated, of fingers that lie still.
"""

from __future__ import annotations

import os
import struct
import time
from collections.abc import Callable, Iterator

from ...errors import TrackpadError
from ...values import RawReport
from ...wire.trackpad import Decoder, Pad, StillContacts, evdev
from ..time_budget import TimeBudget
from .input_nodes import InputNode, describe, find_nodes, packed, require_package
from .repeats import RepeatedReports
from .trackpad_source import BATCH, LoopSource

_NATIVE = struct.Struct("@llHHi")  # as this kernel writes it; reports are of a 64-bit one
SHARE, BURST_NS = 0.3, 10_000_000  # of the loop's time: what it cannot take meanwhile the kernel drops, and says so
_MOST_BYTES = (evdev.MAX_EVENTS - 1) * evdev.EVENT.size  # of a report, before its end
_END = (evdev.EV_SYN, evdev.SYN_REPORT, 0)


class EvdevTrackpad(LoopSource):
    """A multitouch device by its path or name, or the first one found; searched for every second while none is there.

    `size_mm` is the size of its range of positions, where it has no resolution. Raises HapticdError without the `evdev`
    package.
    """

    def __init__(
        self,
        device: str = "",
        size_mm: tuple[float, ...] = (),
        *,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        require_package()
        super().__init__(clock_ns)
        self._device, self._size_mm = device, size_mm
        self._node: InputNode | None = None
        self._still = StillContacts()
        self._repeats = RepeatedReports(self._still, _repeated, clock_ns)
        self._budget = TimeBudget(SHARE, BURST_NS, clock_ns=clock_ns)
        self._pauses = self._dropped = 0

    @property
    def counters(self) -> dict[str, int | str]:
        """Pauses of a device that sends too much, and how often the kernel dropped events."""
        return {"pauses": self._pauses, "dropped": self._dropped}

    # --- the link ---

    def _open(self) -> tuple[Pad, str]:
        try:
            self._node = next(find_nodes(self._device), None)
            if self._node is None:
                which = f"{self._device!r}" if self._device else "that this user may read"
                raise TrackpadError(f"no multitouch device {which} is connected: plug one in, or see hapticd doctor")
            pad = describe(self._node, self._size_mm)
            self._node.claim()
            self._slot_count = self._node.slot_count()
            self._rest, self._decoder = b"", Decoder(pad)
            self._still.reset()
            self._first = self._all_slots()
        except OSError as error:
            device = self._device or "the touch device"
            raise TrackpadError(f"{device} cannot be opened ({error.strerror}): see hapticd doctor") from None
        return pad, f"{pad.name} at {self._node.path}"

    def _begin(self) -> None:
        self._repeats.start(self._loop, self._on_reports)
        self._repeats.pass_on([self._first])
        self._watch()

    def _watch(self) -> None:
        assert self._node is not None
        self._loop.add_reader(self._node.fd, self._on_readable)

    def _end(self, why: str) -> None:
        assert self._node is not None
        self._lost(f"{self._node.path} was lost ({why}): searching for it")

    def _release(self) -> None:
        self._repeats.stop()
        if self._node is not None:
            self._loop.remove_reader(self._node.fd)
            self._node.close()
            self._node = None

    # --- reports ---

    def _on_readable(self) -> None:
        assert self._node is not None
        if not self._budget.has_time:
            self._pauses += 1
            self._loop.remove_reader(self._node.fd)
            self._timer = self._loop.call_later(self._budget.wait_s, self._watch)
            return
        try:
            with self._budget:
                data = os.read(self._node.fd, BATCH * _NATIVE.size * 8)
                batch = list(self._reports(data))
        except BlockingIOError:
            return
        except OSError as error:
            self._end(str(error.strerror))
            return
        if batch:
            self._repeats.pass_on(batch)
        elif not data:
            self._end("end of file")

    def _reports(self, data: bytes) -> Iterator[RawReport]:
        """Split what was read into reports; after what the kernel dropped, all slots are reported."""
        for second_s, microsecond_us, kind, code, value in _NATIVE.iter_unpack(data):
            is_end = (kind, code) == _END[:2]
            if is_end or len(self._rest) < _MOST_BYTES:  # no device has so many axes
                self._rest += evdev.EVENT.pack(second_s, microsecond_us, kind, code, value)
            if is_end:
                report, self._rest = RawReport(self._clock_ns(), self._rest), b""
                is_whole = self._note(report, second_s * 1_000_000_000 + microsecond_us * 1000)
                yield report
                if not is_whole:
                    self._dropped += 1
                    yield self._all_slots()

    def _note(self, report: RawReport, t_ns: int) -> bool:
        """Track whether contacts are there after a report; return False for one of which the kernel dropped some."""
        frames = self._decoder.decode(report.data, report.t_host_ns)
        self._still.took(t_ns, are_down=self._slot_count > 0 and any(frame.contacts for frame in frames[-1:]))
        return len(frames) > 0

    def _all_slots(self) -> RawReport:
        """Return a report of all slots as they are now. Raises OSError if the device is gone."""
        assert self._node is not None
        t_ns = self._clock_ns()
        events = []
        if self._slot_count > 0:
            values = self._node.slots(self._slot_count)
            for index in range(min(self._slot_count, evdev.MAX_CONTACTS)):
                events.append((evdev.EV_ABS, evdev.SLOT, index))
                is_there = values[evdev.TRACKING_ID][index] >= 0
                known = values if is_there else (evdev.TRACKING_ID,)
                events += [(evdev.EV_ABS, code, values[code][index]) for code in known]
            slot = self._node.axis(evdev.SLOT)
            events.append((evdev.EV_ABS, evdev.SLOT, slot.present if slot is not None else 0))
        report = RawReport(t_ns, packed(t_ns, [*events, _END]))
        self._note(report, t_ns)
        return report


def _repeated(t_ns: int) -> bytes:
    return packed(t_ns, [_END])
