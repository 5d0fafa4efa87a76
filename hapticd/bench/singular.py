"""Step of the reference from knot to knot at singular positions, compared with the paper's formula.

Two fingers cross the plate on random straight lines at 100 mm/s, one still, one at 1 um, shapes known exactly; a knot
every 2.8 ms. The measure: of the knots between which the determinant of the mode matrix changes its sign, the largest
change of any mode's amplitude. The paper's formula flips there from one limit to the other, 8 um. The median of all
crossings is the usual step, the largest is what the amplifiers must bear.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..config.sections import Config
from ..core.phasors import Row
from ..core.plate.mode_shapes import ModeShapes
from ..core.solver.general import solve_fast
from ..core.solver.instant import InstantSolver, PointSolver
from ..sim.plate.ground_truth import DRIVEN_MODES, GroundTruth
from .baselines.paper_scheme import invert
from .hard_problems import HALF_SIZE_MM, W_LIMIT_UM
from .solver_tracks import KNOTS, strokes_mm
from .tables import Table, finite_rows

FloatArray = npt.NDArray[np.float64]

DEFAULT = "hapticd"
PAPER = "the paper's formula"
NO_DERATING = "no derating"
ONE_STILL_UM = (1.0, 0.0)
POSITION_ERROR_MM = 0.12  # RMS on each axis: what the prediction is off by on strokes
_KNOT_NS = 2_800_000
_MAP_POINTS = 138  # a millimetre apart


def run(*, strokes: int = 40) -> Table:
    """Steps, share and price of the reference on `strokes` strokes: hapticd, without derating, and the paper."""
    price = Config().solver.derating_mm2_um2
    points_mm = strokes_mm(strokes)
    modes = _true_map()
    ways: dict[str, tuple[PointSolver, float]] = {
        DEFAULT: (solve_fast, price),
        NO_DERATING: (solve_fast, 0.0),
        PAPER: (invert, 0.0),
    }
    walks = {name: _walked(modes, points_mm, solve, price) for name, (solve, price) in ways.items()}
    return Table(
        name="singular",
        title=f"leak: the largest step at singular positions: one finger still, one at 1 um, {strokes} strokes",
        default=DEFAULT,
        rows=finite_rows([(name, _figures(modes, points_mm, walk, walks[PAPER])) for name, walk in walks.items()]),
        compared=("largest_step_um", "usual_step_um", "share_frac"),
        error="largest_step_um",
        notes=(
            "largest step: of all crossings, the mode that changes most from knot to knot; usual: the median crossing",
            "anywhere: the same of all knots, not of crossings alone; of paper: its largest step over this one",
            f"price: RMS of what {POSITION_ERROR_MM} mm of error on each axis give the still finger",
        ),
    )


def _true_map() -> ModeShapes:
    edge_mm = np.linspace(-HALF_SIZE_MM, HALF_SIZE_MM, _MAP_POINTS)
    shapes = GroundTruth().shapes(np.stack(np.meshgrid(edge_mm, edge_mm), axis=-1))[..., : len(DRIVEN_MODES)]
    return ModeShapes.from_grid(edge_mm, edge_mm, np.moveaxis(shapes, -1, 0))


def _walked(modes: ModeShapes, points_mm: FloatArray, solve: PointSolver, price: float) -> FloatArray:
    """Modal amplitudes (strokes, KNOTS, M), each stroke from a plate at rest."""
    solver = InstantSolver(modes, W_LIMIT_UM, derating_mm2_um2=price, phase_rotation=solve is not invert, solve=solve)
    return np.array([_stroke(solver, stroke) for stroke in points_mm.tolist()])


def _stroke(solver: InstantSolver, knots_mm: Sequence[Sequence[tuple[float, float]]]) -> list[Row]:
    modal_um: Row = (0.0,) * len(W_LIMIT_UM)
    walked = []
    for fingers_mm in knots_mm:
        places = [(x_mm, y_mm, um) for (x_mm, y_mm), um in zip(fingers_mm, ONE_STILL_UM, strict=True)]
        modal_um = solver.solve(places, modal_um, _KNOT_NS).modal_um
        walked.append(modal_um)
    return walked


def _figures(modes: ModeShapes, points_mm: FloatArray, walk_um: FloatArray, paper_um: FloatArray) -> dict[str, float]:
    phi = modes.evaluate(points_mm.reshape(-1, 2)).reshape(*points_mm.shape[:3], modes.M)
    side = np.sign(np.linalg.det(phi))
    crosses = side[:, 1:] != side[:, :-1]
    steps_um, papers_um = (np.abs(np.diff(walk, axis=1)).max(axis=-1) for walk in (walk_um, paper_um))
    got_um = np.abs(np.einsum("sknm,skm->skn", phi, walk_um))
    slopes = modes.gradient(points_mm[:, :, 1].reshape(-1, 2)).reshape(len(points_mm), KNOTS, modes.M, 2)
    slope_um_mm = np.einsum("skmd,skm->skd", slopes, walk_um)
    return {
        "largest_step_um": float(steps_um[crosses].max()),
        "of_paper": float(papers_um[crosses].max() / steps_um[crosses].max()),
        "usual_step_um": float(np.median(steps_um[crosses])),
        "anywhere_um": float(steps_um.max()),
        "share_frac": float(np.mean(np.minimum(got_um[..., 0] / ONE_STILL_UM[0], 1.0))),
        "price_um": POSITION_ERROR_MM * float(np.sqrt(np.mean(np.sum(slope_um_mm**2, axis=-1)))),
        "leak_um": float(np.sqrt(np.mean(got_um[..., 1] ** 2))),
    }
