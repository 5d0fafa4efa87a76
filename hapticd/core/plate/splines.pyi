"""`splines.c`: bicubic surfaces at the points of contacts; its arrays are contiguous, of float64."""

from array import array

from ...values import FloatArray

def evaluate(
    tables: tuple[memoryview, memoryview, memoryview],
    disc: FloatArray,
    contacts: array[float] | FloatArray,
    has_slopes: bool,
    /,
) -> bytes:
    """Return the values (N, Q, M) of the surfaces with these `BicubicSurfaces.tables` at the points of contacts (N, 5):
    x_mm, y_mm and the matrix xx, xy, yy in mm that makes each of the unit disc, of which `disc` (Q, 3) has the points,
    and their weights. With slopes (N, Q, M, 3): value and derivatives along x and y."""

def perceive(
    shapes: bytes,
    disc: FloatArray,
    modal_um: array[float],
    curve: FloatArray,
    speed_gain: float,
    fixed_um2: float,
    each_um2: float,
    /,
) -> tuple[float, float, float, float, float]:
    """Return the means over a contact of friction, of the squares of the amplitude and of its expected error, and of
    the amplitude's two parts, for `shapes` (Q, M) at the points of `disc` (Q, 3). `modal_um` (M, 2) move the plate, the
    error's square is `fixed_um2` and `each_um2` for each shape's square, and a finger with this gain feels by a
    `FrictionCurve.table`. Raises ValueError where lengths do not fit."""
