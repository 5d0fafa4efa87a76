"""`felt_descent.c`: the iteration of `felt`, and shapes over contacts; its arrays are contiguous, of float64."""

from array import array

from ...values import FloatArray
from ..phasors import Phasors
from ..plate.contact import Shapes

UNCERTAIN_FRAC: float  # of a mode's amplitude: map, gain and sensor together
COLD: int  # times as many iterations from rest

def contact_shapes(
    tables: tuple[memoryview, memoryview, memoryview], disc: FloatArray, contacts: array[float], /
) -> Shapes:
    """Return the shapes of the map with these `ModeShapes.tables` at the points of contacts (N, 5), each an `Ellipse`
    of which `disc` (Q, 3) has the points, and their weights, where it is the unit disc."""

def descend(
    shapes: Shapes,
    disc: FloatArray,
    fingers: array[float],
    curve: FloatArray,
    limits_um: FloatArray,
    modal_um: Phasors,
    iterations: int,
    stay_frac: float,
    most_step_um: float,
    /,
) -> tuple[Phasors, bool]:
    """Return W (M,), moved by at most `most_step_um`, and whether a limit keeps a finger from its target; none of the
    `iterations` only measures. W of 0 begins with all modes alike.

    `fingers` (8, N) are target in um, friction, how much an error counts at most (`felt.counted_jnd`), stickiness,
    gain with speed and logarithm of the weight; then come, as answers, errors in just noticeable differences and the
    RMS over each contact. `curve` is a `FrictionCurve.table`.
    """
