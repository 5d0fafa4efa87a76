"""Recording within the daemon: to a file from its start, to whoever runs `hapticd record`, or to nobody.

Both take what the machine's one observer is told. While there is neither, the machine has no observer. Only what begins
with its machine replays, so a recorder that wants that waits until the daemon has another machine begin. While anything
is recorded none does, for that recording would end: who comes then joins at once.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zmq

from ..config.sections import RecordConfig
from ..errors import RecordingError
from ..files.recording.files import RecordingFile
from ..files.recording.header import Header
from ..files.recording.stream import Stream
from ..files.recording.writer import Writer
from ..io.clients.record_socket import WAITS, WHOLE, RecordSocket
from .machine import Machine

log = logging.getLogger("hapticd")

BYTES_PER_MB = 1_000_000
ANEW_EVERY_NS = 10_000_000_000  # whoever comes again and again cannot keep the touch from going on

MakeHeader = Callable[[Machine, bool], Header]  # told whether the machine has heard nothing yet


class Recorders:
    """All that record the daemon's machine, and those that follow it, from the constructor to `close`."""

    def __init__(self, machine: Machine, config: RecordConfig, directory: Path, make_header: MakeHeader) -> None:
        """Begins the file that the configuration asks for; the machine has heard nothing yet."""
        self._machine = machine
        self._make_header = make_header
        self._socket = RecordSocket(directory)
        self._waiting: deque[tuple[str, int, tuple[Any, ...]]] = deque()
        self._wanted: set[bytes] = set()
        self._live: Stream | None = None
        self._is_live_whole = False
        self._live_bytes = self._dropped = 0
        self._t_anew_ns: int | None = None
        self._writer: Writer | None = None
        if config.file:
            self._writer = _begun(config, Stream(make_header(machine, True)))
        machine.recording = self.told
        self._choose_tap()

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Serve recorders on `loop`. Raises HapticdError."""
        self._loop = loop
        self._socket.start(loop, self._on_recorder)

    @property
    def is_live(self) -> bool:
        """Somebody runs `hapticd record`."""
        return self._live is not None

    @property
    def waits(self) -> bool:
        """Somebody wants a recording that begins with its machine, and nothing is recorded that another would end."""
        return WHOLE in self._wanted and self._live is None and self._writer is None

    def is_due(self, t_now_ns: int) -> bool:
        """Another machine may begin for who `waits`, as far as recorders go."""
        return self.waits and (self._t_anew_ns is None or t_now_ns - self._t_anew_ns >= ANEW_EVERY_NS)

    def begin(self, machine: Machine, t_now_ns: int) -> None:
        """Record this machine, which has heard nothing yet, instead of the one before."""
        self._t_anew_ns = t_now_ns
        self._machine.observer = None
        self._machine = machine
        machine.recording = self.told
        self._join(is_whole=True)
        self._choose_tap()

    def told(self) -> dict[str, object]:
        """For `status`; empty while nothing is recorded."""
        said: dict[str, object] = {}
        if self._writer is not None:
            said["file"] = self._writer.told()
        if self._live is not None:
            dropped = self._dropped + self._live.too_long
            said["attached"] = {"is_whole": self._is_live_whole, "bytes": self._live_bytes, "dropped": dropped}
        if self.waits:
            said["waits"] = True
        return said

    def sweep(self) -> None:
        """Now and then, as the clients' sockets are swept; a recording that has ended is told no more."""
        self._socket.sweep()
        if self._writer is not None and self._writer.is_over:
            self._writer = None
            self._choose_tap()

    def close(self, t_ns: int) -> None:
        """The last record of each, behind what the machine said at its stop."""
        self._machine.observer = None
        if self._live is not None:
            self._put_live("end", t_ns, "the daemon stopped")
            self._flush()
        self._socket.close()
        if self._writer is not None:
            self._writer.close(t_ns, "the daemon stopped")

    def _choose_tap(self) -> None:
        taps = [put for put in (self._writer and self._writer.put, self._live and self._put_live) if put]
        if len(taps) < 2:
            self._machine.observer = taps[0] if taps else None
            return

        def both(kind: str, t_ns: int, *values: Any) -> None:
            for put in taps:
                put(kind, t_ns, *values)

        self._machine.observer = both

    def _on_recorder(self, wanted: bytes, is_there: bool) -> None:
        if not is_there:
            self._wanted.discard(wanted)
            if not self._wanted:
                self._live = None
                self._waiting.clear()
                self._choose_tap()
            return
        self._wanted.add(wanted)
        if self.waits and wanted == WHOLE:
            self._send(WAITS)
            return
        self._join(is_whole=False)
        self._choose_tap()

    def _join(self, *, is_whole: bool) -> None:
        """A header for who comes: of the recording that runs, or of one that begins now."""
        if self._live is None:
            self._live = Stream(self._make_header(self._machine, is_whole))
            self._is_live_whole = is_whole
            self._live_bytes = self._dropped = 0
        self._flush()
        self._send(self._live.header(self._live.seq))

    def _put_live(self, kind: str, t_ns: int, *values: Any) -> None:
        """A machine's observer: framed when the loop comes back from this event, so that no pass waits for it."""
        if not self._waiting:
            self._loop.call_soon(self._flush)
        self._waiting.append((kind, t_ns, values))

    def _flush(self) -> None:
        while self._waiting and self._live is not None:
            self._send(self._live.record(*self._waiting.popleft()))

    def _send(self, record: bytes) -> None:
        try:
            self._socket.send(record)
            self._live_bytes += len(record)
        except zmq.ZMQError:  # whoever does not keep up sees the gap
            self._dropped += 1


def _begun(config: RecordConfig, stream: Stream) -> Writer | None:
    """The daemon's own recording; where none can be made the touch goes on without."""
    try:
        file = RecordingFile(
            Path(config.file), stream.opening(), max_bytes=config.max_mb * BYTES_PER_MB, max_files=config.max_files
        )
    except RecordingError as error:
        log.error("recording: there is none, the touch goes on: %s", error)
        return None
    log.info("recording to %s", file.path)
    return Writer(file, stream)
