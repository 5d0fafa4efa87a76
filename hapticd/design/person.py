"""A person's friction curve from comparisons with a reference: which is more slippery, plate or reference?

The amplitude that feels like the reference is where friction, exp(-amplitude / decay), is the reference's. An answer
depends on the difference of the logarithms, over noise of the person's own: at one Weber fraction three of four are
right. In a share of lapses it is a guess. All three unknown, on a grid, after each answer (A. B. Watson, QUEST+,
J. Vision 17 (2017) 3:10); the noise is logistic. The interval also has the reference's own error and a
person's leaning to one side, which no answer shows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from ..core.friction import FrictionCurve

TRIALS: Final = 40  # three minutes
LEAST_REFERENCE, MOST_REFERENCE = 0.13, 0.6  # any person's plate is that slippery; a larger one tells little
REFERENCE_SIGMA, LEANING_SIGMA = 0.05, 0.03  # of the logarithm of friction
USUAL_DECAY_UM, DECAY_SIGMA = 0.7, 0.25  # of persons, and of its logarithm
USUAL_WEBER, WEBER_SIGMA = 0.11, 0.5
FRICTION_SPEED_MM_S: Final = 2000.0  # doubles the amplitude, assumed: a film of air inf, bouncing 1000
SIGMAS: Final = 1.96  # of the interval: 95 %
SLOPE: Final = math.log(3.0)  # of the logistic function that is 3/4 at 1
ASIDE, LEAST_ASIDE = 0.6, 0.06  # sigmas from the match at which a comparison tells most, and the least, relative
CHECK_ABOVE: Final = (1, 0, 0, 1, 1, 0, 1, 0, 0, 1)  # in an order that a person does not see through
CHECK_TRIALS, CHECK_ASIDE, CHECK_MOST = len(CHECK_ABOVE), 0.1, 2  # how far off; answers of one side too many

DECAYS_UM: Final = np.geomspace(0.3, 1.6, 101)[:, None, None]
WEBERS: Final = np.geomspace(0.04, 0.4, 7)[:, None]
LAPSES: Final = np.array([0.0, 0.05, 0.15])
FULL_UM: Final = FrictionCurve.exponential().full_um


class Answer(NamedTuple):
    """The plate's amplitude, and whether it was more slippery than the reference."""

    amplitude_um: float
    is_slipperier: bool


Ask = Callable[[float], Answer]  # given the amplitude that the plate should have


class Match(NamedTuple):
    """The amplitude over which friction falls to 1/e, its relative standard deviation by the answers alone, and its
    interval, in which it is in 95 of 100 cases."""

    decay_um: float
    sigma_frac: float
    low_um: float
    high_um: float


def matched(answers: Sequence[Answer], reference: float) -> Match:
    """Return what the answers show; `reference` is its friction relative to bare glass, known to REFERENCE_SIGMA."""
    steepness = -math.log(reference)
    log_share = -0.5 * (np.log(DECAYS_UM / USUAL_DECAY_UM) / DECAY_SIGMA) ** 2
    log_share = log_share - 0.5 * (np.log(WEBERS / USUAL_WEBER) / WEBER_SIGMA) ** 2 + 0.0 * LAPSES
    for amplitude_um, is_slipperier in answers:
        off = (amplitude_um / DECAYS_UM - steepness) / WEBERS
        sure = 1.0 / (1.0 + np.exp(-SLOPE * (off if is_slipperier else -off)))
        log_share += np.log(0.5 * LAPSES + (1.0 - LAPSES) * sure + 1e-300)
    share = np.exp(log_share - log_share.max()).sum(axis=(1, 2))
    share /= share.sum()
    log_um = np.log(DECAYS_UM.ravel())
    mean = float(share @ log_um)
    sigma = math.sqrt(float(share @ (log_um - mean) ** 2))
    width = SIGMAS * math.hypot(sigma, math.hypot(REFERENCE_SIGMA, LEANING_SIGMA) / steepness)
    return Match(math.exp(mean), sigma, math.exp(mean - width), math.exp(mean + width))


def calibrated(ask: Ask, reference: float) -> Match:
    """Compare the plate with the reference, at amplitudes to either side of the match in turn."""
    answers: list[Answer] = []
    while len(answers) < TRIALS:
        found = matched(answers, reference)
        aside = max(ASIDE * found.sigma_frac, LEAST_ASIDE) * (-1.0) ** len(answers)
        answers.append(ask(min(-found.decay_um * math.log(reference) * math.exp(aside), FULL_UM)))
    return matched(answers, reference)


def checked(ask: Ask, decay_um: float, reference: float) -> int:
    """Return in how many of CHECK_TRIALS the plate was more slippery; it should be half of them, by CHECK_MOST."""
    shares = np.where(CHECK_ABOVE, 1.0 + CHECK_ASIDE, 1.0 - CHECK_ASIDE)
    return sum(ask(-decay_um * math.log(reference) * share).is_slipperier for share in shares.tolist())
