"""The iteration of `felt`. `felt_descent.c` is its translation, to the last bit; installation puts it in its place."""

from __future__ import annotations

import math
from array import array
from typing import Final

from ...values import WEBER_FRAC
from ..phasors import Row
from ..plate.contact import Disc, Ellipse, Shapes
from ..plate.mode_shapes import ModeShapes

UNCERTAIN_FRAC: Final = 0.01  # of a mode's amplitude: map, gain and sensor together
TO_ZERO: Final = (0.9, 0.97)  # frictions from which on a finger's points are pulled to 0, in part and altogether
RATE: Final = 0.3  # of the weights
LEAST_JND: Final = 0.02  # smaller errors weigh alike
MOST_WEIGHT: Final = 4.6  # of its logarithm: 100 either way
ROUND_UM: Final = 0.05  # of amplitude, about which |r| is rounded
MOST_LESS: Final = 1.5  # of its decay: by how much a point is pulled towards 0 at most; outwards once
SWEEPS: Final = 4  # of an iteration
PAST_FRAC: Final = 0.1  # 0.2 makes larger steps
TINY_UM: Final = 1e-9
SAFE: Final = 1e100
INSIDE: Final = 1.0 - 2.0**-50  # of a limit: rounding leads nowhere beyond it

Pieces = list[tuple[float, float, float]]  # of a friction curve: where each begins, where it would be 1, its decay


class _Point:
    """One point of a contact: its motion, the expected size of it, its friction, and its piece of the curve."""

    __slots__ = ("friction", "piece", "rms_um", "w_d_um", "w_q_um")

    def __init__(self, w_d_um: float, w_q_um: float, rms_um: float, friction: float, piece: int) -> None:
        self.w_d_um, self.w_q_um, self.rms_um = w_d_um, w_q_um, rms_um
        self.friction, self.piece = friction, piece


def contact_shapes(modes: ModeShapes, disc: Disc, contacts: list[Ellipse]) -> Shapes:
    """Return the shapes at the points of each contact (N,), of a `disc` (Q,) of radius 1."""
    shapes = array("d")
    for x_mm, y_mm, xx_mm, xy_mm, yy_mm in contacts:
        for u, v, _ in disc:
            shapes.extend(modes.at(x_mm + (xx_mm * u + xy_mm * v), y_mm + (xy_mm * u + yy_mm * v)))
    return shapes.tobytes()


def components(modal_um: Row) -> tuple[list[float], list[float]]:
    """Return the real and the imaginary parts of W (M,)."""
    return [w_um.real for w_um in modal_um], [w_um.imag for w_um in modal_um]


def phasors(d_um: list[float], q_um: list[float]) -> Row:
    """Return W (M,) of its parts."""
    return tuple(map(complex, d_um, q_um))


