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
