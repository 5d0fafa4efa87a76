"""`felt_descent.c`: the iteration of `felt`, and shapes over contacts."""

from ..phasors import Row
from ..plate.contact import Disc, Ellipse, Shapes
from ..plate.mode_shapes import ModeShapes

MOST_WEIGHT: float  # of a weight's logarithm, either way

def contact_shapes(modes: ModeShapes, disc: Disc, contacts: list[Ellipse], /) -> Shapes:
    """Return the shapes at the points of each contact (N,), of a `disc` (Q,) of radius 1."""

def components(modal_um: Row, /) -> tuple[list[float], list[float]]:
    """Return the real and the imaginary parts of W (M,)."""

def phasors(d_um: list[float], q_um: list[float], /) -> Row:
    """Return W (M,) of its parts."""

def descend(
    shapes: Shapes,
    weights: list[float],
    targets_um: list[float],
    frictions: list[float],
    counted_jnd: list[float],
    stickiness: list[float],
    stretches: list[float],
    pieces: list[tuple[float, float, float]],
    floor: tuple[float, float],
    limits_um: tuple[float, ...],
    d_um: list[float],
    q_um: list[float],
    log_weights: list[float],
    iterations: int,
    stay_frac: float,
    uncertain_frac: float,
    /,
) -> tuple[list[float], list[float]]:
    """Move W (M,), in its parts, and the fingers' weights (N,); return errors in just noticeable differences before the
    last sweeps, and the RMS over each contact after them.

    `weights` (Q,) are those of a contact's points; `frictions` and `stretches` are wanted (`felt.solve_felt`),
    `counted_jnd` is as much as each finger's error counts, `stickiness` the share in which its points are pulled to 0
    (`felt`); `pieces` of the friction curve are where each begins, where it would be 1, and its decay; `floor` is the
    amplitude at which the curve ends, and its friction there.
    """

def contacts_rms_um(shapes: Shapes, weights: list[float], d_um: list[float], q_um: list[float], /) -> list[float]:
    """Return the RMS amplitude over each contact (N,)."""
