"""`hapticd record`: writes down what a running daemon tells on its `record` socket, and beside it a simulated plate's
truth.

Only what begins with the daemon's core replays exactly. So the daemon is asked to have its core begin anew, which it
does as soon as nobody touches and nobody wants anything; or, with `is_now`, for what follows in mid-session.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import zmq

from ...errors import RecordingError
from ...files.recording.files import RecordingFile
from ...files.recording.framing import HEADER_KIND, MAGIC, RawRecord, Scanner
from ...files.recording.header import decode_header
from ...files.recording.records import KINDS
from ...io.clients.record_socket import NAME, NOW, SEND_HIGH_WATER, WAITS, WHOLE
from ...io.clients.runtime_dir import endpoint_path, runtime_directory
from .truth import TruthEar

HEADER_WITHIN_S = 3.0
SOON_S = 0.5  # a daemon that nobody uses begins within 0.1 s: nobody need be asked for anything
POLL_MS = 100
SYNC_EVERY_S = 1.0
WAITING = "Hands off the plate, please: the recording begins when nobody touches and no target stands (--now: at once)."
BEGUN = "The recording has begun."
LATE = "Something is recorded already: this recording begins in mid-session, and so it cannot be replayed bit for bit."

Say = Callable[[str], None]


def _say(text: str) -> None:
    print(text, flush=True)


def record(
    out: Path,
    directory: Path | None,
    seconds: float | None,
    *,
    is_now: bool = False,
    say: Say = _say,
) -> str:
    """Record for `seconds`, until KeyboardInterrupt, or until the daemon stops; a sentence of what is there then.

    `say` is given what a person should know meanwhile. Raises RecordingError.
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
        for topic in (NOW,) if is_now else (WAITS, WHOLE):
            socket.subscribe(topic)
        opening = _opening(socket, directory, say)
        header = decode_header(opening.raw.body)
        if not is_now and not (header.is_whole and opening.raw.seq == 0):
            say(LATE)
        with closing(TruthEar(context, header)) as truth:
            return _record(socket, truth, opening, out, seconds)
    finally:
        socket.close()
        context.term()


@dataclass(frozen=True, slots=True)
class _Framed:
    """A record, and the bytes that it came in."""

    data: bytes
    raw: RawRecord


@dataclass(slots=True)
class _Written:
    """What is in the file. Numbers that were passed over are records that never came."""

    next_seq: int
    records: int = 0
    lost: int = 0

    def count(self, raw: RawRecord) -> None:
        self.records += 1
        self.lost += max(raw.seq - self.next_seq, 0)
        self.next_seq = raw.seq + 1


def _record(socket: zmq.Socket[bytes], truth: TruthEar, opening: _Framed, out: Path, seconds: float | None) -> str:
    file = RecordingFile(out, MAGIC + opening.data)
    written = _Written(opening.raw.seq)
    begun_s = synced_s = time.monotonic()
    try:
        for framed in _records(socket, math.inf if seconds is None else begun_s + seconds):
            if framed is not None and framed.raw.kind != HEADER_KIND:
                file.write(framed.data)
                written.count(framed.raw)
                truth.hear(framed.raw)
            if written.records:
                file.write(truth.records(written.next_seq - 1))
            if framed is not None and _is_last(framed.raw, opening.raw):
                break
            if time.monotonic() - synced_s >= SYNC_EVERY_S:
                synced_s = time.monotonic()
                file.sync()
    except OSError as error:
        raise RecordingError(f"{file.path}: the recording ends here ({error.strerror}): make room.") from None
    finally:
        file.close()
    lost = f"; {written.lost} came too fast and are missing" if written.lost else ""
    return f"{file.path}: {written.records} records of {time.monotonic() - begun_s:.1f} s{lost}"


def _is_last(raw: RawRecord, opening: RawRecord) -> bool:
    """The daemon says that it stops; or another one answers in its place, after it was killed."""
    return raw.kind == KINDS["end"].number or (raw.kind == HEADER_KIND and raw.body != opening.body)


def _opening(socket: zmq.Socket[bytes], directory: Path, say: Say) -> _Framed:
    """The first message that begins a recording: to this recorder, or to another that came at the same time."""
    deadline_s, t_waits_s, is_told = time.monotonic() + HEADER_WITHIN_S, math.inf, False
    for data in _messages(socket, math.inf):
        t_now_s = time.monotonic()
        framed = _framed(data)
        if framed is not None and framed.raw.kind == HEADER_KIND:
            say(BEGUN)
            return framed
        if data == WAITS:
            deadline_s, t_waits_s = math.inf, min(t_waits_s, t_now_s)
        if t_now_s > deadline_s:
            raise RecordingError(
                f"No hapticd answers in {directory}: start one, or name its directory with --runtime-dir."
            )
        if t_now_s - t_waits_s > SOON_S and not is_told:
            is_told = True
            say(WAITING)
    raise RecordingError("Nothing is recorded: it ended before the recording began.")


def _records(socket: zmq.Socket[bytes], deadline_s: float) -> Iterator[_Framed | None]:
    """What comes until the deadline or Ctrl-C; None where nothing came for a moment."""
    return map(_framed, _messages(socket, deadline_s))


def _messages(socket: zmq.Socket[bytes], deadline_s: float) -> Iterator[bytes]:
    try:
        while time.monotonic() < deadline_s:
            yield socket.recv() if socket.poll(POLL_MS) else b""
    except KeyboardInterrupt:
        return


def _framed(data: bytes) -> _Framed | None:
    raw = next(Scanner().feed(data), None)
    return None if raw is None else _Framed(data, raw)
