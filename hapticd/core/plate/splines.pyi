"""`splines.c`: bicubic surfaces at the points of contacts; its arrays are contiguous, of float64."""

from collections.abc import Sequence

from ...values import FloatArray
from ..phasors import Phasors
from .contact import Ellipses

def evaluate(
    tables: tuple[memoryview, memoryview, memoryview],
    disc: FloatArray,
    places: Sequence[Sequence[float]] | FloatArray,
    ellipses: Ellipses,
    radius_mm: float,
    has_slopes: bool = ...,
    /,
) -> bytes:
    """Return the values (N, Q, M) of the surfaces with these `BicubicSurfaces.tables` at the points of contacts:
    ellipses, or discs of this radius, at a list (N,) of places that begin with x_mm and y_mm, or an array (N, 2) of
    them; `disc` (Q, 3) has the points of the unit disc, and their weights. With slopes (N, Q, M, 3): value and
    derivatives along x and y."""

def perceive(
    tables: tuple[memoryview, memoryview, memoryview],
    disc: FloatArray,
    contact: tuple[float, float, float, float, float],
    modal_um: Phasors,
    curve: FloatArray,
    speed_gain: float,
    map_frac: float,
    sensors_frac: float,
    /,
) -> tuple[float, float, float, float, float]:
    """Return the means over a contact of friction, of the squares of the amplitude and of its expected error, and of
    the amplitude's two parts, where `modal_um` (M,) move the plate, whose map and sensors have these errors
    (`core.uncertainty`), and a finger with this gain feels by a `FrictionCurve.table`. Raises ValueError where lengths
    do not fit."""
