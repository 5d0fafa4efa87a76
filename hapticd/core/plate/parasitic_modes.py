"""Parasitic (undriven) modes: how fingers excite them by friction, and the modal amplitudes that compensate it.

A finger that slips on the plate brakes it where it is, and a force at one point drives every mode that moves there. Of
those near the drive's frequency enough is left to be felt: on the reference plate a pair 84 Hz above gives the still
finger half as much as all errors of its predicted position do. With the friction's decay c (1/s, per mode with |phi| =
1 under the finger) a mode n that the amplifiers leave alone follows

    dW_n/dt = (-decay_n + j detuning_n) W_n - c sum_i phi_n(P_i) w_i,     w_i = sum_k phi_k(P_i) W_k

and settles, fast compared with a finger's motion, at W_n = -c sum_i phi_n(P_i) w_i / (decay_n - j detuning_n).
The still finger gets sum_n phi_n W_n of it, about a quarter turn behind: so the driven modes are given the least
change, complex, that brings the whole of what it feels back to zero.

Left out: what the amplifiers put into those modes, which no map here tells, how they damp each other, and the time in
which they settle. And contacts (`solver.contacts`): on the simulated plates with four amplifiers nothing of these modes
at all would raise the contrast by 1 % (fingertip plate) and 0.3 % (reference plate).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from ..phasors import Row, magnitude, re_im
from ..small_matrices import Vector, dot, solved
from .mode_shapes import ModeShapes

Shapes = tuple[float, ...]  # of modes at one point
Parts = tuple[list[float], list[float]]  # in phase with the drive, and a quarter turn behind: (M,) each

# Within a third of a millimetre of a common node the driven modes can hardly reach the still finger: less is taken
# back there than it feels, for the amplitudes to stay small. It is the square of a shape.
NODE_SHAPE_SQUARED: Final = 1e-3

WIRE_FRAC: Final = 1.0 - 2.0**-22  # of a limit: rounding both parts to 32 bits may lengthen a phasor by the rest


class ParasiticModes:
    """Measured modes other than the driven ones: shapes, decay (1/s) and detuning from the drive (rad/s) of each.

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
        um_per_um = [
            -finger_decay_1_s / complex(decay, -detuning)
            for decay, detuning in zip(decay_1_s, detuning_rad_s, strict=True)
        ]
        self._d_um_per_um: Final = [share.real for share in um_per_um]
        self._q_um_per_um: Final = [share.imag for share in um_per_um]

    def silenced(
        self,
        places: list[tuple[float, float, float]],
        phi: tuple[Shapes, ...],
        modal_um: Row,
        w_limit_um: tuple[float, ...],
    ) -> Row:
        """Return `modal_um` (M,) compensated for what the still fingers among `places` get of other modes.

        places (N): x_mm, y_mm, target_um; phi (N, M): the driven shapes there. All modes are scaled together where one
        would exceed its limit.
        """
        still = [index for index, (_, _, target_um) in enumerate(places) if target_um == 0.0]
        if not still or len(still) == len(places):
            return modal_um
        shapes = [self.modes.at(x_mm, y_mm) for x_mm, y_mm, _ in places]
        felt = [self._felt(index, phi, shapes) for index in still]
        changed_um = _zeroed(felt[0], modal_um) if len(felt) == 1 else _all_zeroed(felt, modal_um)
        return _within(changed_um, w_limit_um)

    def _felt(self, finger: int, phi: tuple[Shapes, ...], shapes: list[Shapes]) -> Parts:
        """What a finger feels of 1 um of each driven mode, by all modes; shapes (N, K): these modes under all fingers.

        In parts: as machine code they are plain floats, where complex numbers would be objects.
        """
        in_phase, behind = list(phi[finger]), [0.0] * len(phi[finger])
        own = shapes[finger]
        for braking in range(len(shapes)):
            there = shapes[braking]
            coupled_d = coupled_q = 0.0
            for mode in range(len(there)):
                product = own[mode] * there[mode]
                coupled_d += self._d_um_per_um[mode] * product
                coupled_q += self._q_um_per_um[mode] * product
            row = phi[braking]
            for driven in range(len(row)):
                in_phase[driven] = in_phase[driven] + coupled_d * row[driven]
                behind[driven] = behind[driven] + coupled_q * row[driven]
        return in_phase, behind


def _zeroed(felt: Parts, modal_um: Row) -> Parts:
    """The nearest amplitudes of which one finger feels nothing."""
    row_d, row_q = felt
    felt_d_um = felt_q_um = 0.0
    square = NODE_SHAPE_SQUARED
    for mode in range(len(row_d)):
        w_d_um, w_q_um = re_im(modal_um[mode])
        shape_d, shape_q = row_d[mode], row_q[mode]
        felt_d_um += shape_d * w_d_um - shape_q * w_q_um
        felt_q_um += shape_d * w_q_um + shape_q * w_d_um
        square += shape_d * shape_d + shape_q * shape_q
    share_d_um, share_q_um = felt_d_um / square, felt_q_um / square
    changed_d_um, changed_q_um = [], []
    for mode in range(len(row_d)):
        w_d_um, w_q_um = re_im(modal_um[mode])
        shape_d, shape_q = row_d[mode], row_q[mode]
        changed_d_um.append(w_d_um - (share_d_um * shape_d + share_q_um * shape_q))
        changed_q_um.append(w_q_um - (share_q_um * shape_d - share_d_um * shape_q))
    return changed_d_um, changed_q_um


def _all_zeroed(felt: Sequence[Parts], modal_um: Row) -> Parts:
    """The same for several fingers at once: W - A' (A A' + s I)^-1 A W, where A gives both parts of what each feels."""
    modes = len(modal_um)
    before_um = [0.0] * (2 * modes)
    for mode in range(modes):
        before_um[mode], before_um[modes + mode] = re_im(modal_um[mode])
    rows: list[Vector] = []
    for row_d, row_q in felt:
        rows.append(row_d + [-shape for shape in row_q])
        rows.append(row_q + row_d)
    known = [[dot(row, other) for other in rows[: index + 1]] for index, row in enumerate(rows)]
    for index in range(len(rows)):
        known[index][index] = known[index][index] + NODE_SHAPE_SQUARED
    shares_um = solved(known, [dot(row, before_um) for row in rows])
    for row, share_um in zip(rows, shares_um, strict=True):
        for part in range(2 * modes):
            before_um[part] = before_um[part] - share_um * row[part]
    return before_um[:modes], before_um[modes:]


def _within(changed_um: Parts, w_limit_um: tuple[float, ...]) -> Row:
    """Scaled together to where no mode passes its limit: the zero stays."""
    modal_d_um, modal_q_um = changed_um
    scale = 1.0
    for mode in range(len(modal_d_um)):
        amplitude_um, bound_um = magnitude(modal_d_um[mode], modal_q_um[mode]), w_limit_um[mode] * WIRE_FRAC
        if amplitude_um * scale > bound_um:
            scale = bound_um / amplitude_um
    return tuple([complex(modal_d_um[mode] * scale, modal_q_um[mode] * scale) for mode in range(len(modal_d_um))])
