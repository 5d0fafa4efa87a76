"""Fit of every mode that a wide sweep shows besides the driven ones: what the loop meets of them.

A mode some hundred Hz outside of a narrow sweep looks like feedthrough there, and a fast loop may still make it swing.
What the driven modes leave of narrow and wide sweeps together is fitted by poles (Gustavsen and Semlyen 1999,
10.1109/61.772353), of which those are modes that rise out of what is left of the responses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ..values import ComplexArray
from .parasitic_fit import CLEAN, ParasiticPoles, relocated, residues_of
from .wiring import AmplifierSweep, MeasuredWiring

POLES: Final = 8  # to begin with
WIDTH: Final = 0.02  # of each of them, in half sweeps
REACH: Final = 1.3  # half sweeps: modes a little outside are met, too
CLEAR: Final = 10.0  # times what is left, and CLEAN of the largest response: a mode


def with_far_modes(found: MeasuredWiring, sweeps: Sequence[AmplifierSweep], most: int) -> MeasuredWiring:
    """Return the driven modes as `found`, with the `most` clearest other modes of all these sweeps, and what is left
    constant.
    """
    offset_hz = np.concatenate([sweep.frequency_hz for sweep in sweeps]) - found.centre_hz
    unit = 2.0 * math.pi * float(np.abs(offset_hz).max())
    driven = found.driven_poles(found.centre_hz)
    s: list[ComplexArray] = []
    y: list[ComplexArray] = []
    for k in range(len(found.fits)):
        own = [sweep for sweep in sweeps if sweep.amplifier == k]
        own_hz = np.concatenate([sweep.frequency_hz for sweep in own])
        at = np.asarray(2j * math.pi * (own_hz - found.centre_hz), np.complex128)
        s.append(at / unit)
        shown = (found.drives[:, k] / (at[:, None] - driven)) @ found.senses.T
        y.append(np.concatenate([sweep.response_um_per_v for sweep in own]) - shown)
    start = np.asarray(-WIDTH + 1j * np.linspace(-REACH, REACH, POLES), np.complex128)
    least = CLEAN * max(float(np.abs(sweep.response_um_per_v).max()) for sweep in sweeps)
    poles = relocated(s, y, start)
    is_other = np.abs(unit * poles[:, None] - driven).min(axis=1) > -driven.real.max()  # no rest of a driven mode
    poles = _clearest(s, y, poles[is_other], least)[:most]
    residues, constant = residues_of(s, y, poles)
    parasitic = ParasiticPoles(unit * poles, unit * residues)
    return replace(found, parasitic=parasitic, background_um_per_v=constant)


def _clearest(s: Sequence[ComplexArray], y: Sequence[ComplexArray], poles: ComplexArray, least: float) -> ComplexArray:
    """Return the poles that are modes, of which a sensor shows `least` or more, the clearest first."""
    residues, constant = residues_of(s, y, poles)
    shown = np.zeros(len(poles))
    left = []
    for k, (at, one) in enumerate(zip(s, y, strict=True)):
        parts = residues[None, :, :, k] / (at[:, None] - poles)[:, :, None]
        shown = np.maximum(shown, np.abs(parts).max(axis=(0, 2)))
        left.append(one - parts.sum(axis=1) - constant[:, k])
    noise = float(np.sqrt(np.mean(np.abs(np.concatenate(left)) ** 2)))
    return np.asarray(poles[[int(p) for p in np.argsort(-shown) if shown[p] > max(CLEAR * noise, least)]])