def descend(
    shapes: Shapes,
    weights: list[float],
    frictions: list[float],
    counted_jnd: list[float],
    stretches: list[float],
    pieces: Pieces,
    floor: tuple[float, float],
    limits_um: tuple[float, ...],
    d_um: list[float],
    q_um: list[float],
    log_weights: list[float],
    iterations: int,
    stay_frac: float,
) -> tuple[list[float], list[float]]:
    """Move W (M,), in its parts, and the fingers' weights (N,); return errors in just noticeable differences before the
    last sweeps, and the RMS over each contact after them.

    `weights` (Q,) are those of a contact's points; `frictions` and `stretches` are wanted (`felt.solve_felt`),
    `counted_jnd` is as much as each finger's error counts (`felt.counted_jnd`); `floor` is the amplitude at which the
    curve ends, and its friction there.
    """
    fingers, points, modes = len(frictions), len(weights), len(limits_um)
    rows = _rows(shapes, modes)
    errors = [0.0] * fingers
    rates_1_um = [1.0 / decay_um for _, _, decay_um in pieces]  # a division takes as long as ten products
    for _ in range(iterations):
        got = [0.0] * fingers
        moved = []
        squares = [d_um[k] * d_um[k] + q_um[k] * q_um[k] for k in range(modes)]
        for finger in range(fingers):
            for index in range(points):
                row = rows[finger * points + index]
                point = _point(row, d_um, q_um, squares, 1.0 / stretches[finger], pieces, rates_1_um, floor)
                got[finger] = got[finger] + weights[index] * point.friction
                moved.append(point)
            errors[finger] = (got[finger] - frictions[finger]) / (WEBER_FRAC * frictions[finger])
        _weigh(errors, counted_jnd, log_weights)
        curvature = [[0.0] * modes for _ in range(modes)]
        pull_d, pull_q = [0.0] * modes, [0.0] * modes
        for finger in range(fingers):
            wanted = frictions[finger]
            alpha = math.exp(log_weights[finger]) / (WEBER_FRAC * wanted)
            stickiness = _share(wanted, TO_ZERO)
            outwards = (got[finger] - wanted) / got[finger]
            outwards = 1.0 if outwards > 1.0 else (-MOST_LESS if outwards < -MOST_LESS else outwards)
            for index in range(points):
                place = finger * points + index
                point, row = moved[place], rows[place]
                rate_1_um = rates_1_um[point.piece] * (1.0 / stretches[finger])
                slope = alpha * weights[index] * point.friction * rate_1_um
                kappa = pulled = 0.0
                if stickiness > 0.0:
                    kappa = stickiness * slope / math.sqrt(point.rms_um * point.rms_um + ROUND_UM * ROUND_UM)
                if stickiness < 1.0:
                    along = (1.0 - stickiness) * slope * rate_1_um
                    aim_um = point.rms_um + pieces[point.piece][2] * stretches[finger] * outwards
                    aim_um = aim_um if aim_um > 0.0 else 0.0
                    size_um = math.sqrt(point.w_d_um * point.w_d_um + point.w_q_um * point.w_q_um)
                    pulled = along * aim_um / (size_um if size_um > TINY_UM else TINY_UM)
                    kappa += along
                towards_d, towards_q = pulled * point.w_d_um, pulled * point.w_q_um
                for k in range(modes):
                    share = kappa * row[k]
                    line = curvature[k]
                    for other in range(k + 1):
                        line[other] = line[other] + share * row[other]
                    pull_d[k] = pull_d[k] + towards_d * row[k]
                    pull_q[k] = pull_q[k] + towards_q * row[k]
        _sweep(curvature, pull_d, pull_q, limits_um, d_um, q_um, stay_frac)
    return errors, contacts_rms_um(shapes, weights, d_um, q_um)


def _point(
    row: list[float],
    d_um: list[float],
    q_um: list[float],
    squares: list[float],
    share: float,
    pieces: Pieces,
    rates_1_um: list[float],
    floor: tuple[float, float],
) -> _Point:
    w_d_um = w_q_um = uncertain = 0.0
    for k in range(len(row)):
        w_d_um += row[k] * d_um[k]
        w_q_um += row[k] * q_um[k]
        uncertain += row[k] * row[k] * squares[k]
    rms_um = math.sqrt(w_d_um * w_d_um + w_q_um * w_q_um + UNCERTAIN_FRAC * UNCERTAIN_FRAC * uncertain)
    at_um = rms_um * share
    piece = 0
    while piece + 1 < len(pieces) and at_um >= pieces[piece + 1][0]:
        piece += 1
    full_um, least = floor
    friction = math.exp((pieces[piece][1] - at_um) * rates_1_um[piece]) if at_um < full_um else least
    return _Point(w_d_um, w_q_um, rms_um, friction, piece)


def _share(friction: float, ends: tuple[float, float]) -> float:
    """Return 0 up to the lower end, 1 from the upper one on."""
    low, high = ends
    share = (friction - low) / (high - low)
    return 0.0 if share < 0.0 else (1.0 if share > 1.0 else share)


