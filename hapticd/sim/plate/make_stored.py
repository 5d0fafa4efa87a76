"""Writes the results that `stored` keeps, after a change of a plate, of the theory or of the fit:

python -m hapticd.sim.plate.make_stored

The reference plate's driven pair stands for what was measured, whatever theory says: its shapes and maps stay.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from hapticd.design import legendre
from hapticd.values import FloatArray

from .glasses import GLASSES, REFERENCE
from .ground_truth import DRIVEN_MODES, GroundTruth, PlateSettings
from .shape_tables import mode_map
from .shapes import theory
from .stored import FILE, QUANTUM, SCANS, key_of

_DEGREE = 44  # of a map's series along either axis: the plates' waves need 36
_LEAST_SHARE = 1e-7  # of the largest singular value: what equal steps do not resolve


def write() -> None:
    """Compute everything again, and write the file."""
    with np.load(FILE) as file:
        before = dict(file)
    FILE.unlink()
    kept: dict[str, Any] = {}
    for name, glass in GLASSES.items():
        frequencies_hz, shapes = zip(*[theory(mode, name) for mode in glass.modes], strict=True)
        kept[key_of("Hz", glass)] = _whole(frequencies_hz)
        kept[key_of("shapes", glass)] = _whole([shape.coefficients for shape in shapes])
        truth = GroundTruth(PlateSettings.of(name))
        for scan in [truth.scan(seed, is_driven) for seed in range(SCANS) for is_driven in (True, False)]:
            key = key_of(glass, *scan)
            if scan[0] == DRIVEN_MODES:
                kept[key] = before[key]
                continue
            modes = mode_map(name, *scan)
            kept[key] = _whole(_coefficients(modes.x_mm, modes.y_mm, modes.shapes))
    solved = key_of("shapes", GLASSES[REFERENCE])
    pair, more = before[solved][:2], kept[solved].shape[1] - before[solved].shape[1]
    kept[solved][:2] = np.pad(pair, ((0, 0), (0, more), (0, more)))
    np.savez_compressed(FILE, **kept)


def _whole(numbers: npt.ArrayLike) -> npt.NDArray[np.int64]:
    return np.round(np.asarray(numbers) / QUANTUM).astype(np.int64)


def _coefficients(x_mm: FloatArray, y_mm: FloatArray, shapes: FloatArray) -> FloatArray:
    along_x, along_y = (
        np.linalg.pinv(legendre.values(axis_mm / axis_mm[-1], _DEGREE), _LEAST_SHARE) for axis_mm in (x_mm, y_mm)
    )
    return np.asarray(along_x @ shapes.transpose(0, 2, 1) @ along_y.T)


if __name__ == "__main__":
    write()
