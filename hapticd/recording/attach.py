"""`hapticd record`: writes down what a running daemon tells on its `record` socket."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator
from pathlib import Path

import zmq

from ..errors import RecordingError
from ..io.record_socket import NAME, SEND_HIGH_WATER
from ..io.runtime_dir import endpoint_path, runtime_directory
from .files import RecordingFile
from .framing import HEAD, HEADER_KIND, MAGIC, SYNC
from .records import KINDS

HEADER_WITHIN_S = 3.0
POLL_MS = 100
SYNC_EVERY_S = 1.0


def record(out: Path, directory: Path | None, seconds: float | None) -> str:
    """Record for `seconds`, until KeyboardInterrupt, or until the daemon stops; a sentence of what is there then.

    Raises RecordingError.
    """
    if seconds is not None and not 0.0 < seconds < math.inf:
        raise RecordingError(f"--seconds {seconds:g}: give a finite number above 0.")
    directory = runtime_directory(os.environ) if directory is None else directory
    context = zmq.Context()
    socket = context.socket(zmq.SUB)
    socket.linger = 0
    socket.rcvhwm = SEND_HIGH_WATER
    try:
        socket.connect(f"ipc://{endpoint_path(directory, NAME)}")
        socket.subscribe(b"")
        return _record(socket, out, directory, seconds)
    finally:
        socket.close()
        context.term()


def _record(socket: zmq.Socket[bytes], out: Path, directory: Path, seconds: float | None) -> str:
    header = _header(socket, directory)
    file = RecordingFile(out, MAGIC + header)
    begun_s = synced_s = time.monotonic()
    records = 0
    try:
        for data in _records(socket, math.inf if seconds is None else begun_s + seconds):
            if not is_of(data, HEADER_KIND):
                file.write(data)
                records += len(data) > 0
            if is_of(data, KINDS["end"].number):
                break
            if time.monotonic() - synced_s >= SYNC_EVERY_S:
                synced_s = time.monotonic()
                file.sync()
    except OSError as error:
        raise RecordingError(f"{file.path}: the recording ends here ({error.strerror}): make room.") from None
    finally:
        file.close()
    return f"{file.path}: {records} records of {time.monotonic() - begun_s:.1f} s"


def _header(socket: zmq.Socket[bytes], directory: Path) -> bytes:
    """The first message that begins a recording: to this recorder, or to another that came at the same time."""
    deadline_s = time.monotonic() + HEADER_WITHIN_S
    for data in _records(socket, deadline_s):
        if is_of(data, HEADER_KIND):
            return data
    raise RecordingError(f"No hapticd answers in {directory}: start one, or name its directory with --runtime-dir.")


def _records(socket: zmq.Socket[bytes], deadline_s: float) -> Iterator[bytes]:
    """What comes until the deadline or Ctrl-C; b"" where nothing came for a moment."""
    try:
        while time.monotonic() < deadline_s:
            yield socket.recv() if socket.poll(POLL_MS) else b""
    except KeyboardInterrupt:
        return


def is_of(data: bytes, kind: int) -> bool:
    """Whether a framed record is of this kind."""
    return len(data) >= HEAD.size and data.startswith(SYNC) and data[len(SYNC)] == kind
