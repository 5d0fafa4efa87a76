"""Session file: JSON lines, append-only, each answer flushed to the disk.

    {"kind": "session", "version": 2, "participant": .., "seed": .., "experiment": {..}, "simulated": "plate", ..}
    {"kind": "answer", "trial": 1, "answer": "low", ..}
    {"kind": "end", "presented": [{"friction": "high", "correct": "high"}, ..]}

`simulated` is there for a simulated plate. Only the last line holds the stimuli, so that an unfinished
file keeps the study blind. A line cut short by a crash is dropped, and its trial presented again.
"""

from __future__ import annotations

import fcntl
import json
import os
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, BinaryIO

import msgspec

from .experiment import Experiment, StudyError, parse, participant_name, read_file
from .order import Trial, presented

VERSION = 2
SUFFIX = ".jsonl"
BEGIN = b'{"kind": "session", '  # of every session file: others are not overwritten
ERRORS = (
    "bias_jnd",
    "median_jnd",
    "error_95_jnd",
    "felt_frac",
    "within_two_frac",
)  # as telemetry and `Answer` name them
MAX_SEED = 2**63 - 1
MAX_BYTES = 1 << 20  # of a file, which has some 10 kB

_Finite = Annotated[float, msgspec.Meta(ge=-sys.float_info.max, le=sys.float_info.max)]


@dataclass(frozen=True, slots=True)
class Answer:
    """One answer. `trial` counts from 1, `t_unix_s` is its time, `took_s` the time since the trial began.

    `touched_s` is the time of the finger on the plate, `speed_mm_s` its mean speed there, `limited_frac` the share of
    that time in which the plate missed its targets, `felt_friction` and `pressure_frac` the means of what telemetry
    says of its first finger, `bias_jnd` .. `within_two_frac` what it says of its errors in the trial, by its own belief
    of the person, `t_daemon_ns` the last state of the trial on the daemon's monotonic clock, as recordings
    have it; None where it is not known.
    """

    trial: int
    answer: str
    t_unix_s: _Finite
    took_s: _Finite
    touched_s: _Finite
    speed_mm_s: _Finite
    limited_frac: _Finite
    felt_friction: _Finite | None = None
    pressure_frac: _Finite | None = None
    bias_jnd: _Finite | None = None
    median_jnd: _Finite | None = None
    error_95_jnd: _Finite | None = None
    felt_frac: _Finite | None = None
    within_two_frac: _Finite | None = None
    t_daemon_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Session:
    """One participant's session so far; `about` holds further fields of the first line."""

    participant: str
    seed: int
    experiment: Experiment
    answers: tuple[Answer, ...] = ()
    is_over: bool = False
    about: Mapping[str, Any] = field(default_factory=dict)

    @property
    def simulated(self) -> str:
        """Simulated part: "plate", or "" for nothing."""
        return str(self.about.get("simulated", ""))

    @property
    def presented(self) -> tuple[Trial, ...]:
        """Its trials (trials,); those of an adaptive method up to the one after the last answer."""
        given = [answer.answer for answer in self.answers]
        return presented(self.experiment, self.participant, self.seed, given)

    @property
    def is_complete(self) -> bool:
        """Whether every trial is answered."""
        return len(self.answers) == self.experiment.trials


