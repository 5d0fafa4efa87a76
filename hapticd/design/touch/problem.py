"""What a fit to touches seeks: its parameters in one vector, their priors, and a state after a step of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...values import ComplexArray, FloatArray
from .model import (
    APART_PRIOR_MM,
    APART_WEIGHT,
    COUPLING_PRIOR_1_S,
    DRIFT_PRIOR_1_S,
    MOST_SPREAD_MM2,
    PAD_PRIOR,
    SENSE_PRIOR,
    SPREAD_MM2,
    SPREAD_PRIOR_MM2,
    Calibration,
    FitState,
    Free,
    Model,
    stepped,
)

_LOOSE, _FIXED = 1e6, 1e-6  # sigma of what has no prior, and of what is known


@dataclass(frozen=True, slots=True)
class TouchProblem:
    model: Model
    free: Free
    start: Calibration
    are_points: bool = False  # fingers act where their centre is

    @property
    def sizes(self) -> tuple[int, int, int, int, int, int, int]:
        """Real parameters: pad, sense, waves, own rates, rates, contrasts of touches, spreads."""
        modes, waves = self.start.waves.shape
        pad = len(PAD_PRIOR) if self.free.pad else 0
        sense = 2 * (modes * modes - 1) if self.free.sense else 0
        return pad, sense, modes * waves if self.free.waves else 0, *self._linear

    @property
    def _linear(self) -> tuple[int, int, int, int]:
        modes, model = len(self.start.sense), self.model
        own, rates = (2 * modes * each.shape[-1] for each in (model.splines, model.terms))
        return own, rates, 2 * model.contrasts.shape[1] if self.free.apart else 0, len(model.windows.tracks)

    @property
    def spread_mm2(self) -> float:
        """What the spread of a touch is taken to be."""
        return 0.0 if self.are_points else SPREAD_MM2

    @property
    def spread_prior_mm2(self) -> float:
        """One sigma of it."""
        return _FIXED if self.are_points else SPREAD_PRIOR_MM2

    def priors(self, state: FitState) -> FloatArray:
        """One sigma of each parameter; how far apart touches are, is learned from them."""
        modes = len(self.start.sense)
        own = np.where(np.arange(self.model.splines.shape[-1]) == 0, _LOOSE, DRIFT_PRIOR_1_S)
        rate = np.where(np.arange(self.model.terms.shape[-1]) < modes, COUPLING_PRIOR_1_S, _LOOSE)
        pad, sense, waves, _, _, apart, touches = self.sizes
        lacking = np.zeros(0) if self.model.waves is None else self.model.waves.prior.ravel()
        linear = np.tile(own, 2 * modes), np.tile(rate, 2 * modes), np.full(apart, apart_prior_mm(state))
        known = np.full(touches, self.spread_prior_mm2)
        return np.concatenate((PAD_PRIOR[:pad], np.full(sense, SENSE_PRIOR), lacking[:waves], *linear, known))

    def offsets(self, state: FitState) -> FloatArray:
        """Distance of each parameter from its prior's mean."""
        found = state.calibration
        modes = len(found.sense)
        sense = (found.sense - np.eye(modes)).ravel()[1:]
        parts = [
            found.pad if self.free.pad else np.zeros(0),
            np.concatenate((sense.real, sense.imag)) if self.free.sense else np.zeros(0),
            found.waves.ravel() if self.free.waves else np.zeros(0),
            *(part.ravel() for linear in (state.own, state.rates) for part in (linear.real, linear.imag)),
            state.apart_mm.ravel() if self.free.apart else np.zeros(0),
            state.spread_mm2 - self.spread_mm2,
        ]
        return np.concatenate(parts)

    def stepped(self, state: FitState, step: FloatArray, loads: ComplexArray) -> FitState:
        """Return the state after a step of all parameters (P,) and loads (B, N)."""
        pad, sense, waves, own, rates, apart, spread = np.split(step, np.cumsum(self.sizes)[:-1])
        found = state.calibration
        if any(self.free):
            found = stepped(found, pad if pad.size else np.zeros(len(PAD_PRIOR)), complex_of(sense), waves)
        return FitState(
            found,
            state.rates + complex_of(rates).reshape(state.rates.shape),
            state.own + complex_of(own).reshape(state.own.shape),
            state.loads + loads,
            np.clip(state.spread_mm2 + spread, 0.0, MOST_SPREAD_MM2),
            state.apart_mm + apart.reshape(-1, 2) if apart.size else state.apart_mm,
        )


def apart_prior_mm(state: FitState) -> float:
    """Return one sigma of how far touches are apart: the prior's, and what these touches show, each by its numbers (a
    variance of inverse gamma distribution makes it Student's)."""
    square_mm2 = APART_WEIGHT * APART_PRIOR_MM**2 + float((state.apart_mm**2).sum())
    return math.sqrt(square_mm2 / (APART_WEIGHT + state.apart_mm.size))


def complex_of(parts: FloatArray) -> ComplexArray:
    """The real halves of the last axis, then the imaginary ones."""
    half = parts.shape[-1] // 2
    return np.asarray(parts[..., :half] + 1j * parts[..., half:], np.complex128)
