"""Fit of parasitic modes to sweeps of the driven ones: what a constant feedthrough does not explain.

Modes outside of a sweep bend its background; taken for feedthrough, that makes a fast loop swing. The poles of all
responses together are found by vector fitting (Gustavsen and Semlyen 1999, 10.1109/61.772353), the driven modes' moving
too. How many there are is judged at frequencies that were held out: each more must halve what is left there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from ..values import ComplexArray

MOST_PARASITIC: Final = 2
WORTH: Final = 0.5  # of what is left at held-out frequencies, for each pole more
CLEAN: Final = 1e-3  # of the largest response: what is left below has no need of further modes
STARTS: Final = (-2.2, -1.4, 1.4, 2.2)  # half bands from the middle of the sweep
FARTHEST: Final = 6.0  # half bands: a pole beyond, or as wide, is a background's shape and no mode
ROUNDS: Final = 15
BETTER: Final = 0.98  # of what is left at held-out frequencies: modes that explain more than noise does
AS_GOOD: Final = 1.05  # times the best
SPARE: Final = 3  # points more than unknowns of a response


@dataclass(frozen=True, slots=True)
class ParasiticPoles:
    """Poles (E,) and residues (E, sensors, amplifiers), in the units of s and of the responses times s."""

    poles: ComplexArray
    residues: ComplexArray

    def response(self, s: ComplexArray, amplifier: int) -> ComplexArray:
        """Return what the sensors see of these modes per volt of an amplifier (n, sensors)."""
        if not len(self.poles):
            return np.zeros((len(s), 1), np.complex128)
        return np.asarray((1.0 / (s[:, None] - self.poles)) @ self.residues[:, :, amplifier])

    def scaled(self, s_scale: float, response_scale: float) -> ParasiticPoles:
        """Return the same modes where s and the responses count so much each."""
        return ParasiticPoles(s_scale * self.poles, s_scale * response_scale * self.residues)


NO_PARASITIC: Final = ParasiticPoles(np.zeros(0, np.complex128), np.zeros((0, 0, 0), np.complex128))


def find_parasitic(s: Sequence[ComplexArray], y: Sequence[ComplexArray], driven: ComplexArray) -> ParasiticPoles:
    """Return the modes other than the `driven` poles (M,) in responses y (n, sensors), lists per amplifier;
    none where a constant explains the rest, or they are not to be distinguished from it."""
    half_s, half_y = [at[::2] for at in s], [one[::2] for one in y]
    best, best_cost = NO_PARASITIC.poles, _left(s, y, driven)
    if min(map(len, half_s)) < len(driven) + MOST_PARASITIC + 1 + SPARE or best_cost < CLEAN:
        return NO_PARASITIC
    for count in range(1, MOST_PARASITIC + 1):
        for start in combinations(STARTS, count):
            poles = _relocated(half_s, half_y, driven, _starting(driven, start))
            if poles is None:
                continue
            cost = _left(s, y, poles) / WORTH**count
            if cost < best_cost:
                best, best_cost = poles[len(driven) :], cost
    poles = _relocated(s, y, driven, best) if len(best) else None
    own = len(driven)
    return NO_PARASITIC if poles is None else ParasiticPoles(poles[own:], residues_of(s, y, poles)[0][own:])


def better_parasitic(
    s: Sequence[ComplexArray], y: Sequence[ComplexArray], driven: ComplexArray, outside: ComplexArray
) -> list[ParasiticPoles]:
    """Return the modes other than the `driven` poles that were found, with more at assumed frequencies, which explain
    the held-out half of the responses better: noise may hide where modes are, and still not that there are some."""
    found = np.concatenate([driven, outside])
    if min(len(at[::2]) for at in s) < len(found) + MOST_PARASITIC + 1 + SPARE:
        return []
    starts = [start for count in range(1, MOST_PARASITIC + 1) for start in combinations(STARTS, count)]
    assumed = [np.concatenate([found, _starting(driven, start)]) for start in starts]
    left = [_left(s, y, poles) for poles in assumed]
    believed = _left(s, y, found)
    if believed < CLEAN or min(left) > BETTER * believed:
        return []
    return [
        ParasiticPoles(poles[len(driven) :], residues_of(s, y, poles)[0][len(driven) :])
        for poles, one in zip(assumed, left, strict=True)
        if one < AS_GOOD * min(left) and one < believed
    ]


def residues_of(
    s: Sequence[ComplexArray], y: Sequence[ComplexArray], poles: ComplexArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return the poles' residues (P, sensors, amplifiers), and what is constant (sensors, amplifiers)."""
    solved = np.array([np.linalg.lstsq(basis(at, poles), one)[0] for at, one in zip(s, y, strict=True)])
    return solved[:, :-1].transpose(1, 2, 0), solved[:, -1].T


def _starting(driven: ComplexArray, start: Sequence[float]) -> ComplexArray:
    return np.mean(driven.real) + 1j * np.asarray(start)


def basis(s: ComplexArray, poles: ComplexArray) -> ComplexArray:
    """Return the columns (n, P + 1) of these poles, and of a constant."""
    return np.column_stack([1.0 / (s[:, None] - poles), np.ones(len(s))])


def _left(s: Sequence[ComplexArray], y: Sequence[ComplexArray], poles: ComplexArray) -> float:
    """Return the RMS that every other point of the responses, fitted with these poles, leaves at the points between."""
    left = [
        basis(at[1::2], poles) @ np.linalg.lstsq(basis(at[::2], poles), one[::2])[0] - one[1::2]
        for at, one in zip(s, y, strict=True)
    ]
    return float(np.sqrt(np.mean(np.abs(np.concatenate(left)) ** 2)))


def relocated(s: Sequence[ComplexArray], y: Sequence[ComplexArray], poles: ComplexArray) -> ComplexArray:
    """Return as many poles where they fit best, from these on."""
    for _ in range(ROUNDS):
        lefts, sides = [], []
        for at, responses in zip(s, y, strict=True):
            columns = basis(at, poles)
            own = np.linalg.qr(columns)[0]
            for response in responses.T:
                block = np.column_stack([-response[:, None] * columns[:, :-1], response])
                block = block - own @ (own.conj().T @ block)
                lefts.append(block[:, :-1])
                sides.append(block[:, -1])
        weights = np.linalg.lstsq(np.vstack(lefts), np.concatenate(sides))[0]
        poles = np.linalg.eigvals(np.diag(poles) - weights)
        poles = -np.abs(poles.real) + 1j * poles.imag
    return poles


def _relocated(
    s: Sequence[ComplexArray], y: Sequence[ComplexArray], driven: ComplexArray, outside: ComplexArray
) -> ComplexArray | None:
    """Return the driven poles, then the others, where they fit best; None if these are no modes."""
    poles = relocated(s, y, np.concatenate([driven, outside]))
    for place, pole in enumerate(driven):
        nearest = place + int(np.argmin(np.abs(poles[place:] - pole)))
        poles[[place, nearest]] = poles[[nearest, place]]
    return poles if np.abs(poles[len(driven) :]).max() < FARTHEST else None
