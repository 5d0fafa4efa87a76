"""Parasitic (undriven) modes: how fingers excite them, and the modal amplitudes that compensate it.

A finger on the plate is a load where it is: friction brakes the plate there, mass and stiffness detune it, and a force
at one point drives every mode that moves there. Of those near the drive's frequency enough is left to be felt: on the
reference plate a pair 84 Hz above gives the still finger half as much as all errors of its predicted position do. With
the load c (1/s: decay less j times detuning, per mode with |phi| = 1 under the finger) and u_i, the whole motion under
finger i, a mode n that the amplifiers leave alone follows

    dW_n/dt = (-decay_n + j detuning_n) W_n - c sum_i phi_n(P_i) u_i
    u_i = sum_k phi_k(P_i) W_k + sum_n phi_n(P_i) W_n

and settles, fast compared with a finger's motion; k are the driven modes. With r_n = c / (decay_n - j detuning_n) the
motion under the fingers is the solution of

    u_i + sum_j (sum_n r_n phi_n(P_i) phi_n(P_j)) u_j = sum_k phi_k(P_i) W_k

so each finger feels some row of complex shapes of the driven modes. These are given the least change that brings what
the still finger feels back to zero.

Left out: what the amplifiers put into those modes, which no map here tells, and the time in which they settle. And
contacts (`solver.contacts`): on the simulated plates with four amplifiers nothing of these modes at all would raise the
contrast by 1 % (fingertip plate) and 0.3 % (reference plate).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from ..phasors import Row, magnitude, re_im
from ..small_matrices import Vector, dot, solved
from .mode_shapes import ModeShapes

_Shapes = tuple[float, ...]  # of modes at one point
_Rows = list[list[float]]
_Parts = tuple[list[float], list[float]]  # in phase with the drive, and a quarter turn behind: (M,) each

# Within a third of a millimetre of a common node the driven modes can hardly reach the still finger: less is taken
# back there than it feels, for the amplitudes to stay small. It is the square of a shape.
NODE_SHAPE_SQUARED: Final = 1e-3
ROUNDING: Final = 1e-12  # a share of large shapes' squares, by which their matrix stays positive definite

# Of a unit: so near to a resonance of a parasitic mode with the fingers on it, nothing of it is predictable.
LEAST_PIVOT_SQUARED: Final = 0.01

WIRE_FRAC: Final = 1.0 - 2.0**-22  # of a limit: rounding both parts to 32 bits may lengthen a phasor by the rest


class ParasiticModes:
    """Measured modes other than the driven ones: shapes, decay (1/s) and detuning from the drive (rad/s) of each.

    `finger_decay_1_s` and `finger_detuning_rad_s` are what one finger adds to a mode with |phi| = 1 under it. Raises
    ValueError for numbers that are not one for each mode, or not finite.
    """

    def __init__(
        self,
        modes: ModeShapes,
        decay_1_s: Sequence[float],
        detuning_rad_s: Sequence[float],
        finger_decay_1_s: float,
        finger_detuning_rad_s: float = 0.0,
    ) -> None:
        if not len(decay_1_s) == len(detuning_rad_s) == modes.M:
            raise ValueError(f"{modes.M} neighbouring modes need as many decays and detunings.")
        if not all(decay > 0.0 for decay in decay_1_s):
            raise ValueError("The neighbouring modes' decays must be above 0.")
        if not all(map(math.isfinite, (*decay_1_s, *detuning_rad_s, finger_decay_1_s, finger_detuning_rad_s))):
            raise ValueError("The neighbouring modes' decays and detunings must be finite.")
        self.modes = modes
        self.decay_1_s = tuple(decay_1_s)
        self.detuning_rad_s = tuple(detuning_rad_s)
        self.finger_decay_1_s = finger_decay_1_s
        self.finger_detuning_rad_s = finger_detuning_rad_s
        load_1_s = complex(finger_decay_1_s, -finger_detuning_rad_s)
        loads = [load_1_s / complex(*parts) for parts in zip(decay_1_s, [-d for d in detuning_rad_s], strict=True)]
        self._load_d: Final = [load.real for load in loads]
        self._load_q: Final = [load.imag for load in loads]

    def with_load(self, load_1_s: complex) -> ParasiticModes:
        """Return the same modes under fingers of this load: decay less j times detuning (1/s, rad/s)."""
        return ParasiticModes(self.modes, self.decay_1_s, self.detuning_rad_s, load_1_s.real, -load_1_s.imag)

    def silenced(
        self,
        places: list[tuple[float, float, float]],
        phi: tuple[_Shapes, ...],
        modal_um: Row,
        w_limit_um: tuple[float, ...],
    ) -> Row:
        """Return `modal_um` (M,) compensated for what the still fingers among `places` get of other modes.

        places (N): x_mm, y_mm, target_um; phi (N, M): the driven shapes there. All modes are scaled together where one
        would exceed its limit.
        """
        still = [n for n in range(len(places)) if places[n][2] == 0.0]
        if not still or len(still) == len(places):
            return modal_um
        shapes = [self.modes.at(x_mm, y_mm) for x_mm, y_mm, _ in places]
        felt = [self._moved_of_two(phi, shapes, still[0])] if len(places) == 2 else self._moved(phi, shapes, still)
        changed_um = _zeroed(felt[0], modal_um) if len(felt) == 1 else _all_zeroed(felt, modal_um)
        return _within(changed_um, w_limit_um)

    def _moved_of_two(self, phi: tuple[_Shapes, ...], shapes: list[_Shapes], finger: int) -> _Parts:
        """The row of `_moved` for one of two fingers in closed form, which takes a third of the time."""
        own, there = shapes[finger], shapes[1 - finger]
        own_d = there_d = 1.0
        own_q = there_q = both_d = both_q = 0.0
        for mode in range(len(own)):
            load_d, load_q, shape, other = self._load_d[mode], self._load_q[mode], own[mode], there[mode]
            own_d += load_d * shape * shape
            own_q += load_q * shape * shape
            there_d += load_d * other * other
            there_q += load_q * other * other
            both_d += load_d * shape * other
            both_q += load_q * shape * other
        det_d = own_d * there_d - own_q * there_q - (both_d * both_d - both_q * both_q)
        det_q = own_d * there_q + own_q * there_d - 2.0 * both_d * both_q
        square = det_d * det_d + det_q * det_q
        pivot = max(own_d * own_d + own_q * own_q, both_d * both_d + both_q * both_q)
        in_phase, behind = list(phi[finger]), [0.0] * len(phi[finger])
        if not (pivot > LEAST_PIVOT_SQUARED and square > LEAST_PIVOT_SQUARED * pivot):
            return in_phase, behind
        there_d, there_q = (there_d * det_d + there_q * det_q) / square, (there_q * det_d - there_d * det_q) / square
        both_d, both_q = (both_d * det_d + both_q * det_q) / square, (both_q * det_d - both_d * det_q) / square
        for driven in range(len(in_phase)):
            shape, other = phi[finger][driven], phi[1 - finger][driven]
            in_phase[driven] = there_d * shape - both_d * other
            behind[driven] = there_q * shape - both_q * other
        return in_phase, behind

    def _moved(self, phi: tuple[_Shapes, ...], shapes: list[_Shapes], fingers: Sequence[int]) -> list[_Parts]:
        """How each of `fingers` is moved by 1 um of each driven mode, by all modes; shapes (N, K): of these modes.

        By the amplitudes of these modes, W_n + r_n sum_i phi_n(P_i) sum_m phi_m(P_i) W_m = -r_n sum_i phi_n(P_i)
        phi_k(P_i), because there are usually fewer of them than fingers. In parts: as machine code they are plain
        floats, where complex numbers would be objects.
        """
        matrix: tuple[_Rows, _Rows] = [], []
        brought: tuple[_Rows, _Rows] = [], []
        for mode in range(len(self._load_d)):
            own = [there[mode] for there in shapes]
            products = _weighted(own, shapes)
            matrix[0].append([self._load_d[mode] * product for product in products])
            matrix[1].append([self._load_q[mode] * product for product in products])
            matrix[0][mode][mode] = matrix[0][mode][mode] + 1.0
            products = _weighted(own, phi)
            brought[0].append([self._load_d[mode] * product for product in products])
            brought[1].append([self._load_q[mode] * product for product in products])
        moved = [(list(phi[finger]), [0.0] * len(phi[finger])) for finger in fingers]
        for column in range(len(self._load_d)):
            if not _eliminate(column, matrix, brought):
                return moved
        for finger, (row_d, row_q) in zip(fingers, moved, strict=True):
            for mode, shape in enumerate(shapes[finger]):
                _subtract(row_d, row_q, shape, 0.0, brought[0][mode], brought[1][mode])
        return moved


def _weighted(weights: list[float], rows: Sequence[_Shapes]) -> list[float]:
    """The sum of rows, each times its weight."""
    total = [0.0] * len(rows[0])
    for weight, row in zip(weights, rows, strict=True):
        for place in range(len(total)):
            total[place] = total[place] + weight * row[place]
    return total


def _eliminate(column: int, matrix: tuple[_Rows, _Rows], right: tuple[_Rows, _Rows]) -> bool:
    """One step of Gauss-Jordan elimination in place, with the largest pivot; False if there is none."""
    matrix_d, matrix_q = matrix
    pivot, square = column, 0.0
    for row in range(column, len(matrix_d)):
        real, imag = matrix_d[row][column], matrix_q[row][column]
        if real * real + imag * imag > square:
            pivot, square = row, real * real + imag * imag
    if not square > LEAST_PIVOT_SQUARED:
        return False
    for rows in (*matrix, *right):
        rows[column], rows[pivot] = rows[pivot], rows[column]
    inverse_d, inverse_q = matrix_d[column][column] / square, -matrix_q[column][column] / square
    for rows_d, rows_q in (matrix, right):
        _scale(rows_d[column], rows_q[column], inverse_d, inverse_q)
    for row in range(len(matrix_d)):
        if row != column:
            share_d, share_q = matrix_d[row][column], matrix_q[row][column]
            for rows_d, rows_q in (matrix, right):
                _subtract(rows_d[row], rows_q[row], share_d, share_q, rows_d[column], rows_q[column])
    return True


def _scale(row_d: list[float], row_q: list[float], by_d: float, by_q: float) -> None:
    for place in range(len(row_d)):
        d, q = row_d[place], row_q[place]
        row_d[place], row_q[place] = by_d * d - by_q * q, by_d * q + by_q * d


def _subtract(
    row_d: list[float], row_q: list[float], by_d: float, by_q: float, other_d: list[float], other_q: list[float]
) -> None:
    for place in range(len(row_d)):
        d, q = other_d[place], other_q[place]
        row_d[place] = row_d[place] - (by_d * d - by_q * q)  # `-=` would be Python's own when compiled
        row_q[place] = row_q[place] - (by_d * q + by_q * d)


def _zeroed(felt: _Parts, modal_um: Row) -> _Parts:
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


def _all_zeroed(felt: Sequence[_Parts], modal_um: Row) -> _Parts:
    """The same for several fingers at once: W - A' (A A' + s I)^-1 A W, where A gives both parts of what each feels.

    With as many fingers as modes or more that is (A' A / s + I)^-1 W, whose matrix does not grow with them.
    """
    modes = len(modal_um)
    before_um = [0.0] * (2 * modes)
    for mode in range(modes):
        before_um[mode], before_um[modes + mode] = re_im(modal_um[mode])
    rows: list[Vector] = []
    for row_d, row_q in felt:
        rows.append(row_d + [-shape for shape in row_q])
        rows.append(row_q + row_d)
    if len(felt) >= modes:
        before_um = solved(_felt_squares(rows), before_um)
        return before_um[:modes], before_um[modes:]
    known = [[dot(row, other) for other in rows[: index + 1]] for index, row in enumerate(rows)]
    for index in range(len(rows)):
        known[index][index] = known[index][index] + _softness(known[index][index])
    shares_um = solved(known, [dot(row, before_um) for row in rows])
    for row, share_um in zip(rows, shares_um, strict=True):
        for part in range(2 * modes):
            before_um[part] = before_um[part] - share_um * row[part]
    return before_um[:modes], before_um[modes:]


def _softness(square: float) -> float:
    """What is added to the square of a row's shapes."""
    return max(NODE_SHAPE_SQUARED, square * ROUNDING)


def _felt_squares(rows: Sequence[Vector]) -> list[Vector]:
    """A' A + I, A with rows in units of the root of their softness: the lower triangle."""
    scaled = [[shape / math.sqrt(_softness(dot(row, row))) for shape in row] for row in rows]
    columns = [list(column) for column in zip(*scaled, strict=True)]
    squares = [[dot(one, other) for other in columns[: index + 1]] for index, one in enumerate(columns)]
    for index in range(len(squares)):
        squares[index][index] = squares[index][index] * (1.0 + ROUNDING) + 1.0
    return squares


def _within(changed_um: _Parts, w_limit_um: tuple[float, ...]) -> Row:
    """Scaled together to where no mode passes its limit: the zero stays."""
    modal_d_um, modal_q_um = changed_um
    scale = 1.0
    for mode in range(len(modal_d_um)):
        amplitude_um, bound_um = magnitude(modal_d_um[mode], modal_q_um[mode]), w_limit_um[mode] * WIRE_FRAC
        if amplitude_um * scale > bound_um:
            scale = bound_um / amplitude_um
    if scale < 1.0:
        modal_d_um, modal_q_um = [w_um * scale for w_um in modal_d_um], [w_um * scale for w_um in modal_q_um]
    return tuple(map(complex, modal_d_um, modal_q_um))
