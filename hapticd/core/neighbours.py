"""Modes that nobody drives: what the fingers' friction puts into them, and the amplitudes that take it back.

A finger that slips on the plate brakes it where it is, and a force at one point drives every mode that moves there. Of
those near the drive's frequency enough is left to be felt: on the reference plate a pair 84 Hz above gives the still
finger half as much as all errors of its predicted position do. With the friction's decay c (1/s, per mode with |phi| =
1 under the finger) a mode n that the amplifiers leave alone follows

    dW_n/dt = (-decay_n + j detuning_n) W_n - c sum_i phi_n(P_i) w_i,     w_i = sum_k phi_k(P_i) W_k

and settles, fast beside a finger's way across its shape, at W_n = -c sum_i phi_n(P_i) w_i / (decay_n - j detuning_n).
The still finger gets sum_n phi_n W_n of it, about a quarter turn behind: so the driven modes are given the least
change, complex, that brings the whole of what it feels back to zero.

Left out: what the amplifiers put into those modes, which no map here tells, how they damp each other, and the time in
which they settle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from .knots import Row
from .modes import ModeShapes

# Within a third of a millimetre of a common node the driven modes can hardly reach the still finger: less is taken
# back there than it feels, for the amplitudes to stay small. It is the square of a shape.
NODE_SHAPE_SQUARED: Final = 1e-3

WIRE_FRAC: Final = 1.0 - 2.0**-22  # of a limit: rounding both parts to 32 bits may lengthen a phasor by the rest


class Neighbours:
    """The modes beside the driven ones, as measured: shapes, decay (1/s) and detuning from the drive (rad/s) of each.

    `finger_decay_1_s` is what one finger adds to the decay of a mode with |phi| = 1 under it. Raises ValueError for
    numbers that are not one for each mode, or not finite.
    """

    def __init__(
        self, modes: ModeShapes, decay_1_s: Sequence[float], detuning_rad_s: Sequence[float], finger_decay_1_s: float
    ) -> None:
        if not len(decay_1_s) == len(detuning_rad_s) == modes.M:
            raise ValueError(f"{modes.M} neighbouring modes need as many decays and detunings.")
        if not all(decay > 0.0 for decay in decay_1_s):
            raise ValueError("The neighbouring modes' decays must be above 0.")
        if not all(map(math.isfinite, (*decay_1_s, *detuning_rad_s, finger_decay_1_s))):
            raise ValueError("The neighbouring modes' decays and detunings must be finite.")
        self.modes = modes
        self.decay_1_s = tuple(decay_1_s)
        self.detuning_rad_s = tuple(detuning_rad_s)
        self.finger_decay_1_s = finger_decay_1_s
        self._at = modes.at
        self._um_per_um: list[complex] = [
            -finger_decay_1_s / complex(decay, -detuning)
            for decay, detuning in zip(decay_1_s, detuning_rad_s, strict=True)
        ]

    def silenced(
        self,
        places: Sequence[tuple[float, float, float]],
        phi: Sequence[Sequence[float]],
        modal_um: Row,
        w_limit_um: Sequence[float],
    ) -> Row:
        """`modal_um` (M,) with what the still fingers among `places` (x_mm, y_mm, target_um) get of other modes taken
        back; phi (N, M) are the driven shapes there. All are scaled together where one would pass its limit."""
        still = [index for index, (_, _, target_um) in enumerate(places) if target_um == 0.0]
        if not still or len(still) == len(places):
            return modal_um
        rows = self._rows(places, phi, still)
        if len(rows) == 1:
            (row,) = rows
            felt_um = sum([shape * w_um for shape, w_um in zip(row, modal_um, strict=True)])
            share = -felt_um / (sum([abs(shape) ** 2 for shape in row]) + NODE_SHAPE_SQUARED)
            changed = [w_um + share * shape.conjugate() for w_um, shape in zip(modal_um, row, strict=True)]
        else:
            matrix, before_um = np.array(rows), np.array(modal_um)
            known = matrix @ matrix.conj().T + NODE_SHAPE_SQUARED * np.eye(len(rows))
            changed = (before_um - matrix.conj().T @ np.linalg.solve(known, matrix @ before_um)).tolist()
        return _within(changed, w_limit_um)

    def _rows(
        self, places: Sequence[tuple[float, float, float]], phi: Sequence[Sequence[float]], still: Sequence[int]
    ) -> list[list[complex]]:
        """What each still finger feels of 1 um of each driven mode, by all modes: (still, M)."""
        shapes = [self._at(x_mm, y_mm) for x_mm, y_mm, _ in places]
        rows = []
        for index in still:
            felt: list[complex] = [complex(shape) for shape in phi[index]]
            for row, near in zip(phi, shapes, strict=True):
                coupled: complex = 0j
                for um_per_um, here, there in zip(self._um_per_um, shapes[index], near, strict=True):
                    coupled += um_per_um * here * there
                for k, shape in enumerate(row):
                    felt[k] += coupled * shape
            rows.append(felt)
        return rows


def _within(modal_um: Sequence[complex], w_limit_um: Sequence[float]) -> Row:
    """Scaled together to where no mode passes its limit: the zero stays."""
    scale = 1.0
    for w_um, limit_um in zip(modal_um, w_limit_um, strict=True):
        bound_um = limit_um * WIRE_FRAC
        if abs(w_um) * scale > bound_um:
            scale = bound_um / abs(w_um)
    return tuple(modal_um) if scale == 1.0 else tuple([w_um * scale for w_um in modal_um])
