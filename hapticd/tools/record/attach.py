"""`hapticd record`: writes the records of a running daemon to a file.

Only a recording that begins with the daemon's core replays exactly. So the daemon is requested to restart its core,
which it does as soon as no finger touches and no target stands; the scripted fingers of a simulated plate are lifted
for that. With `is_now`, and after `wait_s`, recording begins in mid-session instead.
"""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import msgpack
import zmq

from ...errors import HapticdError
from ...files.recording.header import header_from
from ...files.recording.kinds import HEADER, Record
from ...files.recording.mcap_writer import RecordingFile, check_destination
from ...io.clients.record_socket import NAME, NOW, RECEIVE_HIGH_WATER, WAITS, WHOLE
from ...io.clients.runtime_dir import endpoint_path, runtime_directory
from ..view.rig import PadSender
from .inlets import Inlets

HEADER_WITHIN_S = 3.0
SOON_S = 0.5  # an idle daemon begins within 0.1 s: no need to ask for hands off the plate
POLL_MS = 100
TAIL_NS = 500_000_000  # the longest wait for records from before the end
SYNC_EVERY_S = 1.0  # that much is lost where this process is killed
WAITING = "Hands off the plate, please: the recording begins without fingers and targets (--now: at once)."
BEGUN = "The recording has begun."
LATE = "Something is recorded already: this recording begins in mid-session, and so it cannot be replayed bit for bit."
NO_STREAMS = Inlets()

Notify = Callable[[str], None]


@contextmanager
def until_signal() -> Iterator[Callable[[], bool]]:
    """Yield what tells whether SIGINT, SIGTERM or SIGHUP has come, also where a shell had SIGINT ignored behind `&`."""
    found: list[int] = []
    endings = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, lambda ending, _: found.append(ending)) for number in endings}
    try:
        yield lambda: bool(found)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def record(
    out: Path,
    directory: Path | None,
    seconds: float | None,
    *,
    is_now: bool = False,
    wait_s: float = math.inf,
    notify: Notify = lambda text: print(text, flush=True),
    is_ended: Callable[[], bool] = lambda: False,
    inlets: Inlets = NO_STREAMS,
) -> str:
    """Record for `seconds`, until `is_ended` or KeyboardInterrupt, or until the daemon stops.

    Returns a sentence on the file. `notify` is given what a person should know meanwhile; `inlets` are recorded too.
    Raises HapticdError; RecordingError, before the daemon is asked, if the file cannot be made.
    """
    check_destination(out)
    directory = runtime_directory(os.environ) if directory is None else directory
    with zmq.Context() as context, context.socket(zmq.SUB) as socket:
        socket.linger = 0
        socket.rcvhwm = RECEIVE_HIGH_WATER
        socket.connect(f"ipc://{endpoint_path(directory, NAME)}")
        for topic in (NOW,) if is_now else (WAITS, WHOLE):
            socket.subscribe(topic)
        with closing(_Wait(context, socket, wait_s, notify)) as wait:
            opening = _opening(socket, directory, wait, is_ended)
        notify(BEGUN)
        header = header_from(opening.fields)
        if not is_now and not (header.is_whole and opening.seq == 0):
            notify(LATE)
        file = RecordingFile(out, header, seq=opening.seq)
        for inlet in inlets:
            inlet.drop()
        return _record(socket, opening, file, seconds, is_ended, inlets)


