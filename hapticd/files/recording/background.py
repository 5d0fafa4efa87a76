"""The daemon's own recording: the loop appends to a bounded queue, a thread makes MCAP of it and writes it.

The thread empties the queue ten times a second without being woken, and sleeps after each record: so it holds the
interpreter for some 0.05 ms at a time, and a pass waits no longer for it. Once a second it ends the chunk and syncs the
disk: that much is lost where the daemon is killed or the power fails. A disk that is full or too slow ends the
recording with one line in the log, and the touch goes on.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from typing import Any

from ...errors import RecordingError
from .kinds import record_of
from .mcap_writer import RecordingFile

log = logging.getLogger("hapticd")

LOOK_EVERY_S = 0.1
SYNC_EVERY_LOOKS = 10
MAX_WAITING = 20_000  # half a minute of touching; client messages count by their size
WAITING_BYTES = 1024  # of a message, that count as one record
SLEEP_S = 5e-5  # between records: long enough for the loop to take the interpreter
CLOSE_WITHIN_S = 1.0  # the service manager kills after two


def _weight(kind: str, values: tuple[Any, ...]) -> int:
    """A record's size, in records of usual size."""
    is_payload = (kind == "targets" or kind == "request") and isinstance(values[0], bytes)
    return 1 + len(values[0]) // WAITING_BYTES if is_payload else 1


class BackgroundWriter:
    """A machine's observer that writes `file` on a thread of its own, from the constructor to `close`."""

    def __init__(self, file: RecordingFile) -> None:
        self.is_over = False
        self._file = file
        self._queue: deque[tuple[str, int, tuple[Any, ...]]] = deque()
        self._put_weight = self._taken_weight = 0  # each changed by one thread alone
        self._seq = 0
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()

    def put(self, kind: str, t_ns: int, *values: Any) -> None:
        """On the loop: never waits, never raises."""
        if self.is_over:
            return
        self._queue.append((kind, t_ns, values))
        self._put_weight += _weight(kind, values)
        if self._put_weight - self._taken_weight > MAX_WAITING:
            self._end(f"the disk is too slow: {len(self._queue)} records wait for it")

    def report(self) -> dict[str, object]:
        """For `status`."""
        return {
            "path": str(self._file.path),
            "bytes": self._file.written_bytes,
            "queued": len(self._queue),
            "dropped": self._file.left_out,
        }

    def close(self, t_ns: int, reason: str) -> None:
        """Add the last record, and write what waits; a slow disk gets CLOSE_WITHIN_S, not longer."""
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
        except (OSError, RecordingError) as error:
            self._end(getattr(error, "strerror", None) or str(error))
        finally:
            self._queue.clear()
            self._close_file()

    def _drain(self) -> None:
        while self._queue and not self.is_over:
            kind, t_ns, values = self._queue.popleft()
            self._taken_weight += _weight(kind, values)
            self._file.add(record_of(kind, self._seq, t_ns, values))
            self._seq += 1
            time.sleep(SLEEP_S)

    def _end(self, reason: str) -> None:
        """Once: one line, and no record more."""
        if self.is_over:
            return
        self.is_over = True
        log.warning("recording: it ends here, the touch goes on: %s: %s", self._file.path, reason)

    def _close_file(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            self._end(error.strerror or str(error))
