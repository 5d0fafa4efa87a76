"""Wirings of the simulated plate: how amplifiers and sensors belong to its driven modes.

`identity` gives each mode an amplifier and a sensor of its own. `paper` is the founding paper's rig: four patches on
two amplifiers, v_x = V_A - V_C + V_B - V_D and v_y = V_A - V_C - V_B + V_D, so that each amplifier drives the sum or
the difference of the modes; the sensors see them so too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ...values import FloatArray

IDENTITY: Final = "identity"
PAPER: Final = "paper"
WIRINGS: Final = (IDENTITY, PAPER)

_SUM_AND_DIFFERENCE = ((1.0, 1.0), (1.0, -1.0))


@dataclass(frozen=True, slots=True)
class Wiring:
    """The true wiring and the board's: matrices (M, M), and what one volt of the board's `drive` does to a mode.

    `drives` modes by amplifiers, `senses` sensors by modes; `drive` amplifiers by modes, at most 1, and `sense` modes
    by sensors are their inverses.
    """

    drives: FloatArray
    senses: FloatArray
    drive: FloatArray
    sense: FloatArray
    gain: float


def wiring(name: str, modes: int) -> Wiring:
    """Return a wiring of WIRINGS for a plate with this many driven modes. Raises ValueError."""
    if name not in WIRINGS:
        raise ValueError(f"there is no wiring {name!r}; choose from {', '.join(WIRINGS)}.")
    own = np.eye(modes)
    if name == IDENTITY:
        return Wiring(own, own, own, own, 1.0)
    if modes != 2:
        raise ValueError(
            f"the paper's wiring has two amplifiers for two modes, and this plate drives {modes}: "
            "choose the reference plate, or 2 modes."
        )
    mixed = np.array(_SUM_AND_DIFFERENCE)
    return Wiring(mixed, mixed / np.sqrt(2.0), mixed, mixed / np.sqrt(2.0), 2.0)
