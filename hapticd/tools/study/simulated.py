"""Simulated participant: answers from the true vibration of the simulated plate, with a psychometric function.

Each trial runs in virtual time: a finger explores in strokes, the virtual one follows its line. The stimulus is the
mean of the plate's true amplitude under the finger, plus the participant's own noise (the psychometric function is a
cumulative normal). It is compared with the middle between the two frictions of the training, so a control that leaks is
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

from hapticd_contract.surfaces import VirtualPath

from ...sim import lockstep
from ...sim.fingers.paths import Touch, strokes_pair
from ...sim.fingers.scenarios import LAND_S, SPEED_MM_S, Actor
from ...sim.score import SETTLE_S, settled
from ...sim.settings import Settings, paper_settings
from .protocol import FrictionLevel, StudyError
from .session import Answer, Session

NOISE_UM = 0.50  # median over participants, fitted as described above
NOISE_SPREAD = 1.05  # of its logarithm
TRIAL_S = 2.0  # of virtual time; people take longer
LEAST_TRIAL_S = LAND_S + 2 * SETTLE_S
TRAININGS = 3  # of either friction
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
        self._trial_s = trial_s
        self.noise_um = self.noise_of(session.seed)
        self._boundary_um = self._train()

    @staticmethod
    def noise_of(seed: int) -> float:
        """Return the noise (um) of the participant with this seed: log-normal over participants."""
        return float(NOISE_UM * math.exp(NOISE_SPREAD * np.random.default_rng(seed).standard_normal()))

    def answers(self) -> Iterator[Answer]:
        """Yield the answers that the session lacks."""
        for trial in range(len(self._session.answers) + 1, self._session.design.trials + 1):
            yield self.answer(trial)

    def answer(self, trial: int) -> Answer:
        """Answer one trial, from 1. Its time is virtual, from the session's start."""
        rng = np.random.default_rng([self._session.seed, trial])
        strokes_seed = int(rng.integers(2**31))
        stimulus = self.play(self._session.presented[trial - 1], strokes_seed)
        blurred_um = stimulus.amplitude_um + self.noise_um * rng.standard_normal()
        return Answer(
            trial=trial,
            answer=FrictionLevel.LOW if blurred_um > self._boundary_um else FrictionLevel.HIGH,
            t_unix_s=trial * self._trial_s,
            took_s=self._trial_s,
            touched_s=self._trial_s - LAND_S,
            speed_mm_s=stimulus.speed_mm_s,
            limited_frac=stimulus.limited_frac,
        )

    def _train(self) -> float:
        """Return the mean amplitude of both frictions in the training."""
        rng = np.random.default_rng([self._session.seed, 0])
        stimuli = [
            self.play(friction, int(rng.integers(2**31))) for _ in range(TRAININGS) for friction in FrictionLevel
        ]
        return sum(one.amplitude_um for one in stimuli) / len(stimuli)

    def play(self, friction: FrictionLevel, strokes_seed: int) -> Stimulus:
        """Run a trial, and evaluate the plate's true motion at the finger's true position."""
        own_um, virtual_um = self._session.design.amplitudes_um(friction)
        strokes, _ = strokes_pair(strokes_seed, speed_mm_s=self._settings.speed_mm_s)
        line = VirtualPath(self._session.design.line_mm, self._session.design.line_speed_mm_s, loop=True)
        actors = (
            Actor(((LAND_S, own_um),), path=Touch(strokes, LAND_S)),
            Actor(((LAND_S, virtual_um),), virtual=line),
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
