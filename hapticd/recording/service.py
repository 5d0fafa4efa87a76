"""Recording within the daemon: to a file from its start, to whoever runs `hapticd record`, or to nobody.

Both take what the machine's one tap is told. While there is neither, the machine has no tap.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zmq

from ..config import RecordConfig
from ..errors import RecordingError
from ..io.record_socket import RecordSocket
from ..machine import Machine
from .files import RecordingFile
from .header import Header
from .stream import Stream
from .writer import Writer

log = logging.getLogger("hapticd")

BYTES_PER_MB = 1_000_000

MakeHeader = Callable[[bool], Header]  # told whether the machine has heard nothing yet


class Recorders:
    """All that record one machine, from the constructor to `close`."""

    def __init__(self, machine: Machine, config: RecordConfig, directory: Path, make_header: MakeHeader) -> None:
        """Begins the file that the configuration asks for; the machine has heard nothing yet."""
        self._machine = machine
        self._make_header = make_header
        self._socket = RecordSocket(directory)
        self._waiting: deque[tuple[str, int, tuple[Any, ...]]] = deque()
        self._live: Stream | None = None
        self._writer: Writer | None = None
        if config.file:
            self._writer = _begun(config, Stream(make_header(True)))
        self._choose_tap()

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Serve recorders on `loop`. Raises HapticdError."""
        self._loop = loop
        self._socket.start(loop, self._on_recorder)

    @property
    def is_live(self) -> bool:
        """Somebody runs `hapticd record`."""
        return self._live is not None

    def sweep(self) -> None:
        """Now and then, as the clients' sockets are swept; a recording that has ended is told no more."""
        self._socket.sweep()
        if self._writer is not None and self._writer.is_over:
            self._writer = None
            self._choose_tap()

    def close(self, t_ns: int) -> None:
        """The last record of each, behind what the machine said at its stop."""
        self._machine.tap = None
        if self._live is not None:
            self._put_live("end", t_ns, "the daemon stopped")
            self._flush()
        self._socket.close()
        if self._writer is not None:
            self._writer.close(t_ns, "the daemon stopped")

    def _choose_tap(self) -> None:
        taps = [put for put in (self._writer and self._writer.put, self._live and self._put_live) if put]
        if len(taps) < 2:
            self._machine.tap = taps[0] if taps else None
            return

        def both(kind: str, t_ns: int, *values: Any) -> None:
            for put in taps:
                put(kind, t_ns, *values)

        self._machine.tap = both

    def _on_recorder(self, is_there: bool) -> None:
        if is_there:
            if self._live is None:
                self._live = Stream(self._make_header(False))
            self._flush()
            self._send(self._live.header(self._live.seq))
        else:
            self._live = None
            self._waiting.clear()
        self._choose_tap()

    def _put_live(self, kind: str, t_ns: int, *values: Any) -> None:
        """A machine's tap: framed when the loop comes back from this event, so that no pass waits for it."""
        if not self._waiting:
            self._loop.call_soon(self._flush)
        self._waiting.append((kind, t_ns, values))

    def _flush(self) -> None:
        while self._waiting and self._live is not None:
            self._send(self._live.record(*self._waiting.popleft()))

    def _send(self, record: bytes) -> None:
        try:
            self._socket.send(record)
        except zmq.ZMQError:  # whoever does not keep up sees the gap
            return


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
