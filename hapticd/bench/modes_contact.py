"""A fingertip is a disc: what is felt under it where its centre stands still, and what its Gram matrix can do about it.

Perfect knowledge of the true plate, random pairs of fingers, 1 um wanted at one and none at the other:

    point          the still finger's centre is an exact node
    disc           least mean square over the still finger's disc, for what the other one gets
    ..., 3 modes   the same with one mode of the neighbouring pair driven as well

With two modes the centre's node decides everything but the size, so `disc` gives up the exact node for less vibration
around it. The time is what the matrix costs: shapes at a point, the map of Gram matrices, or their quadrature at once.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ..core.plate.contact_gram import ContactGram, disc_gram
from ..core.plate.mode_shapes import ModeShapes
from ..design import free_plate_modes
from .modes import driven_shapes, random_pairs_mm
from .tables import Table, finite_rows
from .timing import REPEATS, compare

FloatArray = npt.NDArray[np.float64]

RADIUS_MM = 5.0  # a fingertip's contact
LIMIT_UM = 4.0
THIRD_MODE = "9x6"
LEAST_APART_MM = 15.0  # two fingertips side by side
DEFAULT = "point"
_STEP_MM = 1.375


def run(*, pairs: int = 1000, repeats: int = REPEATS, calls: int = 200) -> Table:
    """Compare point and disc on `pairs` pairs of fingers."""
    modes = _true_map()
    two = ModeShapes.from_grid(modes.x_mm, modes.y_mm, modes.shapes[:2])
    points_mm = random_pairs_mm(pairs, LEAST_APART_MM)
    slipping, still = (modes.evaluate(points_mm[:, finger]) for finger in (0, 1))
    gram = disc_gram(modes, points_mm[:, 1], RADIUS_MM)
    contact = ContactGram(two, RADIUS_MM)
    mapped = contact.evaluate(points_mm[:, 1])
    places = [(x, y) for x, y in points_mm[:calls, 1].tolist()]
    times = compare(
        {
            "point": (_each(two.at, places), calls),
            "disc": (_each(contact.at, places), calls),
            "disc, by quadrature": (_each(lambda x, y: disc_gram(two, [(x, y)], RADIUS_MM), places[:20]), 20),
        },
        repeats,
    )
    point_2, point_3 = (_outer(still[:, :count]) for count in (2, 3))
    found = {
        "point": _least(slipping[:, :2], point_2, gram[:, :2, :2]),
        "disc": _least(slipping[:, :2], mapped, mapped),
        "disc, by quadrature": _least(slipping[:, :2], gram[:, :2, :2], gram[:, :2, :2]),
        "point, 3 modes": _least(slipping, point_3, np.broadcast_to(np.eye(3), gram.shape)),
        "disc, 3 modes": _least(slipping, gram, gram),
    }
    rows = []
    for name, modal_um in found.items():
        count = modal_um.shape[1]
        timing = times[name].figures() if name in times else {}
        rows.append(
            (name, {**timing, **_judged(modal_um, slipping[:, :count], still[:, :count], gram[:, :count, :count])})
        )
    return Table(
        name="contact",
        title=f"contact: a still fingertip as a point and as a disc of {RADIUS_MM:g} mm; um per um at the other finger",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("time_us", "disc_um_per_um"),
        time="time_us",
        error="disc_um_per_um",
        notes=(
            "disc: RMS over the still fingertip; point: at its centre; slip: mean share that the other gets of 1 um",
        ),
    )


def _true_map() -> ModeShapes:
    """X, Y and a third mode as the plate has them."""
    theory = {shape.name: shape for _, shape in free_plate_modes()}
    shapes = (*driven_shapes(), theory[THIRD_MODE])
    x_mm, y_mm = (
        np.linspace(-edge_mm / 2.0, edge_mm / 2.0, round(edge_mm / _STEP_MM) + 1) for edge_mm in shapes[0].size_mm
    )
    return ModeShapes.from_grid(x_mm, y_mm, np.stack([shape.on_grid(x_mm, y_mm) for shape in shapes]))


def _each(at: Callable[[float, float], object], places: list[tuple[float, float]]) -> Callable[[], None]:
    def all_places() -> None:
        for x_mm, y_mm in places:
            at(x_mm, y_mm)

    return all_places


def _outer(phi: FloatArray) -> FloatArray:
    return phi[:, :, None] * phi[:, None, :]


def _least(slipping: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """Amplitudes (pairs, M) for 1 um at the slipping finger with the least W' first W, of equals the least W' second W;
    scaled into the limits."""
    size = np.trace(second, axis1=1, axis2=2)[:, None, None]
    weighed = first / np.trace(first, axis1=1, axis2=2)[:, None, None] + 1e-10 * second / size
    weighed = weighed + 1e-14 * np.eye(slipping.shape[1])
    direction = np.linalg.solve(weighed, slipping[..., None])[..., 0]
    modal_um = direction / (direction * slipping).sum(axis=1, keepdims=True)
    over = np.maximum(np.abs(modal_um).max(axis=1, keepdims=True) / LIMIT_UM, 1.0)
    result: FloatArray = modal_um / over
    return result


def _judged(modal_um: FloatArray, slipping: FloatArray, still: FloatArray, gram: FloatArray) -> dict[str, float]:
    got_um = np.abs((slipping * modal_um).sum(axis=1))
    slip_um = float(np.sqrt(np.mean(got_um**2)))
    disc_um = np.sqrt(np.einsum("pm,pmn,pn->p", modal_um, gram, modal_um))
    point_um = np.abs((still * modal_um).sum(axis=1))
    return {
        "disc_um_per_um": float(np.sqrt(np.mean(disc_um**2))) / slip_um,
        "median_disc_um_per_um": float(np.median(disc_um / np.maximum(got_um, 1e-12))),
        "point_um_per_um": float(np.sqrt(np.mean(point_um**2))) / slip_um,
        "slip_frac": float(np.mean(got_um)),
    }
