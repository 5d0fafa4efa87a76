"""Adaptive methods: the next level from a track's levels and whether the answers were right."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from .experiment import QuestPlus, Staircase

LevelTrack = tuple[tuple[float, bool], ...]  # (level, whether the answer was right), in order


@lru_cache(maxsize=4096)  # an order asks again for all earlier trials
def next_level(method: Staircase | QuestPlus, track: LevelTrack, guess_frac: float) -> float:
    """Return the level of the next trial."""
    if isinstance(method, Staircase):
        return _climbed(method, track)
    return _sign(method) * float(_posterior(method, track, guess_frac).next_stim["intensity"])


def _climbed(method: Staircase, track: LevelTrack) -> float:
    sign = -1.0 if method.harder == "lower" else 1.0
    level, rights, wrongs, turns, direction = method.start, 0, 0, 0, 0.0
    for _, is_right in track:
        rights, wrongs = (rights + 1, 0) if is_right else (0, wrongs + 1)
        step = sign if rights == method.down else -sign if wrongs == method.up else 0.0
        if step == 0.0:
            continue
        rights = wrongs = 0
        turns += step * direction < 0.0
        direction = step
        size = method.first_step if method.first_step and turns < method.coarse_reversals else method.step
        level = min(max(level + step * size, method.lowest), method.highest)
    return level


def _sign(method: QuestPlus) -> float:
    return 1.0 if method.harder == "lower" else -1.0


def _posterior(method: QuestPlus, track: LevelTrack, guess_frac: float) -> Any:
    """Return the posterior after a track; that of the last call goes on if the track does."""
    given, (before, posterior) = (method, guess_frac), _LAST.pop((method, guess_frac), ((), None))
    if posterior is None or track[: len(before)] != before:
        before, posterior = (), _prior(method, guess_frac)
    for level, is_right in track[len(before) :]:
        outcome = {"response": "Yes" if is_right else "No"}
        posterior.update(stim={"intensity": _sign(method) * level}, outcome=outcome)
    _LAST.clear()
    _LAST[given] = (track, posterior)
    return posterior


_LAST: dict[tuple[QuestPlus, float], tuple[LevelTrack, Any]] = {}


def _prior(method: QuestPlus, guess_frac: float) -> Any:
    from questplus import QuestPlus as Posterior  # takes seconds

    return Posterior(
        stim_domain={"intensity": [_sign(method) * level for level in method.levels]},
        param_domain={
            "mean": [_sign(method) * level for level in method.thresholds or method.levels],
            "sd": list(method.spreads),
            "lower_asymptote": [guess_frac],
            "lapse_rate": list(method.lapses),
        },
        outcome_domain={"response": ["Yes", "No"]},
        func="norm_cdf",
        stim_scale="linear",
    )