class SessionFile:
    """A running session: `append` answers, then `end` it. Creates the file, or continues it.

    `given` is the session of a new file; a file with answers keeps its own seed, design and answers. Raises StudyError
    for a file that is not a session, is of another design, or is open in another process.
    """

    def __init__(self, path: Path, given: Session) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists():
                read_file(path, MAX_BYTES)  # a pipe would block
            self._file: BinaryIO = path.open("a+b")
        except OSError as error:
            raise StudyError(f"{path}: cannot be opened ({error.strerror}): choose another --out.") from None
        try:
            self._lock(path)
            self.session = self._begin(path, given)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> SessionFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def mark_simulated_plate(self, path: Path, *, is_simulated: bool) -> None:
        """Write on which plate the session is held. Raises StudyError if its answers are from the other."""
        if is_simulated is (self.session.simulated == "plate"):
            return
        if self.session.answers:
            before = "the simulated plate" if self.session.simulated else "a real plate"
            raise StudyError(f"{path}: was started on {before}: continue there, or choose another --out.")
        about = {name: value for name, value in self.session.about.items() if name != "simulated"}
        self._restart(replace(self.session, about=about | ({"simulated": "plate"} if is_simulated else {})))

    def append(self, answer: Answer) -> None:
        """Write an answer; it is on the disk when this returns."""
        if answer.trial != len(self.session.answers) + 1 or self.session.is_complete:
            raise ValueError(f"trial {answer.trial} is not the next")
        self._write({"kind": "answer", **{name: one for name, one in asdict(answer).items() if one is not None}})
        self.session = replace(self.session, answers=(*self.session.answers, answer))

    def end(self) -> None:
        """Write the stimuli as the last line."""
        if not self.session.is_complete:
            raise ValueError("trials are missing")
        if not self.session.is_over:
            self._write({"kind": "end", "presented": [trial.shown for trial in self.session.presented]})
            self.session = replace(self.session, is_over=True)

    def _lock(self, path: Path) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StudyError(f"{path}: another hapticd-study has it open: end that first.") from None

    def _begin(self, path: Path, given: Session) -> Session:
        self._file.seek(0)
        data = self._file.read(MAX_BYTES)
        whole = data.rfind(b"\n") + 1
        if whole > 0:
            started = decode(data[:whole], str(path))
            if started.answers:
                self._file.truncate(whole)
                return started
        elif not data.startswith(BEGIN[: len(data)]):
            raise StudyError(f"{path}: is not a session of hapticd-study: choose another --out.")
        self._restart(given)
        return given

    def _restart(self, given: Session) -> None:
        self._file.truncate(0)
        header = {"kind": "session", "version": VERSION, "participant": given.participant, "seed": given.seed}
        self._write({**header, "experiment": msgspec.to_builtins(given.experiment), **given.about})
        self.session = given

    def _write(self, line: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(line).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())


def read(path: Path) -> Session:
    """Read a session file. Raises StudyError, which names a wrong line."""
    try:
        data = read_file(path, MAX_BYTES)
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({error.strerror}).") from None
    return decode(data[: data.rfind(b"\n") + 1], str(path))


def decode(data: bytes, where: str) -> Session:
    """Decode the lines of a session file. Raises StudyError and nothing else."""
    session: Session | None = None
    for number, line in enumerate(data.splitlines(), 1):
        try:
            entry = json.loads(line)
            session = _started(entry) if session is None else _with(session, entry)
        except StudyError as error:
            raise StudyError(f"{where}: line {number}: {error}") from None
        except (msgspec.ValidationError, ValueError, KeyError, TypeError, RecursionError):
            raise StudyError(
                f"{where}: line {number} is not of a session: check that this is a file of hapticd-study."
            ) from None
    if session is None:
        raise StudyError(f"{where}: holds no session yet.")
    return session


def _started(entry: dict[str, Any]) -> Session:
    if entry["kind"] != "session":
        raise ValueError("a file begins with its session")
    if entry["version"] != VERSION:
        raise StudyError(f"is of version {str(entry['version'])[:20]}, not {VERSION}: use the version that wrote it.")
    if type(entry["seed"]) is not int or not 0 <= entry["seed"] <= MAX_SEED:
        raise ValueError("a seed is a whole number")
    known = ("kind", "version", "participant", "seed", "experiment")
    about = {name: value for name, value in entry.items() if name not in known}
    if about.get("simulated", "plate") != "plate":
        raise ValueError("unknown simulation")
    return Session(participant_name(entry["participant"]), entry["seed"], parse(entry["experiment"]), about=about)


def _with(session: Session, entry: dict[str, Any]) -> Session:
    """Return the session with one more line."""
    if session.is_over:
        raise ValueError("nothing follows the end")
    if entry["kind"] == "end":
        if not session.is_complete:
            raise StudyError("ends a session that lacks answers.")
        if entry["presented"] != [trial.shown for trial in session.presented]:
            raise StudyError("does not hold what this seed presents: the file was changed.")
        return replace(session, is_over=True)
    if entry["kind"] != "answer" or session.is_complete or entry["trial"] != len(session.answers) + 1:
        raise ValueError("trials are answered in their order")
    answer = msgspec.convert(entry, Answer)
    if answer.answer not in session.experiment.choices:
        raise ValueError("an answer is one of the experiment's")
    return replace(session, answers=(*session.answers, answer))
