"""What the board's sensors read where the plate moves by true amplitudes.

The board makes its readings equal to the reference. Where touches showed that the sensors err, by gain, phase or
crosstalk, the reference is what they read when the plate does as it should.
"""

from __future__ import annotations

from ...values import Drive, Knot, SafeDrive
from ..phasors import Row

Matrix = tuple[Row, ...]


def as_they_are(modes: int) -> Matrix:
    """Return the readings (M, M) of sensors without errors."""
    return tuple([tuple([1.0 + 0j if row == column else 0j for column in range(modes)]) for row in range(modes)])


def as_read(drive: SafeDrive, readings: Matrix) -> Drive:
    """Return the drive with `readings` (M, M) times its true amplitudes."""
    knots = [Knot(dt_ns, read_um(modal_um, readings)) for dt_ns, modal_um in drive.knots]
    return Drive(drive.t_apply_ns, tuple(knots))


def read_um(modal_um: Row, readings: Matrix) -> Row:
    """Return what sensors read of these true amplitudes (M,)."""
    return tuple([_product(row, modal_um) for row in readings])


def _product(row: Row, modal_um: Row) -> complex:
    total = 0j
    for weight, w_um in zip(row, modal_um, strict=True):
        total += weight * w_um
    return total
