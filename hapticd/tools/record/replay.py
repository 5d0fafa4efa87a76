"""Replay: feeds a recording's inputs to a machine made like the recorded one, and compares its output bit by bit."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from ... import board_protocol as protocol
from ...daemon.machine import Machine
from ...errors import RecordingError
from ...files.recording.kinds import INPUTS, KINDS, Record, pad_of
from ...files.recording.mcap_reader import Recording
from ...values import RawReport
from ...wire.framing import FrameSplitter

LONGEST_LINE_BYTES = 4096  # what is written to the board in one piece is far shorter
NAMES = {value: name for name, value in vars(protocol).items() if name.startswith("MSG_")}


class Difference(NamedTuple):
    """The first line to the board that is not the recorded one; b"" where there is none."""

    t_ns: int
    seq: int
    recorded: bytes
    replayed: bytes


@dataclass(slots=True)
class _Outcome:
    """Result of a replay. `lost_seq` is the first missing record: what comes after it is not compared."""

    lines: int = 0
    references: int = 0
    difference: Difference | None = None
    lost_seq: int | None = None

    @property
    def is_identical(self) -> bool:
        """Every byte that was compared is the same, and all were compared."""
        return self.difference is None and self.lost_seq is None


@dataclass(slots=True)
class _Board:
    """Takes what the replayed machine writes, and accepts or refuses it as the recorded line did."""

    outcome: _Outcome
    expected: deque[Record] = field(default_factory=deque)
    t_ns: int = 0
    seq: int = 0

    def write(self, line: bytes) -> int | None:
        if not self.expected:
            self._differs(b"", line)
            return self.t_ns
        fields = self.expected.popleft().fields
        recorded, is_accepted = fields["line"], fields["is_accepted"]
        if line != recorded:
            self._differs(recorded, line)
        elif self.outcome.difference is None:
            self.outcome.lines += 1
            self.outcome.references += message_of(line) == protocol.MSG_REFERENCE
        return self.t_ns if is_accepted else None

    def end_step(self) -> None:
        """The machine writes nothing more in this step: what is still expected is missing."""
        for record in self.expected:
            self._differs(record.fields["line"], b"")
        self.expected.clear()

    def _differs(self, recorded: bytes, replayed: bytes) -> None:
        if self.outcome.difference is None:
            self.outcome.difference = Difference(self.t_ns, self.seq, recorded, replayed)


def replay(recording: Recording) -> _Outcome:
    """Replay up to the first difference or loss. Raises RecordingError where the recording does not begin with its
    machine's start: the machine's state by then is not in it."""
    if not recording.is_whole:
        raise RecordingError(
            f"{recording.paths[0]}: begins when the daemon ran already, and only what begins with it replays exactly: "
            "record without --now, while nothing else records."
        )
    outcome = _Outcome()
    board = _Board(outcome)
    header = recording.header
    machine = Machine(
        header.config,
        header.modes,
        write_board=board.write,
        instance=header.instance,
        calibration=header.calibration,
        parasitic_modes=header.parasitic_modes,
    )
    for given, lines in _steps(recording.records()):
        if recording.losses.any:
            outcome.lost_seq = recording.losses.first_seq
            break
        board.expected.extend(lines)
        board.t_ns, board.seq = given.t_ns, given.seq
        feed(machine, given)
        board.end_step()
        if outcome.difference is not None:
            break
    return outcome


def _steps(records: Iterable[Record]) -> Iterator[tuple[Record, list[Record]]]:
    """The inputs in their order, each with the lines to the board before the next. A loss within a step shows in the
    recording's `losses` before it is given. Without an "end" record the last is left out, for its lines may be
    missing."""
    current: Record | None = None
    lines: list[Record] = []
    for record in records:
        if record.kind == "written":
            lines.append(record)
        elif record.kind in (*INPUTS, "end"):
            if current is not None:
                yield current, lines
            current, lines = record, []


def feed(machine: Machine, record: Record) -> None:
    """Give the machine a recorded input. Raises RecordingError for what no daemon can have received."""
    fields, t_ns = record.fields, record.t_ns
    try:
        match record.kind:
            case "reports":
                machine.reports([RawReport(report["t_host_ns"], report["data"]) for report in fields["reports"]], t_ns)
            case "trackpad_link":
                machine.trackpad_link(fields["is_up"], fields["reason"], t_ns, pad=pad_of(fields))
            case "watched":
                machine.watch(_discard if fields["is_watched"] else None, t_ns)
            case "targets":
                machine.targets(fields["payload"], t_ns, fields["user"], fields.get("waited_ns", 0))
            case "request":
                machine.request(fields["payload"], t_ns, fields["user"], fields.get("waited_ns", 0))
            case kind:  # of all others the fields are in the order of the arguments
                getattr(machine, kind)(*(fields[name] for name in KINDS[kind].form), t_ns)
    except Exception as error:  # made-up instants and figures fail in any way that arithmetic can
        raise RecordingError(f"Record {record.seq} ({record.kind}) cannot be replayed: {error!r}.") from error


def _discard(_: bytes) -> None:
    """Takes telemetry: a machine with subscribers makes its passes at rest, too."""


def message_of(line: bytes) -> int | None:
    """The type of the message in a line to the board; None where there is none."""
    frames = FrameSplitter(LONGEST_LINE_BYTES).feed(line)
    return frames[0][0] if frames and frames[0] else None


def _described(line: bytes) -> str:
    """A line to the board, for a person."""
    return f"{NAMES.get(message_of(line) or 0, 'no message')} {line.hex()}" if line else "nothing"


def report(recording: Recording, outcome: _Outcome) -> str:
    """The outcome of a replay, for a person."""
    compared = f"{outcome.references} references, {outcome.lines} lines to the board"
    if outcome.difference is not None:
        t_ns, seq, recorded, replayed = outcome.difference
        after_s = (t_ns - recording.header.t_start_ns) * 1e-9
        return (
            f"first difference after {compared}: at {after_s:.6f} s, in the effects of record {seq}\n"
            f"recorded: {_described(recorded)}\nreplayed: {_described(replayed)}"
        )
    losses = recording.losses.report()
    if outcome.lost_seq is not None:
        return (
            f"bit-identical up to record {outcome.lost_seq}, which is missing: {compared}\n"
            f"what follows cannot be compared: {losses}"
        )
    lines = [f"bit-identical: {compared}"]
    if not recording.has_end:
        lines.append(f"it stops before the daemon did{f' ({losses})' if losses else ''}: that is as far as it goes")
    return "\n".join(lines)
