"""Responses of a plate with two modes 20 Hz apart, as sweeps of its amplifiers show them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hapticd.design.commissioning.findings import PlateDesign
from hapticd.design.wiring import AmplifierSweep

DESIGN = PlateDesign((29195.0, 29215.0), (183.0, 183.0), (7.5, 7.5), (0.0, 0.0), 29205.0, 2000.0, 150.0)
OWN = np.eye(2)
SENSES = np.array([[1.0, 0.01], [0.01, 1.0]])


def sweeps(senses: npt.ArrayLike = SENSES, drives: npt.ArrayLike = OWN) -> list[AmplifierSweep]:
    """Return the sweeps with these sensors (sensors, modes) and drives (modes, amplifiers)."""
    hz = np.arange(29075.0, 29336.0, 10.0)
    modes = [
        -1j * gain / (decay - 2j * np.pi * (own_hz - hz))
        for gain, decay, own_hz in zip(DESIGN.gain_um_per_v_s, DESIGN.decay_1_s, DESIGN.frequency_hz, strict=True)
    ]
    whole = np.einsum("sp,pn,pa->sna", np.asarray(senses), np.array(modes), np.asarray(drives))
    return [AmplifierSweep(a, hz, whole[:, :, a].T) for a in range(2)]
