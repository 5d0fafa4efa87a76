"""A simulated participant: feels the true vibration of the simulated plate, and answers as a person's odds would be.

Each trial is played in virtual time: a finger explores in strokes, the virtual one walks its line, and what the plate
does under the finger is the truth, not what the daemon believes. What is felt is the mean of that amplitude, blurred
by a noise of the participant's own (the psychometric function is a cumulative normal); it is compared with what lies
half-way between the two frictions as they were in training. So a control that leaks is recognised less often.

The noise is the one thing that is fitted: under the paper's scheme, with fingers at 10 cm/s, such participants have on
average the paper's 73.57 % and its spread. What they feel under another control follows. Left out: that spikes disturb,
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
from ...values import VirtualPath
from .protocol import Friction, StudyError
from .session import Answer, Session

NOISE_UM = 0.50  # median over participants, fitted as said above
NOISE_SPREAD = 1.05  # of its logarithm
TRIAL_S = 2.0  # of virtual time; people take longer
LEAST_TRIAL_S = LAND_S + 2 * SETTLE_S
TRAININGS = 3  # of either friction
LABORATORY = 1  # the seed of plate, cartography and sensor: one laboratory measured its plate once


class Felt(NamedTuple):
    """What a trial came to under the finger: the mean of |W|, the finger's speed, and the share of time at a limit."""

    amplitude_um: float
    speed_mm_s: float
    limited_frac: float


class SimulatedParticipant:
    """Takes part in `session` under a control `scheme` ("hapticd" or "paper").

    The same session gives the same answers, whichever of them were given before; under either scheme the participant,
    the strokes and the noise are the same. Raises StudyError for a trial too short to feel anything in.
    """

    def __init__(
        self, session: Session, scheme: str = "hapticd", *, speed_mm_s: float = SPEED_MM_S, trial_s: float = TRIAL_S
    ) -> None:
        if not LEAST_TRIAL_S <= trial_s < math.inf:
            raise StudyError(f"a trial of {trial_s:g} s cannot be felt: give {LEAST_TRIAL_S:g} s or more.")
        settings = lockstep.Settings(speed_mm_s=speed_mm_s)
        self._settings = lockstep.paper(settings) if scheme == "paper" else settings
        self._session = session
        self._trial_s = trial_s
        self.noise_um = self.noise_of(session.seed)
        self._boundary_um = self._train()

    @staticmethod
    def noise_of(seed: int) -> float:
        """The noise (um) of the participant with this seed: log-normal over participants."""
        return float(NOISE_UM * math.exp(NOISE_SPREAD * np.random.default_rng(seed).standard_normal()))

    def answers(self) -> Iterator[Answer]:
        """The answers that the session still lacks."""
        for trial in range(len(self._session.answers) + 1, self._session.design.trials + 1):
            yield self.answer(trial)

    def answer(self, trial: int) -> Answer:
        """One trial, from 1. The instant is that of virtual time, from the session's start."""
        rng = np.random.default_rng([self._session.seed, trial])
        strokes_seed = int(rng.integers(2**31))
        felt = self.feel(self._session.presented[trial - 1], strokes_seed)
        blurred_um = felt.amplitude_um + self.noise_um * rng.standard_normal()
        return Answer(
            trial=trial,
            answer=Friction.LOW if blurred_um > self._boundary_um else Friction.HIGH,
            t_unix_s=trial * self._trial_s,
            took_s=self._trial_s,
            touched_s=self._trial_s - LAND_S,
            speed_mm_s=felt.speed_mm_s,
            limited_frac=felt.limited_frac,
        )

    def _train(self) -> float:
        """Half-way between the frictions as they were felt by name."""
        rng = np.random.default_rng([self._session.seed, 0])
        felt = [self.feel(friction, int(rng.integers(2**31))) for _ in range(TRAININGS) for friction in Friction]
        return sum(one.amplitude_um for one in felt) / len(felt)

    def feel(self, friction: Friction, strokes_seed: int) -> Felt:
        """Play a trial, and judge the plate's true motion at the finger's true position."""
        own_um, walker_um = self._session.design.amplitudes_um(friction)
        strokes, _ = strokes_pair(strokes_seed, speed_mm_s=self._settings.speed_mm_s)
        line = VirtualPath(self._session.design.line_mm, self._session.design.line_speed_mm_s, loop=True)
        actors = (
            Actor(((LAND_S, own_um),), path=Touch(strokes, LAND_S)),
            Actor(((LAND_S, walker_um),), virtual=line),
        )
        simulation = lockstep.Simulation(actors, self._settings, LABORATORY)
        simulation.run(self._trial_s)
        played = simulation.result("study")
        counts = settled(played.t_s, played.target_um)[:, 0]
        way_mm = np.linalg.norm(np.diff(played.finger_true_mm[counts, 0], axis=0), axis=1).sum()
        return Felt(
            amplitude_um=float(np.abs(played.truth_um[counts, 0]).mean()),
            speed_mm_s=float(way_mm / np.ptp(played.t_s[counts])),
            limited_frac=float(played.limited[counts].mean()),
        )
