"""Recording within the daemon: to a file from its start, and to whichever `hapticd record` is attached.

Both take what the machine's one observer is given. While nothing records, the machine has no observer.
Only a recording that begins with its machine replays, so a recorder that requests one waits until the daemon restarts
its core. While anything is recorded it does not, for that recording would end: a recorder that attaches then joins at
once.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgpack
import zmq

from .. import __version__
from ..config.sections import RecordConfig
from ..errors import RecordingError
from ..files.recording.header import Header, header_fields
from ..files.recording.kinds import HEADER, Fields, Record, record_of
from ..io.clients.record_socket import WAITS, WHOLE, RecordSocket
from .machine import Machine

if TYPE_CHECKING:
    from ..files.recording.background import BackgroundWriter

log = logging.getLogger("hapticd")

BYTES_PER_MB = 1_000_000
MOST_FILES = 8  # of one start; a full one is followed, the oldest removed
RESTART_EVERY_NS = 10_000_000_000  # recorders that attach again and again must not keep the touch from going on

MakeHeader = Callable[[Machine, bool], Header]  # given whether the machine has had no input yet


def header_of(machine: Machine, *, t_ns: int, utc: str, is_whole: bool) -> Header:
    """The header for the records of this machine from `t_ns` on."""
    return Header(
        hapticd=__version__,
        started_utc=utc,
        t_start_ns=t_ns,
        is_whole=is_whole,
        instance=machine.instance,
        pad=machine.trackpad.pad,
        config=machine.config,
        modes=machine.modes,
        calibration=machine.calibration,
        parasitic_modes=machine.parasitic_modes,
    )


@dataclass(slots=True)
class _Live:
    """The recording that attached recorders get."""

    header: Fields
    t_start_ns: int
    is_whole: bool
    seq: int = 0
    sent_bytes: int = 0
    dropped: int = 0


class Recorders:
    """Everything that records the daemon's machine, and those that follow it, from the constructor to `close`."""

    def __init__(
        self,
        machine: Machine,
        config: RecordConfig,
        directory: Path,
        make_header: MakeHeader,
    ) -> None:
        """Begins the file that the configuration requests; the machine has had no input yet."""
        self._machine = machine
        self._make_header = make_header
        self._socket = RecordSocket(directory)
        self._waiting: deque[tuple[str, int, tuple[Any, ...]]] = deque()
        self._requests: set[bytes] = set()
        self._live: _Live | None = None
        self._t_restart_ns: int | None = None
        self._writer: BackgroundWriter | None = None
        if config.file:
            self._writer = _own_recording(config, make_header(machine, True))
        machine.status.recording = self.report
        self._choose_observer()

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Serve recorders on `loop`. Raises HapticdError."""
        self._loop = loop
        self._socket.start(loop, self._on_recorder)

    @property
    def waits(self) -> bool:
        """A recorder requests a recording that begins with its machine, and a restart would end no other."""
        return WHOLE in self._requests and self._live is None and self._writer is None

    def is_due(self, t_now_ns: int) -> bool:
        """Another machine may begin for the recorder that `waits`, as far as recorders are concerned."""
        return self.waits and (self._t_restart_ns is None or t_now_ns - self._t_restart_ns >= RESTART_EVERY_NS)

    def begin(self, machine: Machine, t_now_ns: int) -> None:
        """Record this machine, which has had no input yet, instead of the one before."""
        self._t_restart_ns = t_now_ns
        self._machine.observer = None
        self._machine = machine
        machine.status.recording = self.report
        self._join(is_whole=True)
        self._choose_observer()

    def report(self) -> dict[str, object]:
        """For `status`; empty while nothing is recorded."""
        found: dict[str, object] = {}
        if self._writer is not None:
            found["file"] = self._writer.report()
        if self._live is not None:
            live = self._live
            found["attached"] = {"is_whole": live.is_whole, "bytes": live.sent_bytes, "dropped": live.dropped}
        if self.waits:
            found["waits"] = True
        return found

    def sweep(self) -> None:
        """To be called now and then, as the clients' sockets are swept; detaches a recording that has ended."""
        self._socket.sweep()
        if self._writer is not None and self._writer.is_over:
            self._writer = None
            self._choose_observer()

    def close(self, t_ns: int) -> None:
        """Add the last record to each recording, after the machine's stop, and close it."""
        self._machine.observer = None
        if self._live is not None:
            self._put_live("end", t_ns, "the daemon stopped")
            self._flush()
        self._socket.close()
        if self._writer is not None:
            self._writer.close(t_ns, "the daemon stopped")

    def _choose_observer(self) -> None:
        observers = [put for put in (self._writer and self._writer.put, self._live and self._put_live) if put]
        if len(observers) < 2:
            self._machine.observer = observers[0] if observers else None
            return

        def all_of_them(kind: str, t_ns: int, *values: Any) -> None:
            for put in observers:
                put(kind, t_ns, *values)

        self._machine.observer = all_of_them

    def _on_recorder(self, request: bytes, is_attached: bool) -> None:
        if not is_attached:
            self._requests.discard(request)
            if not self._requests:
                self._live = None
                self._waiting.clear()
                self._choose_observer()
            return
        self._requests.add(request)
        if self.waits and request == WHOLE:
            self._socket.send(WAITS + self._machine.config.rig_dir.encode())  # whose fingers a recorder can lift
            return
        self._join(is_whole=False)
        self._choose_observer()

    def _join(self, *, is_whole: bool) -> None:
        """Send the header: of the recording that runs, or of one that begins now."""
        if self._live is None:
            header = self._make_header(self._machine, is_whole)
            self._live = _Live(header_fields(header), header.t_start_ns, is_whole)
        self._flush()
        self._send(self._live, Record(HEADER, self._live.seq, self._live.t_start_ns, self._live.header))

    def _put_live(self, kind: str, t_ns: int, *values: Any) -> None:
        """A machine's observer: encoded when the loop comes back from this event, so that no pass waits for it."""
        if not self._waiting:
            self._loop.call_soon(self._flush)
        self._waiting.append((kind, t_ns, values))

    def _flush(self) -> None:
        while self._waiting and self._live is not None:
            kind, t_ns, values = self._waiting.popleft()
            self._send(self._live, record_of(kind, self._live.seq, t_ns, values))
            self._live.seq += 1

    def _send(self, live: _Live, record: Record) -> None:
        message = WHOLE + bytes(msgpack.packb(record))
        try:
            self._socket.send(message)
            live.sent_bytes += len(message)
        except zmq.ZMQError:  # a recorder that is too slow sees the gap
            live.dropped += 1


def _own_recording(config: RecordConfig, header: Header) -> BackgroundWriter | None:
    """The daemon's own recording; where none can be made the touch goes on without."""
    from ..files.recording.background import BackgroundWriter  # with MCAP's library, which no other daemon needs
    from ..files.recording.mcap_writer import RecordingFile

    try:
        file = RecordingFile(Path(config.file), header, max_bytes=config.max_mb * BYTES_PER_MB, max_files=MOST_FILES)
    except RecordingError as error:
        log.error("recording: there is none, the touch goes on: %s", error)
        return None
    log.info("recording to %s", file.path)
    return BackgroundWriter(file)
