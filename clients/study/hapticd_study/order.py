"""Order of a session's trials: shuffled by the seed, in blocks of a Latin square, or as an adaptive method decides.

SHA-256 digests shuffle, so that a session continues unchanged under any version of Python.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass

from .adaptive import next_level
from .experiment import LEVEL, MAX_TRIALS, Experiment, Levels


@dataclass(frozen=True, slots=True)
class Trial:
    """One trial: `levels` by factor, the answer that is `correct` (empty for none), and with intervals whether the
    standard comes first."""

    levels: Levels
    correct: str = ""
    is_standard_first: bool = False

    @property
    def shown(self) -> dict[str, float | str]:
        """Its levels as a session file ends with them."""
        return {**self.levels, **({"correct": self.correct} if self.correct else {})}


def presented(made: Experiment, participant: str, seed: int, answers: Sequence[str] = ()) -> tuple[Trial, ...]:
    """Return the trials of a session in order; those of an adaptive method up to the one after `answers`."""
    trials = [_trial(made, seed, number, levels) for number, levels in enumerate(_planned(made, participant, seed))]
    if made.adaptive is None:
        return tuple(trials)
    decided: list[Trial] = []
    for trial, answer in zip(trials, [*answers, ""], strict=False):
        track = tuple(
            (float(earlier.levels[LEVEL]), given == earlier.correct)
            for earlier, given in zip(decided, answers, strict=False)
            if _same_track(earlier.levels, trial.levels, made.correct)
        )
        level = next_level(made.adaptive, track, 1.0 / len(made.choices))
        decided.append(Trial({**trial.levels, LEVEL: level}, trial.correct, trial.is_standard_first))
        if not answer:
            break
    return tuple(decided)


def examples(made: Experiment) -> dict[str, Levels]:
    """Return for each right answer the levels of a stimulus, at the easiest level of an adaptive method."""
    return {str(levels[made.correct]): {**levels, **_easiest(made)} for levels in reversed(made.conditions())}


def practised(made: Experiment, seed: int) -> tuple[Trial, ...]:
    """Return the trials of the practice: the easiest level of an adaptive method, in conditions that are drawn."""
    conditions, trials = made.conditions(), []
    for number in range(made.practice):
        levels = conditions[int.from_bytes(_digest(seed, f"practice {number}")[:4]) % len(conditions)]
        trials.append(_trial(made, seed, MAX_TRIALS + number, {**levels, **_easiest(made)}))
    return tuple(trials)


def latin_row(count: int, row: int) -> tuple[int, ...]:
    """Return a row of a balanced Latin square (Williams 1949): over 2 `count` rows each of `count` treatments follows
    each other equally often; over `count` rows if it is even."""
    places = [place // 2 if place % 2 == 0 else count - 1 - place // 2 for place in range(count)]
    line = tuple((place + row) % count for place in places)
    return line if count % 2 == 0 or (row // count) % 2 == 0 else line[::-1]


def _easiest(made: Experiment) -> Levels:
    """Return the level at which an adaptive method begins; none without one."""
    return {} if made.adaptive is None else {LEVEL: next_level(made.adaptive, (), 1.0 / len(made.choices))}


def _same_track(one: Levels, other: Levels, correct: str) -> bool:
    """Whether an adaptive method learns of one trial for the other: all factors are equal but the right answer."""
    return all(one[name] == level for name, level in other.items() if name not in (correct, LEVEL))


def _planned(made: Experiment, participant: str, seed: int) -> list[Levels]:
    """Return the levels of all trials but an adaptive method's."""
    if not made.blocks:
        return _shuffled(made.conditions(), made.trials, str(seed))
    found = re.search(r"\d+$", participant)
    number = int(found[0]) if found else int.from_bytes(_digest(seed, participant)[:4])
    levels = tuple(made.factors[made.blocks])
    row = latin_row(len(levels), number % (2 * len(levels)))
    others = made.conditions(without=made.blocks)
    return [
        {made.blocks: levels[place], **trial}
        for block, place in enumerate(row)
        for trial in _shuffled(others, made.trials // len(levels), f"{seed}:{block}")
    ]


def _shuffled(conditions: Sequence[Levels], trials: int, seed: str) -> list[Levels]:
    """Return each condition equally often, shuffled; of what does not divide evenly some are drawn."""
    count = len(conditions)
    rest = list(conditions)
    first = _digest(seed, "0")
    drawn = [rest.pop((first[index] + 1) % len(rest)) for index in range(trials % count)]
    keys = {trial: _digest(seed, str(trial + 1)) for trial in range(trials)}
    pool = [*conditions] * (trials // count) + drawn
    return [pool[trial] for trial in sorted(keys, key=keys.__getitem__)]


def _trial(made: Experiment, seed: int, number: int, levels: Levels) -> Trial:
    if made.intervals is None:
        return Trial(levels, str(levels[made.correct]) if made.correct else "")
    is_standard_first = _digest(seed, f"interval {number}")[0] % 2 == 0
    return Trial(levels, "second" if is_standard_first else "first", is_standard_first)


def _digest(seed: int | str, number: str) -> bytes:
    return hashlib.sha256(f"{seed}:{number}".encode()).digest()
