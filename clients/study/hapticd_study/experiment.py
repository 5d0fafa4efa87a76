"""An experiment as a person writes it, in TOML: what varies, what the plate does in a trial, and what is asked.

`paper.toml` is the paper's evaluation. `[plate]` is a message of the contract (`targets`, `virtuals`, `surfaces`,
`effects` of clients/PROTOCOL.md), in which "$factor" stands for the trial's level of a factor, "$factor.key" for an
entry of that level, "$level" for what an adaptive method chooses, and a target's `finger = 1` for the participant's
first finger, 2 for the second.
"""

from __future__ import annotations

import errno
import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from msgspec import Meta, field

from hapticd_client import HapticdError
from hapticd_contract.base import Contract
from hapticd_contract.sentences import ContractError, converted
from hapticd_contract.targets import ClientTargets

PAPER: Final = Path(__file__).with_name("paper.toml")
MAX_BYTES: Final = 1 << 18
MAX_TRIALS: Final = 1000
MAX_LEVELS: Final = 100
MAX_CONDITIONS: Final = 1000
MAX_ANSWERS: Final = 9  # the keys 1 .. 9
CONFIDENCE: Final = 0.95  # of all intervals
LEVEL: Final = "level"  # of an adaptive method
INTERVAL_ANSWERS: Final = {"first": "the first one", "second": "the second one"}

Number = Annotated[float, Meta(ge=-1e6, le=1e6)]
Positive = Annotated[float, Meta(ge=1e-6, le=1e6)]
Count = Annotated[int, Meta(ge=0, le=MAX_TRIALS)]
Lapse = Annotated[float, Meta(ge=0.0, le=0.2)]
Level = Number | str
Text = Annotated[str, Meta(max_length=1000)]
LevelNumbers = Annotated[tuple[Number, ...], Meta(min_length=1, max_length=MAX_LEVELS)]
Levels = Mapping[str, Level]  # of a trial, by factor


class StudyError(HapticdError):
    """A session cannot be started or continued, or a study not analysed, as requested."""

    exit_code = 2


class Intervals(Contract, frozen=True, kw_only=True):
    """A trial of two intervals: in one, drawn, `of` (a factor, or "level") is at its `standard`."""

    of: str
    standard: Level
    touched_s: Annotated[float, Meta(ge=0.2, le=60.0)] = 1.5
    pause_s: Annotated[float, Meta(ge=0.1, le=10.0)] = 0.5


class Staircase(Contract, frozen=True, kw_only=True, tag_field="method", tag="staircase"):
    """A transformed up-down staircase (Levitt 1971): harder after `down` right answers in a row, easier after `up`
    wrong ones; 1 up, 2 down converges to 70.7 % right. Steps are `first_step` until `coarse_reversals`, then `step`."""

    start: Number
    step: Positive
    first_step: Positive | None = None
    coarse_reversals: Annotated[int, Meta(ge=0, le=100)] = 2
    lowest: Number
    highest: Number
    up: Annotated[int, Meta(ge=1, le=10)] = 1
    down: Annotated[int, Meta(ge=1, le=10)] = 2
    harder: Literal["lower", "higher"] = "lower"

    def problem(self) -> str:
        return "" if self.lowest <= self.start <= self.highest else ".start: must be within lowest .. highest."


class QuestPlus(Contract, frozen=True, kw_only=True, tag_field="method", tag="quest+"):
    """QUEST+ (Watson 2017): of `levels` the one from which most is learned of threshold and spread, a cumulative normal
    function's mean and standard deviation; by the package `questplus`."""

    levels: LevelNumbers
    thresholds: LevelNumbers | None = None
    spreads: LevelNumbers
    lapses: Annotated[tuple[Lapse, ...], Meta(min_length=1, max_length=10)] = (0.0, 0.02, 0.05)
    harder: Literal["lower", "higher"] = "lower"

    def problem(self) -> str:
        return "" if min(self.spreads) > 0 else ".spreads: must be above 0."


class Experiment(Contract, frozen=True, kw_only=True):
    """All trials of a session, by the keys of README.md. Raises nothing: `parse` checks it."""

    name: Annotated[str, Meta(max_length=32)] = "study"
    question: Text
    training: Text = ""
    answers: Annotated[dict[str, Text], Meta(max_length=MAX_ANSWERS)] = field(default_factory=dict)
    correct: str = ""
    factors: Annotated[
        dict[str, Annotated[tuple[Level, ...], Meta(min_length=1, max_length=MAX_LEVELS)] | dict[str, dict[str, Any]]],
        Meta(max_length=10),
    ] = field(default_factory=dict)
    trials: Annotated[int, Meta(ge=1, le=MAX_TRIALS)]
    practice: Count = 0
    feedback: bool = False
    break_after: Count = 0
    rest_s: Annotated[float, Meta(ge=0.0, le=60.0)] = 1.0
    blocks: str = ""
    curve: str = ""
    intervals: Intervals | None = None
    adaptive: Staircase | QuestPlus | None = None
    plate: dict[str, Any]

    @property
    def choices(self) -> Mapping[str, str]:
        """Answers with their labels."""
        return INTERVAL_ANSWERS if self.intervals is not None else self.answers

    @property
    def is_graded(self) -> bool:
        """Whether answers are right or wrong."""
        return self.intervals is not None or self.correct != ""

    @property
    def abscissa(self) -> str:
        """The factor of the psychometric function; empty for none."""
        return self.curve or (LEVEL if self.adaptive is not None else "")

    def conditions(self, without: str = "") -> tuple[Levels, ...]:
        """Return all combinations of levels, of factors other than `without`."""
        factors = {name: tuple(levels) for name, levels in self.factors.items() if name != without}
        return tuple(dict(zip(factors, levels, strict=True)) for levels in product(*factors.values()))

    def targets(self, levels: Levels) -> ClientTargets:
        """Return the plate's message in a trial with these levels. Raises StudyError."""
        try:
            message = {"client": "study", **_filled(self.plate, levels, self.factors)}
            made: ClientTargets = converted(message, ClientTargets)
        except ContractError as error:
            raise StudyError(f"plate.{error}") from None
        return made

    def problem(self) -> str:
        return next(_problems(self), "")


