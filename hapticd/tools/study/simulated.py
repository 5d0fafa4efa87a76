"""Simulated participant: answers from the true vibration of the simulated plate, with a psychometric function.

Each trial runs in virtual time: a finger explores in strokes, the virtual one follows its line. The stimulus is the
mean of the plate's true amplitude under the finger, plus the participant's own noise (the psychometric function is a
cumulative normal). The answer is the one whose stimulus of the training was nearest, so a control that leaks is
recognised less often.

Only the noise is fitted: under the paper's scheme, with fingers at 10 cm/s, such participants have on average the
paper's 73.57 % and its spread. The results under another control follow from it. Left out: disturbance by spikes,
tiredness, fluctuating attention, and learning after the training. They are no evidence about people.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ...sim import lockstep
from ...sim.fingers.paths import Touch, strokes_pair
from ...sim.fingers.scenarios import LAND_S, SPEED_MM_S, Actor
from ...sim.score import SETTLE_S, settled
from ...sim.settings import Settings, paper_settings
from .experiment import Levels, StudyError
from .order import examples
from .session import Answer, Session

NOISE_UM = 0.50  # median over participants, fitted as described above
NOISE_SPREAD = 1.05  # of its logarithm
TRIAL_S = 2.0  # of virtual time; people take longer
LEAST_TRIAL_S = LAND_S + 2 * SETTLE_S
TRAININGS = 3  # of each answer
LABORATORY = 1  # seed of plate, mode map and sensor: one laboratory for all participants


class Stimulus(NamedTuple):
    """A trial at the finger: the mean of |W|, the finger's speed, and the share of time at a limit."""

    amplitude_um: float
    speed_mm_s: float
    limited_frac: float


class SimulatedParticipant:
    """Takes part in `session` under a control `scheme` ("hapticd" or "paper").

    A session always gives the same answers, also when it is resumed; participant, strokes and noise are the same under
    either scheme. Raises StudyError for too short a trial.
    """

    def __init__(
        self, session: Session, scheme: str = "hapticd", *, speed_mm_s: float = SPEED_MM_S, trial_s: float = TRIAL_S
    ) -> None:
        if not LEAST_TRIAL_S <= trial_s < math.inf:
            raise StudyError(f"a trial of {trial_s:g} s is too short: give {LEAST_TRIAL_S:g} s or more.")
        settings = Settings(speed_mm_s=speed_mm_s)
        self._settings = paper_settings(settings) if scheme == "paper" else settings
        self._session = session
        self._stimuli = _stimuli(session)
        self._trial_s = trial_s
        self.noise_um = self.noise_of(session.seed)
        self._trained_um = self._train()

    @staticmethod
    def noise_of(seed: int) -> float:
        """Return the noise (um) of the participant with this seed: log-normal over participants."""
        return float(NOISE_UM * math.exp(NOISE_SPREAD * np.random.default_rng(seed).standard_normal()))

    def answers(self) -> Iterator[Answer]:
        """Yield the answers that the session lacks."""
        for trial in range(len(self._session.answers) + 1, self._session.experiment.trials + 1):
            yield self.answer(trial)

    def answer(self, trial: int) -> Answer:
        """Answer one trial, from 1. Its time is virtual, from the session's start."""
        rng = np.random.default_rng([self._session.seed, trial])
        strokes_seed = int(rng.integers(2**31))
        stimulus = self.play(self._session.presented[trial - 1].levels, strokes_seed)
        blurred_um = stimulus.amplitude_um + self.noise_um * rng.standard_normal()
        return Answer(
            trial=trial,
            answer=min(self._trained_um, key=lambda answer: abs(blurred_um - self._trained_um[answer])),
            t_unix_s=trial * self._trial_s,
            took_s=self._trial_s,
            touched_s=self._trial_s - LAND_S,
            speed_mm_s=stimulus.speed_mm_s,
            limited_frac=stimulus.limited_frac,
        )

    def _train(self) -> dict[str, float]:
        """Return the mean amplitude of each answer's stimulus in the training."""
        rng = np.random.default_rng([self._session.seed, 0])
        felt_um: dict[str, list[float]] = {answer: [] for answer in self._stimuli}
        for _ in range(TRAININGS):
            for answer, levels in self._stimuli.items():
                felt_um[answer].append(self.play(levels, int(rng.integers(2**31))).amplitude_um)
        return {answer: sum(all_um) / len(all_um) for answer, all_um in felt_um.items()}

    def play(self, levels: Levels, strokes_seed: int) -> Stimulus:
        """Run a trial, and evaluate the plate's true motion at the finger's true position."""
        scene = self._session.experiment.targets(levels)
        asked = {target.finger: target.amplitude_um or 0.0 for target in scene.targets}
        strokes, _ = strokes_pair(strokes_seed, speed_mm_s=self._settings.speed_mm_s)
        actors = (
            Actor(((LAND_S, asked[1]),), path=Touch(strokes, LAND_S)),
            *[Actor(((LAND_S, asked.get(one.name, 0.0)),), virtual=one.path) for one in scene.virtuals],
        )
        simulation = lockstep.Simulation(actors, self._settings, LABORATORY)
        simulation.run(self._trial_s)
        result = simulation.result("study")
        counts = settled(result.t_s, result.target_um)[:, 0]
        way_mm = np.linalg.norm(np.diff(result.finger_true_mm[counts, 0], axis=0), axis=1).sum()
        return Stimulus(
            amplitude_um=float(np.abs(result.truth_um[counts, 0]).mean()),
            speed_mm_s=float(way_mm / np.ptp(result.t_s[counts])),
            limited_frac=float(result.limited[counts].mean()),
        )


def _stimuli(session: Session) -> dict[str, Levels]:
    """Return a stimulus of each answer, in the order of the factor's levels. Raises StudyError for an experiment that
    such a participant cannot answer."""
    made = session.experiment
    scenes = [made.targets(one) for one in made.conditions()] if made.adaptive is None else []
    by_amplitude = all(
        not scene.surfaces
        and not scene.effects
        and all(target.amplitude_um is not None for target in scene.targets)
        and [target.finger for target in scene.targets if isinstance(target.finger, int)] == [1]
        for scene in scenes
    )
    if not made.correct or made.intervals is not None or not scenes or not by_amplitude:
        raise StudyError(
            "--simulate: this participant tells amplitudes apart, by one finger: rehearse this experiment with --sim."
        )
    levels = examples(made)
    return {str(level): levels[str(level)] for level in made.factors[made.correct]}
