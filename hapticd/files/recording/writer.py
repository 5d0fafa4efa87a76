"""The daemon's own recording: the loop drops what happens into a bounded queue, a thread frames and writes it.

The thread looks at the queue ten times a second and is woken by nobody, so that it never takes the interpreter from a
pass, and gives it back after each few records. Killed, the daemon loses the last tenth of a second; a failing power at
most the last second, for that often the file is synced. A disk that is full or too slow ends the recording with one
line in the log, and the touch goes on.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from .files import RecordingFile
from .stream import Stream

log = logging.getLogger("hapticd")

LOOK_EVERY_S = 0.1
SYNC_EVERY_LOOKS = 10
MAX_WAITING = 20_000  # half a minute of touching; client messages count by their size
WAITING_BYTES = 1024  # of a message, that count as one record
BITE = 8  # records between two system calls, which let the loop in: some 0.1 ms
CLOSE_WITHIN_S = 1.0  # the service manager kills after two


class Waiting(NamedTuple):
    """What the tap was told."""

    kind: str
    t_ns: int
    values: tuple[Any, ...]


class Writer:
    """A machine's tap that writes `file` on a thread of its own, from the constructor to `close`."""

    def __init__(self, file: RecordingFile, stream: Stream, on_end: Callable[[], None] = lambda: None) -> None:
        """`on_end` is called from the thread when the recording ends by itself: nothing more needs to be told."""
        self.is_over = False
        self._file = file
        self._stream = stream
        self._on_end = on_end
        self._queue: deque[Waiting] = deque()
        self._weight = 0
        self._written = 0
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()

    def put(self, kind: str, t_ns: int, *values: Any) -> None:
        """On the loop: never waits, never raises."""
        if self.is_over:
            return
        self._queue.append(Waiting(kind, t_ns, values))
        self._weight += 1
        if kind == "targets" or kind == "request":
            self._weight += len(values[0]) // WAITING_BYTES
        if self._weight - self._written > MAX_WAITING:
            self._end(f"the disk is too slow: {len(self._queue)} records wait for it")

    def told(self) -> dict[str, object]:
        """For `status`."""
        return {
            "path": str(self._file.path),
            "bytes": self._file.written_bytes,
            "queued": len(self._queue),
            "dropped": self._stream.too_long,
        }

    def close(self, t_ns: int, reason: str) -> None:
        """The last record, and what waits before it; gives a slow disk CLOSE_WITHIN_S, not longer."""
        self.put("end", t_ns, reason)
        self._closing.set()
        self._thread.join(CLOSE_WITHIN_S)
        if self._thread.is_alive():
            log.warning("recording: the disk takes too long, the end of %s may be missing", self._file.path)

    def _run(self) -> None:
        looks = 0
        try:
            while not self._closing.wait(LOOK_EVERY_S) and not self.is_over:
                self._drain()
                looks += 1
                if looks % SYNC_EVERY_LOOKS == 0:
                    self._file.sync()
            self._drain()
            self._file.sync()
        except OSError as error:
            self._end(error.strerror or str(error))
        finally:
            self._queue.clear()
            self._close_file()

    def _drain(self) -> None:
        while self._queue and not self.is_over:
            data, first_seq = bytearray(), self._stream.seq
            for _ in range(min(BITE, len(self._queue))):
                kind, t_ns, values = self._queue.popleft()
                self._written += 1
                if kind == "targets" or kind == "request":
                    self._written += len(values[0]) // WAITING_BYTES
                data += self._stream.record(kind, t_ns, values)
            self._write(data, first_seq)

    def _write(self, data: bytearray, first_seq: int) -> None:
        if self._file.is_full_with(data):
            if not self._file.may_follow():
                self._end("the file has reached record.max_mb")
                return
            self._file.follow(self._stream.opening(first_seq))
        self._file.write(data)

    def _end(self, why: str) -> None:
        """Once: one line, and no record more."""
        if self.is_over:
            return
        self.is_over = True
        log.warning("recording: it ends here, the touch goes on: %s: %s", self._file.path, why)
        self._on_end()

    def _close_file(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            self._end(error.strerror or str(error))
