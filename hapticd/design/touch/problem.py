"""Unknowns of a fit to touches: its parameters in one vector, their priors, and a state after a step of them."""

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
    are_points: bool = False  # fingers act where their centre is

    @property
    def spread_mm2(self) -> float:
        """Assumed spread of a touch."""
        return 0.0 if self.are_points else SPREAD_MM2

    def parts(self, state: FitState) -> list[FloatArray]:
        """Return the parameters as distances from their priors' means, real: waves, pad, sense, contrasts of
        touches, spreads, own rates, rates; those that are not free are empty."""
        found, none = state.calibration, np.zeros(0)
        return [
            found.waves.ravel() if self.free.waves else none,
            found.pad if self.free.pad else none,
            _reals((found.sense - np.eye(len(found.sense))).ravel()[1:]) if self.free.sense else none,
            state.apart_mm.ravel() if self.free.apart else none,
            state.spread_mm2 - self.spread_mm2,
            _reals(state.own.ravel()),
            _reals(state.rates.ravel()),
        ]

    def split(self, state: FitState, vector: FloatArray) -> list[FloatArray]:
        """Return the `parts` of a vector (P,)."""
        return np.split(vector, np.cumsum([part.size for part in self.parts(state)])[:-1])

    def priors(self, state: FitState) -> FloatArray:
        """One sigma of each parameter; how far apart touches are, is learned from them (a variance of inverse gamma
        distribution makes it Student's)."""
        waves, pad, sense, apart, touches, *_ = (part.size for part in self.parts(state))
        modes = len(state.own)
        own = np.where(np.arange(self.model.splines.shape[-1]) == 0, _LOOSE, DRIFT_PRIOR_1_S)
        rate = np.where(np.arange(self.model.terms.shape[-1]) < modes, COUPLING_PRIOR_1_S, _LOOSE)
        square_mm2 = APART_WEIGHT * APART_PRIOR_MM**2 + float((state.apart_mm**2).sum())
        apart_mm = math.sqrt(square_mm2 / (APART_WEIGHT + state.apart_mm.size))
        return np.concatenate(
            (
                np.zeros(0) if self.model.waves is None else self.model.waves.prior.ravel()[:waves],
                PAD_PRIOR[:pad],
                np.full(sense, SENSE_PRIOR),
                np.full(apart, apart_mm),
                np.full(touches, _FIXED if self.are_points else SPREAD_PRIOR_MM2),
                np.tile(own, 2 * modes),
                np.tile(rate, 2 * modes),
            )
        )

    def stepped(self, state: FitState, step: FloatArray, loads: ComplexArray) -> FitState:
        """Return the state after a step of all parameters (P,) and loads (B, N)."""
        waves, pad, sense, apart, spread, own, rates = self.split(state, step)
        found = state.calibration
        return FitState(
            stepped(found, pad, complex_of(sense), waves) if any(self.free) else found,
            state.rates + complex_of(rates).reshape(state.rates.shape),
            state.own + complex_of(own).reshape(state.own.shape),
            state.loads + loads,
            np.clip(state.spread_mm2 + spread, 0.0, MOST_SPREAD_MM2),
            state.apart_mm + apart.reshape(-1, 2) if apart.size else state.apart_mm,
        )


def _reals(values: ComplexArray) -> FloatArray:
    return np.concatenate((values.real, values.imag))


def complex_of(parts: FloatArray) -> ComplexArray:
    """The real halves of the last axis, then the imaginary ones."""
    half = parts.shape[-1] // 2
    return np.asarray(parts[..., :half] + 1j * parts[..., half:], np.complex128)