def read_file(path: Path, max_bytes: int) -> bytes:
    """Return a file's bytes. Raises OSError, also for what is not a regular file of at most `max_bytes`."""
    if path.exists() and not (path.is_file() and path.stat().st_size <= max_bytes):
        raise OSError(errno.EINVAL, f"Not a regular file of at most {max_bytes} bytes", str(path))
    return path.read_bytes()


def load(path: Path) -> Experiment:
    """Read an experiment. Raises StudyError with the place and the remedy."""
    try:
        return parse(tomllib.loads(read_file(path, MAX_BYTES).decode()))
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({error.strerror}): check --protocol.") from None
    except (ValueError, RecursionError) as error:  # TOML's and UTF-8's
        raise StudyError(f"{path}: is not TOML ({str(error)[:100]}).") from None
    except StudyError as error:
        raise StudyError(f"{path}: {error}") from None


def parse(table: Any) -> Experiment:
    """Return the experiment of plain values, with each of its conditions tried. Raises StudyError."""
    try:
        made: Experiment = converted(table, Experiment)
    except ContractError as error:
        raise StudyError(str(error).replace("clients/PROTOCOL.md", "clients/study/README.md")) from None
    except (OverflowError, RecursionError):
        raise StudyError("has more than an experiment can have.") from None
    for levels in made.conditions():
        for extreme in _extremes(made):
            made.targets({**levels, **extreme})
    return made


def _extremes(made: Experiment) -> Iterator[Levels]:
    """Yield what `targets` is tried with in addition to the conditions."""
    adaptive = made.adaptive
    if isinstance(adaptive, Staircase):
        yield from ({LEVEL: adaptive.lowest}, {LEVEL: adaptive.highest})
    elif isinstance(adaptive, QuestPlus):
        yield from ({LEVEL: level} for level in adaptive.levels)
    else:
        yield {}
    if made.intervals is not None:
        yield {made.intervals.of: made.intervals.standard}


def _problems(made: Experiment) -> Iterator[str]:
    for part in ("intervals", "adaptive"):
        value = getattr(made, part)
        if value is not None and (problem := value.problem()):
            yield f".{part}{problem}"
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9-]{0,31}", made.name):
        yield ".name: must have letters, digits and - only."
    for name in (*made.factors, *made.answers):
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}", name):
            yield f".{name}: is no name for a factor or an answer: use letters, digits, - and _."
        if name == LEVEL:
            yield f".{name}: is the name of what an adaptive method chooses: give the factor or answer another one."
    if made.intervals is None and not 2 <= len(made.answers) <= MAX_ANSWERS:
        yield f".answers: must be 2 .. {MAX_ANSWERS}, each with its label."
    if made.intervals is not None and (made.answers or made.correct):
        yield ".answers: with intervals the answers are first and second, and `correct` follows."
    known = [*made.factors, *([LEVEL] if made.adaptive is not None else [])]
    varied = made.intervals.of if made.intervals is not None else ""
    named = {"correct": made.correct, "blocks": made.blocks, "curve": made.curve, "intervals.of": varied}
    for place, name in named.items():
        if name and name not in known:
            yield f".{place}: {name!r} is not one of the factors ({', '.join(known) or 'there are none'})."
    if made.correct in made.factors and not {str(level) for level in made.factors[made.correct]} <= set(made.answers):
        yield ".correct: each level of this factor must be one of the answers."
    if made.adaptive is not None and not made.is_graded:
        yield ".adaptive: needs right and wrong answers: give `correct` or `intervals`."
    if (made.practice or made.feedback) and not made.is_graded:
        yield ".practice: its feedback needs right and wrong answers: give `correct` or `intervals`."
    if made.curve and any(isinstance(level, str) for level in made.factors.get(made.curve, ())):
        yield ".curve: needs a factor whose levels are numbers."
    if math.prod(len(levels) for levels in made.factors.values()) > MAX_CONDITIONS:
        yield f".factors: make more than {MAX_CONDITIONS} conditions."
    if made.blocks and made.trials % len(made.factors.get(made.blocks, "-")):
        yield ".trials: must be a multiple of the number of blocks."


def _filled(value: Any, levels: Levels, factors: Mapping[str, Any]) -> Any:
    """Return a part of `plate` with levels in place of "$factor". Raises StudyError for what there is not."""
    if isinstance(value, dict):
        return {name: _filled(one, levels, factors) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_filled(one, levels, factors) for one in value]
    if not (isinstance(value, str) and value.startswith("$")):
        return value
    name, _, entry = value[1:].partition(".")
    try:
        level = levels[name]
        return factors[name][level][entry] if entry else level
    except (KeyError, TypeError, IndexError):
        raise StudyError(f"plate: {value[:40]!r} is neither a factor nor an entry of its levels.") from None


def participant_name(name: str) -> str:
    """Check a participant's name, which also names the file. Raises StudyError."""
    if re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}", name):
        return name
    raise StudyError(f"participant: {name!r} must be 1 .. 32 letters, digits, - or _, such as P03.")