def _record(
    socket: zmq.Socket[bytes],
    opening: Record,
    file: RecordingFile,
    seconds: float | None,
    is_ended: Callable[[], bool],
    inlets: Inlets,
) -> str:
    records, lost, next_seq = 0, 0, opening.seq
    begun_s = synced_s = time.monotonic()
    newest_ns, t_end_ns = 0, math.inf

    def is_over() -> bool:
        """Return whether all that happened before the end has come: a marker may still be on its way."""
        nonlocal t_end_ns
        if t_end_ns == math.inf and is_ended():
            t_end_ns = time.monotonic_ns()
        return newest_ns > t_end_ns or time.monotonic_ns() > t_end_ns + TAIL_NS

    try:
        with closing(file):
            for message in _messages(socket, math.inf if seconds is None else begun_s + seconds, is_over):
                found = _decoded(message)
                if found is not None and found.kind == HEADER:
                    if found.fields != opening.fields:
                        break  # of another daemon, which answers in place of one that was killed
                elif found is not None:
                    file.add(found)
                    newest_ns = found.t_ns
                    records, lost, next_seq = records + 1, lost + max(found.seq - next_seq, 0), found.seq + 1
                    if found.kind == "end":
                        break
                for inlet in inlets if records else ():
                    for measured in inlet.records(next_seq - 1):
                        file.add(measured)
                if time.monotonic() - synced_s >= SYNC_EVERY_S:
                    synced_s = time.monotonic()
                    file.sync()
    except OSError as error:
        raise HapticdError(f"{file.path}: the recording ends here ({error.strerror}): make room.") from None
    missing = f"; {lost} came too fast and are missing" if lost else ""
    return f"{file.path}: {records} records of {time.monotonic() - begun_s:.1f} s{missing}{inlets.summary()}"


def _opening(socket: zmq.Socket[bytes], directory: Path, wait: _Wait, is_ended: Callable[[], bool]) -> Record:
    """The first header: sent to this recorder, or to another that attached at the same time."""
    deadline_s = time.monotonic() + HEADER_WITHIN_S
    for message in _messages(socket, math.inf, is_ended):
        found = _decoded(message)
        if found is not None and found.kind == HEADER:
            return found
        if message.startswith(WAITS):
            wait.begin(message.removeprefix(WAITS))
        wait.look(time.monotonic())
        if wait.t_begin_s == math.inf and time.monotonic() > deadline_s:
            raise HapticdError(f"No hapticd answers in {directory}: start one, or name its directory with --endpoint.")
    raise HapticdError("Nothing is recorded: it ended before the recording began.")


class _Wait:
    """The time until the daemon can restart its core, from `begin` on: at most `wait_s`."""

    def __init__(
        self, context: zmq.Context[zmq.Socket[bytes]], socket: zmq.Socket[bytes], wait_s: float, notify: Notify
    ) -> None:
        self._context, self._socket, self._notify = context, socket, notify
        self._now_s, self._notify_s = wait_s, SOON_S  # after the begin, each once
        self.t_begin_s = math.inf
        self._pad: PadSender | None = None

    def begin(self, rig_directory: bytes) -> None:
        """The daemon waits, on the simulated plate of that rig unless it is empty."""
        if self.t_begin_s == math.inf:
            self.t_begin_s = time.monotonic()
            self._pad = PadSender(self._context, Path(os.fsdecode(rig_directory))) if rig_directory else None

    def look(self, t_now_s: float) -> None:
        """Keep scripted fingers lifted, notify a person, and in the end have the recording begin in mid-session."""
        if self._pad is not None:
            self._pad.lift_scripted()
        if t_now_s - self.t_begin_s > self._notify_s:
            self._notify_s = math.inf
            self._notify(WAITING)
        if t_now_s - self.t_begin_s > self._now_s:
            self._now_s = math.inf
            self._socket.unsubscribe(WHOLE)
            self._socket.subscribe(NOW)

    def close(self) -> None:
        """Let scripted fingers land again."""
        if self._pad is not None:
            self._pad.close()


def _messages(socket: zmq.Socket[bytes], deadline_s: float, is_ended: Callable[[], bool]) -> Iterator[bytes]:
    """The messages until the deadline or the end; b"" where none came for a moment."""
    try:
        while time.monotonic() < deadline_s and not is_ended():
            yield socket.recv() if socket.poll(POLL_MS) else b""
    except KeyboardInterrupt:
        return


def _decoded(message: bytes) -> Record | None:
    """The record of a message; None for any other message. The daemon is this machine's own, and trusted."""
    if not message.startswith(WHOLE):
        return None
    return Record(*msgpack.unpackb(message.removeprefix(WHOLE), strict_map_key=False))
