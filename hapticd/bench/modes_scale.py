"""What "a peak of 1" costs: how often amplitudes of 4 um are met when shapes are scaled here or there.

A free plate's peaks lie at its edges, where no finger is. W_LIM = 4 um of a shape scaled to 1 over the whole plate is
some 2.7 um at the highest antinode that fingers reach; scaled to 1 over the fingers' area (10 mm from the edge) it is
4 um there and `edge` um at the edge, and asks the amplifiers for as much more. Perfect knowledge, true shapes, the
solver without fade: on random pairs of fingers at least 15 mm apart, and on the tracks of the strokes scenario.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from ..core.solver.public import solve_fast
from ..design import ModeShape
from ..sim.fingers.scenarios import SCENARIOS, SPEED_MM_S
from ..sim.plate import shapes as plate_shapes
from ..sim.plate.ground_truth import DRIVEN_MODES
from .modes import random_pairs_mm
from .modes_contact import LEAST_APART_MM, LIMIT_UM
from .tables import Table, finite_rows
from .timing import compare

FloatArray = npt.NDArray[np.float64]
Shapes = Callable[[FloatArray], FloatArray]  # points (N, 2) -> (N, M)

DEFAULT = "X Y, peak over the plate"
THIRD_MODES = ("9x6", "7x8", "11x1-1x11")


def run(*, pairs: int = 1000, seeds: Sequence[int] = (1, 2, 3, 4, 5), seconds: float = 10.0, repeats: int = 3) -> Table:
    """Compare sets of modes and their scales on `pairs` random pairs and the strokes of `seeds`."""
    anywhere = random_pairs_mm(pairs, LEAST_APART_MM)
    stroked = np.concatenate([_stroked_mm(seed, seconds) for seed in seeds])
    rows = []
    for name, (shapes, edge_um) in _alternatives().items():
        phi, stroked_phi = (shapes(where.reshape(-1, 2)).reshape(*where.shape[:2], -1) for where in (anywhere, stroked))
        limited, slip = _judged(phi)
        timing = compare({name: (partial(_judged, phi), len(phi))}, repeats)[name]
        figures = {**timing.figures(), "edge_um": edge_um, "limited_frac": limited, "slip_frac": slip}
        figures["strokes_limited_frac"], figures["strokes_slip_frac"] = _judged(stroked_phi)
        rows.append((name, figures))
    return Table(
        name="scale",
        title="scale: what a slipping finger gets of 1 um within 4 um of modal amplitude, a still finger beside it",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("limited_frac", "slip_frac"),
        time="time_us",
        error="limited_frac",
        notes=(
            f"fingers' area: {plate_shapes.BEYOND_REACH_MM:g} mm from the edge; "
            "edge: the plate's greatest motion at the limit of one mode",
        ),
    )


def _alternatives() -> dict[str, tuple[Shapes, float]]:
    """By name the shapes, and what the plate moves at most, in um, when one mode is at its limit."""
    cosines = plate_shapes.shapes(plate_shapes.COSINES, DRIVEN_MODES)
    found: dict[str, tuple[Shapes, float]] = {"X Y as cosines (no edges)": (_shapes(cosines), LIMIT_UM)}
    for third in (None, *THIRD_MODES):
        names = (*DRIVEN_MODES, *(() if third is None else (third,)))
        chosen = plate_shapes.shapes(plate_shapes.FREE_PLATE, names)
        title = " ".join(("X Y", *names[2:]))
        peaks = np.array([plate_shapes.peak_at_fingers(name) for name in names])
        found[f"{title}, peak over the plate"] = (_shapes(chosen), LIMIT_UM)
        found[f"{title}, peak at fingers"] = (_shapes(chosen, peaks), LIMIT_UM / float(peaks.min()))
    return found


def _shapes(chosen: Sequence[ModeShape], peaks: FloatArray | float = 1.0) -> Shapes:
    return lambda points: np.asarray(np.stack([shape.evaluate(points) for shape in chosen], axis=-1) / peaks)


def _stroked_mm(seed: int, seconds: float, step_s: float = 0.05) -> FloatArray:
    """Where the two fingers of the scenario are, (T, 2, 2), the slipping one first."""
    t_s = np.arange(1.0, seconds, step_s)
    actors = SCENARIOS["strokes"].build(seed, SPEED_MM_S)
    return np.stack([actor.path.position_mm(t_s) for actor in actors if actor.path is not None], axis=1)


def _judged(phi: FloatArray) -> tuple[float, float]:
    """The share of pairs that a limit binds, and the mean share of 1 um that the slipping finger gets."""
    limits = (LIMIT_UM,) * phi.shape[2]
    limited, got_um = 0, 0.0
    for slipping, still in phi.tolist():
        modal_um, is_limited = solve_fast((tuple(slipping), tuple(still)), (1.0, 0.0), limits)
        limited += is_limited
        got_um += abs(sum(value * w_um for value, w_um in zip(slipping, modal_um, strict=True)))
    return limited / len(phi), got_um / len(phi)