def _weigh(errors: list[float], counted_jnd: list[float], log_weights: list[float]) -> None:
    """Move the fingers' weights by as much of their errors as counts."""
    fingers = len(errors)
    logs = [0.0] * fingers
    mean = 0.0
    for finger in range(fingers):
        error = abs(errors[finger])
        error = error if error > LEAST_JND else LEAST_JND
        most = counted_jnd[finger]
        logs[finger] = math.log(error if error < most else most)
        mean += logs[finger] / fingers
    centre = 0.0
    for finger in range(fingers):
        log_weights[finger] = log_weights[finger] + RATE * (logs[finger] - mean)
        centre += log_weights[finger] / fingers
    for finger in range(fingers):
        weight = log_weights[finger] - centre
        weight = MOST_WEIGHT if weight > MOST_WEIGHT else weight
        log_weights[finger] = -MOST_WEIGHT if weight < -MOST_WEIGHT else weight


def _sweep(
    curvature: list[list[float]],
    pull_d: list[float],
    pull_q: list[float],
    limits_um: tuple[float, ...],
    d_um: list[float],
    q_um: list[float],
    stay_frac: float,
) -> None:
    """Move each mode in turn past where the sum is least with the others held, and into its limit."""
    modes = len(limits_um)
    mean = 0.0
    for k in range(modes):
        mean += curvature[k][k] / modes
    stay = stay_frac * mean
    shares = [0.0] * modes
    for k in range(modes):
        for other in range(k):
            curvature[other][k] = curvature[k][other]
    for k in range(modes):
        own = (1.0 + UNCERTAIN_FRAC * UNCERTAIN_FRAC) * curvature[k][k] + stay
        shares[k] = (1.0 + PAST_FRAC) / own if own > 0.0 else 0.0
        pull_d[k] = shares[k] * (pull_d[k] + stay * d_um[k])
        pull_q[k] = shares[k] * (pull_q[k] + stay * q_um[k])
        for other in range(modes):
            curvature[k][other] = shares[k] * curvature[k][other]
        curvature[k][k] = PAST_FRAC
    for _ in range(SWEEPS):
        for k in range(modes):
            if not shares[k] > 0.0:  # no finger feels this mode
                d_um[k] = q_um[k] = 0.0
                continue
            line = curvature[k]
            w_d_um, w_q_um = pull_d[k], pull_q[k]
            for other in range(modes):
                w_d_um -= line[other] * d_um[other]
                w_q_um -= line[other] * q_um[other]
            square = w_d_um * w_d_um + w_q_um * w_q_um
            limit_um = limits_um[k]
            if not square < SAFE * SAFE:  # shapes whose products leave the range of floats
                w_d_um = w_q_um = 0.0
            elif square > INSIDE * limit_um * limit_um:
                share = INSIDE * limit_um / math.sqrt(square)
                w_d_um, w_q_um = w_d_um * share, w_q_um * share
            d_um[k], q_um[k] = w_d_um, w_q_um


def contacts_rms_um(shapes: Shapes, weights: list[float], d_um: list[float], q_um: list[float]) -> list[float]:
    """Return the RMS amplitude over each contact (N,)."""
    points, rows = len(weights), _rows(shapes, len(d_um))
    found = []
    for start in range(0, len(rows), points):
        square = 0.0
        for index in range(points):
            row = rows[start + index]
            w_d_um = w_q_um = 0.0
            for k in range(len(row)):
                w_d_um += row[k] * d_um[k]
                w_q_um += row[k] * q_um[k]
            square += weights[index] * (w_d_um * w_d_um + w_q_um * w_q_um)
        found.append(math.sqrt(square))
    return found


def _rows(shapes: Shapes, modes: int) -> list[list[float]]:
    """Return the shapes at each point, (N Q, M)."""
    flat = array("d", shapes)
    return [flat[start : start + modes].tolist() for start in range(0, len(flat), modes)]
