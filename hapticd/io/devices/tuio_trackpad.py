"""A TUIO tracker: datagrams at one UDP address, read on the loop. Those that are not its own go no further.

UDP has no authentication: any program that can send from the tracker's address can take its place. While a tracker
sends, datagrams of other sockets are dropped unread, and each of both kinds has a budget in time.
"""

from __future__ import annotations

import socket
import time
from collections import deque
from collections.abc import Callable
from typing import Final

from ...errors import TrackpadError
from ...values import RawReport
from ...wire.trackpad import Decoder, Pad, StillContacts, tuio
from ..time_budget import TimeBudget
from .repeats import RepeatedReports
from .trackpad_source import BATCH, REPORT_BYTES, LoopSource

SHARE, BURST_NS = 0.2, 4_000_000  # of the tracker: ten contacts take 0.1 ms to decode
OTHERS_SHARE, OTHERS_BURST_NS = 0.05, 1_000_000  # until one of them is the tracker
_LOOPBACK: Final = ("127.0.0.1", "::1")


def bound(address: str) -> socket.socket:
    """Return a socket that is bound to "host:port". Raises OSError."""
    host, _, port = address.rpartition(":")
    family, kind, protocol, _, place = socket.getaddrinfo(
        host.strip("[]"), int(port), type=socket.SOCK_DGRAM, flags=socket.AI_NUMERICHOST | socket.AI_PASSIVE
    )[0]
    endpoint = socket.socket(family, kind, protocol)
    try:
        endpoint.setblocking(False)
        endpoint.bind(place)
    except OSError:
        endpoint.close()
        raise
    return endpoint


class TuioTrackpad(LoopSource):
    """Frames of a tracker that sends to `address`; `pad` is the surface that it watches.

    It must send from `sender`, this computer where that is empty. `counters` has what arrived and what became of it.
    """

    def __init__(
        self, address: str, pad: Pad, sender: str = "", *, clock_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        super().__init__(clock_ns)
        self._address, self._pad = address, pad
        self._decoder = Decoder(pad)
        self._still = StillContacts(tuio.SILENT_NS)
        self._repeats = RepeatedReports(self._still, lambda _: tuio.REPEAT, clock_ns)
        self._socket: socket.socket | None = None
        self._budget = TimeBudget(SHARE, BURST_NS, clock_ns=clock_ns)
        self._budget_of_others = TimeBudget(OTHERS_SHARE, OTHERS_BURST_NS, clock_ns=clock_ns)
        hosts = (sender,) if sender else (*_LOOPBACK, address.rpartition(":")[0].strip("[]"))
        self._hosts = {*hosts, *[f"::ffff:{host}" for host in hosts]}
        self._tracker: tuple[str, int] | None = None  # the socket whose datagrams are taken
        self._t_tracker_ns = 0
        self._is_steady = False  # that socket has sent twice: not each datagram comes from a new one
        self._parts: deque[RawReport] = deque(maxlen=BATCH)  # of the frame that is not whole yet
        self._counts = dict.fromkeys(("other_address", "other_sender", "left_out"), 0)
        self._refused_address = ""

    @property
    def counters(self) -> dict[str, int | str]:
        """Datagrams by what became of them, from where the last one of another address came, and the tracker's."""
        sender = "" if self._tracker is None else f"{self._tracker[0]} port {self._tracker[1]}"
        return {**self._decoder.counters, **self._counts, "refused_address": self._refused_address, "sender": sender}

    def _open(self) -> tuple[Pad, str]:
        try:
            self._socket = bound(self._address)
        except OSError as error:
            why = f"{self._address} cannot be bound ({error.strerror}): does another program listen there?"
            raise TrackpadError(why) from None
        return self._pad, f"{self._pad.name} at {self._address}"

    def _begin(self) -> None:
        assert self._socket is not None
        self._repeats.start(self._loop, self._on_reports)
        self._loop.add_reader(self._socket, self._on_readable, self._socket)

    def _release(self) -> None:
        self._repeats.stop()
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def _on_readable(self, endpoint: socket.socket) -> None:
        batch: list[RawReport] = []
        for _ in range(BATCH):
            try:
                data, sender = endpoint.recvfrom(REPORT_BYTES)
            except OSError:  # nothing waits; an error is of an earlier datagram
                break
            batch += self._taken(data, (sender[0], sender[1]), self._clock_ns())
        if batch:
            self._repeats.pass_on(batch)

    def _taken(self, data: bytes, sender: tuple[str, int], t_now_ns: int) -> list[RawReport]:
        """Return the reports of the frame that a datagram makes whole, none if it does not."""
        if sender[0] not in self._hosts:
            self._counts["other_address"] += 1
            self._refused_address = sender[0]
            return []
        is_tracker = sender == self._tracker
        if not is_tracker and self._is_steady and t_now_ns - self._t_tracker_ns < tuio.SILENT_NS:
            self._counts["other_sender"] += 1
            return []
        budget = self._budget if is_tracker else self._budget_of_others
        if not budget.has_time:
            self._counts["left_out"] += 1
            return []
        with budget:
            frames = self._decoder.decode(data, t_now_ns)
        if self._decoder.was_refused:
            return []
        self._tracker, self._t_tracker_ns, self._is_steady = sender, t_now_ns, is_tracker
        self._parts.append(RawReport(t_now_ns, data))
        if not frames:
            return []
        self._still.took(t_now_ns, are_down=len(frames[-1].contacts) > 0)
        reports = list(self._parts)
        self._parts.clear()
        return reports
