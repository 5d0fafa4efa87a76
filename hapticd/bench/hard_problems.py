"""Problems at the ends of the solver's range for `bench.stability`: conditions, scales, targets, places, sizes."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..core.plate.mode_shapes import ModeShapes
from ..core.solver.points.arithmetic import Rows
from ..sim.plate.ground_truth import GroundTruth

FloatArray = npt.NDArray[np.float64]
W_LIMIT_UM = (4.0, 4.0)
HALF_SIZE_MM = 58.0  # the area that fingers reach


class Problem(NamedTuple):
    """Input of one solve."""

    rows: Rows
    targets: tuple[float, ...]
    limits: tuple[float, ...]


def row_tuples(phi: FloatArray) -> Rows:
    """A mode matrix as the solver's hot path takes it."""
    return tuple(map(tuple, phi.tolist()))


def _conditioned(condition: float) -> Callable[[np.random.Generator], Problem]:
    """Two rows of this condition; in half of them the targets are so small that no limit is met."""

    def make(random: np.random.Generator) -> Problem:
        left, right = (np.linalg.qr(random.normal(size=(2, 2)))[0] for _ in range(2))
        phi = left @ np.diag([1.0, 1.0 / condition]) @ right
        return _pair(phi, random, float(random.choice([1.0, 1.0 / condition])))

    return make


def _pair(phi: FloatArray, random: np.random.Generator, slip_um: float = 1.0) -> Problem:
    """Two fingers on two modes; one of them still, in two of three."""
    targets = slip_um * np.array([1.0, 0.0 if random.random() < 2 / 3 else 0.6])
    return Problem(row_tuples(phi), tuple(targets.tolist()), W_LIMIT_UM)


def _scaled(*sizes: float) -> Callable[[np.random.Generator], Problem]:
    """Rows of these sizes: tiny, subnormal, huge, nothing."""
    return lambda random: _pair(random.uniform(-1, 1, (2, 2)) * np.array(sizes)[:, None], random)


def _equal(random: np.random.Generator) -> Problem:
    return _pair(np.repeat(random.uniform(-1, 1, (1, 2)), 2, axis=0), random)


def _wanting(target_um: float) -> Callable[[np.random.Generator], Problem]:
    return lambda random: _pair(random.uniform(-1, 1, (2, 2)), random, target_um)


def _placed(place: Callable[[np.random.Generator], FloatArray]) -> Callable[[np.random.Generator], Problem]:
    """Two fingers at places on the plate, with shapes from its map."""
    return lambda random: _pair(_map().evaluate(place(random)), random)


def _map() -> ModeShapes:
    return GroundTruth().measured_mode_map(1)


def _coincident(random: np.random.Generator) -> FloatArray:
    point_mm = random.uniform(-58, 58, (1, 2))
    return np.asarray(point_mm + np.array([[0.0, 0.0], random.choice([0.0, 1e-12, 1e-6]) * np.ones(2)]))


def _on_a_node(random: np.random.Generator) -> FloatArray:
    """The still finger where the first mode is 0 to the last bits, by bisection along x."""
    shapes, y_mm = _map(), random.uniform(-50, 50)
    x_mm = np.linspace(-50, 50, 81)
    values = shapes.evaluate(np.column_stack([x_mm, np.full_like(x_mm, y_mm)]))[:, 0]
    at = int(np.flatnonzero(np.diff(np.sign(values)))[0])
    low, high = x_mm[at], x_mm[at + 1]
    for _ in range(60):
        middle = (low + high) / 2
        same = shapes.at(middle, y_mm)[0] * values[at] > 0.0
        low, high = (middle, high) if same else (low, middle)
    return np.array([random.uniform(-50, 50, 2), [low, y_mm]])


def _at_the_edge(random: np.random.Generator) -> FloatArray:
    return np.array(random.choice([-68.75, 68.75, 1e3, -1e12], (2, 2)))


def _sized(fingers: int, modes: int) -> Callable[[np.random.Generator], Problem]:
    def make(random: np.random.Generator) -> Problem:
        targets = random.uniform(0.1, 2.0, fingers) * (random.random(fingers) < 0.7)
        return Problem(row_tuples(random.uniform(-1, 1, (fingers, modes))), tuple(targets.tolist()), (4.0,) * modes)

    return make


SITUATIONS: dict[str, Callable[[np.random.Generator], Problem]] = {
    **{f"condition {condition:.0g}": _conditioned(condition) for condition in (1.0, 1e4, 1e8, 1e12, 1e15, 1e17)},
    "equal rows": _equal,
    "a row of zeros": _scaled(1.0, 0.0),
    "rows of 1e-300": _scaled(1e-300, 1e-300),
    "a subnormal row": _scaled(1.0, 1e-318),
    "rows of 1e300": _scaled(1e300, 1e300),
    "targets of 1e12 um": _wanting(1e12),
    "subnormal targets": _wanting(1e-310),
    "coincident fingers": _placed(_coincident),
    "still finger on a node": _placed(_on_a_node),
    "at the edge, outside": _placed(_at_the_edge),
    "3 fingers, 3 modes": _sized(3, 3),
    "15 fingers, 8 modes": _sized(15, 8),
}
