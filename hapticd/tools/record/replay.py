"""Feeds a recording to a machine made like the recorded one: the same bytes must come out, to the last bit."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from ...config.sections import Config
from ...daemon.machine import Machine
from ...errors import RecordingError
from ...files.recording.reader import Recording
from ...files.recording.records import HEARD, Record
from ...values import RawReport
from ...wire import protocol
from ...wire.framing import FrameSplitter

LONGEST_LINE_BYTES = 4096  # what is written to the board in one piece is far shorter
NAMES = {
    protocol.MSG_HELLO_REQUEST: "a greeting",
    protocol.MSG_REFERENCE: "a reference",
    protocol.MSG_KEEPALIVE: "a keep-alive",
    protocol.MSG_TIME_REQUEST: "a time request",
    protocol.MSG_CLEAR_FAULT: "a clearing of the fault",
    protocol.MSG_SET_CONTROLLER: "a choice of controller",
    protocol.MSG_SET_MODEL: "a model",
}


class Difference(NamedTuple):
    """The first line to the board that is not the recorded one; b"" where there is none."""

    t_ns: int
    seq: int
    recorded: bytes
    replayed: bytes


@dataclass(slots=True)
class Outcome:
    """What a replay found. `lost_seq` is the first missing record: what comes after it is not compared."""

    lines: int = 0
    references: int = 0
    difference: Difference | None = None
    lost_seq: int | None = None

    @property
    def is_identical(self) -> bool:
        """Every byte that was compared is the same, and all were compared."""
        return self.difference is None and self.lost_seq is None


class ModalSolution(NamedTuple):
    """One thing that the machine heard, and the lines that it wrote before it heard the next."""

    heard: Record
    written: tuple[Record, ...]


@dataclass(slots=True)
class _Board:
    """The line's other end: hears what the replayed machine writes, and takes or refuses it as the recorded did."""

    outcome: Outcome
    expected: deque[Record] = field(default_factory=deque)
    t_ns: int = 0
    seq: int = 0

    def write(self, line: bytes) -> bool:
        if not self.expected:
            self._differs(b"", line)
            return True
        recorded, is_accepted = self.expected.popleft().fields[1:]
        if line != recorded:
            self._differs(recorded, line)
        elif self.outcome.difference is None:
            self.outcome.lines += 1
            self.outcome.references += message_of(line) == protocol.MSG_REFERENCE
        return bool(is_accepted)

    def all_said(self) -> None:
        """The machine has nothing more to say of this moment: what is still expected is missing."""
        for record in self.expected:
            self._differs(record.fields[1], b"")
        self.expected.clear()

    def _differs(self, recorded: bytes, replayed: bytes) -> None:
        if self.outcome.difference is None:
            self.outcome.difference = Difference(self.t_ns, self.seq, recorded, replayed)


def replay(recording: Recording) -> Outcome:
    """Replay up to the first difference or loss. Raises RecordingError where the recording does not begin with its
    machine's start: what the machine knew by then is not in it."""
    if not recording.is_whole:
        raise RecordingError(
            f"{recording.paths[0]}: begins when the daemon ran already, and only what begins with it replays exactly: "
            "record without --now, while nothing else records, or compare settings with --set."
        )
    outcome = Outcome()
    board = _Board(outcome)
    machine = machine_of(recording, recording.header.config, board.write)
    for moment in moments(recording):
        if recording.losses.any:
            outcome.lost_seq = recording.losses.first_seq
            break
        board.expected.extend(moment.written)
        board.t_ns, board.seq = moment.heard.t_ns, moment.heard.seq
        hear(machine, moment.heard)
        board.all_said()
        if outcome.difference is not None:
            break
    return outcome


def machine_of(recording: Recording, config: Config, write_board: Callable[[bytes], bool]) -> Machine:
    """A machine that has heard nothing yet, made as the recorded one was, but with these settings."""
    header = recording.header
    return Machine(
        config,
        header.modes,
        write_board=write_board,
        instance=header.instance,
        calibration=header.calibration,
        parasitic_modes=header.parasitic_modes,
    )


def moments(recording: Recording) -> Iterator[ModalSolution]:
    """What was heard, in its order. A loss within a moment shows in `recording.losses` before it is given; of a
    recording without an end the last is left out, for its lines may be missing."""
    heard: Record | None = None
    written: list[Record] = []
    for record in recording.records():
        if record.kind == "end" and heard is not None:
            yield ModalSolution(heard, tuple(written))
            heard = None
        if record.kind == "written":
            written.append(record)
        elif record.kind in HEARD:
            if heard is not None:
                yield ModalSolution(heard, tuple(written))
            heard, written = record, []


def hear(machine: Machine, record: Record) -> None:
    """Tell the machine what the recorded one was told. Raises RecordingError for what no daemon can have heard."""
    t_ns, *values = record.fields
    try:
        if record.kind == "reports":
            machine.reports([RawReport(*report) for report in values[0]], t_ns)
        elif record.kind == "trackpad_link":
            is_up, reason, model = values
            machine.trackpad_link(is_up, reason, t_ns, model=model)
        elif record.kind == "watched":
            machine.watch(_unread if values[0] else None, t_ns)
        elif record.kind in ("targets", "request"):
            payload, user = values
            getattr(machine, record.kind)(payload, t_ns, user)
        else:  # timer, stop, board_bytes, board_link: as they are called
            getattr(machine, record.kind)(*values, t_ns)
    except Exception as error:  # made-up instants and figures fail in any way that arithmetic can
        raise RecordingError(f"Record {record.seq} ({record.kind}) cannot be replayed: {error!r}.") from error


def _unread(_: bytes) -> None:
    """Takes telemetry: a core that is looked at makes its passes at rest, too."""


def message_of(line: bytes) -> int | None:
    """The type of the message in a line to the board; None where there is none."""
    frames = FrameSplitter(LONGEST_LINE_BYTES).feed(line)
    return frames[0][0] if frames and frames[0] else None


def told(line: bytes) -> str:
    """A line to the board, for a person."""
    if not line:
        return "nothing"
    message = message_of(line)
    name = "something" if message is None else NAMES.get(message, f"message {message:#04x}")
    return f"{name}: {line.hex()}"


def report(recording: Recording, outcome: Outcome) -> str:
    """What a replay found, for a person."""
    said = f"{outcome.references} references, {outcome.lines} lines to the board"
    if outcome.difference is not None:
        t_ns, seq, recorded, replayed = outcome.difference
        after_s = (t_ns - recording.header.t_start_ns) * 1e-9
        return (
            f"first difference after {said}: at {after_s:.6f} s, in what record {seq} set going\n"
            f"recorded: {told(recorded)}\nreplayed: {told(replayed)}"
        )
    if outcome.lost_seq is not None:
        return (
            f"bit-identical up to record {outcome.lost_seq}, which is missing: {said}\n"
            f"what follows cannot be compared: {recording.losses.told()}"
        )
    return f"bit-identical: {said}" + (
        "" if recording.has_end else "\nit stops before the daemon did: that is as far as it goes"
    )
