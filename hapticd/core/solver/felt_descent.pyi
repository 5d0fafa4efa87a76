"""`felt_descent.c`: the iteration of `instant`; its arrays are contiguous, of float64."""

from array import array

from ...values import FloatArray
from ..phasors import Phasors
from ..plate.contact import Ellipses

Contacts = tuple[
    tuple[memoryview, memoryview, memoryview], FloatArray, list[tuple[float, float, float]], Ellipses, float
]

UNCERTAIN_FRAC: float  # of a mode's amplitude, by map and sensor, if the plate is measured well
EVEN_FRAC: float  # of a point's way to the mean of its contact, on a pad of 11 ms
COLD: int  # times as many iterations from silence

def descend(
    contacts: bytes | Contacts,
    weights: FloatArray,
    fingers: array[float],
    curve: FloatArray,
    limits_um: FloatArray,
    modal_um: Phasors,
    iterations: int,
    most_steps_um: tuple[float, ...],
    uncertain_frac: float = ...,
    even_frac: float = ...,
    /,
) -> list[tuple[Phasors, bool]]:
    """Return for K instants, each of which continues the one before, W (M,), moved by at most that of `most_steps_um`
    (K,), and whether a limit keeps a finger from its target. W of 0 begins with all modes alike; where no finger slips,
    it is 0. With no `iterations` W stays, and is only measured.

    `contacts` are the arguments of `splines.evaluate` for the contacts of all instants, or its answer: the shapes
    (K, N, Q, M) at their points, which have `weights` (Q,). With one point each finger is one: still ones get exactly
    0, and the squares of the others' errors in um are least. `fingers` (K, 8, N) are target in um, friction, how much
    an error counts at most (`counted_jnd`), stickiness, gain with speed and logarithm of the weight, kept from the
    first instant on; then come, as answers, errors in just noticeable differences and the RMS over each contact.
    `curve` is a `FrictionCurve.table`.
    """
