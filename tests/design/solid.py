"""A plate with a patch as a solid: quadratic bricks, two through the glass and one through the patch."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import eigsh

from hapticd.design.glued_plate import Patch
from hapticd.design.materials import Material

CELL_MM = 2.5
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(3)


def _line(s: float) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic functions at -1, 0 and 1, and their slopes."""
    return np.array([s * (s - 1.0) / 2.0, 1.0 - s * s, s * (s + 1.0) / 2.0]), np.array([s - 0.5, -2.0 * s, s + 0.5])


def _brick(of: Material, sides_mm: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffness and mass (81, 81) of a brick, node by node."""
    nu, shear = of.poisson, of.young_gpa * 1e6 / (2.0 + 2.0 * of.poisson)
    elastic = np.zeros((6, 6))
    elastic[:3, :3] = 2.0 * shear * nu / (1.0 - 2.0 * nu)
    elastic += np.diag([2.0 * shear] * 3 + [shear] * 3)
    stiff, mass = np.zeros((81, 81)), np.zeros((27, 27))
    for at in product(range(3), repeat=3):
        lines = [_line(_POINTS[one]) for one in at]
        weight = float(np.prod(_WEIGHTS[list(at)])) * math.prod(sides_mm) / 8.0
        value = np.einsum("i,j,k->ijk", *(one[0] for one in lines)).ravel()
        slopes = [
            np.einsum("i,j,k->ijk", *(lines[of_one][int(of_one == axis)] for of_one in range(3))).ravel()
            * (2.0 / sides_mm[axis])
            for axis in range(3)
        ]
        strain = np.zeros((6, 27, 3))
        for axis in range(3):
            strain[axis, :, axis] = slopes[axis]
            one, other = (axis + 1) % 3, (axis + 2) % 3
            strain[3 + axis, :, one], strain[3 + axis, :, other] = slopes[other], slopes[one]
        flat = strain.reshape(6, 81)
        stiff += weight * flat.T @ elastic @ flat
        mass += weight * of.density_kg_m3 * 1e-9 * np.outer(value, value)
    return stiff, np.kron(mass, np.eye(3))


def solid_hz(size_mm: tuple[float, float], thickness_mm: float, of: Material, patch: Patch, count: int) -> list[float]:
    """Return the lowest frequencies of the solid above its six motions without strain; edges are whole cells."""
    cells = [round(edge_mm / CELL_MM) for edge_mm in size_mm]
    heights_mm = [thickness_mm / 2.0, thickness_mm / 2.0, patch.thickness_mm]
    layers = of, of, patch.material
    kinds = [_brick(material, (CELL_MM, CELL_MM, high)) for material, high in zip(layers, heights_mm, strict=True)]
    counts = [2 * cells[0] + 1, 2 * cells[1] + 1, 7]
    rows, columns, stiff, heavy = [], [], [], []
    for i, j, k in product(range(cells[0]), range(cells[1]), range(3)):
        middle_mm = [(at + 0.5) * CELL_MM - edge_mm / 2.0 for at, edge_mm in zip((i, j), size_mm, strict=True)]
        away_mm = np.abs(np.array(middle_mm) - (patch.x_mm, patch.y_mm))
        if k == 2 and not np.all(away_mm < np.array(patch.size_mm) / 2.0):
            continue
        corner = np.array((2 * i, 2 * j, 2 * k))
        nodes = np.array([np.ravel_multi_index(corner + one, counts) for one in product(range(3), repeat=3)])
        dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
        rows.append(np.repeat(dofs, 81))
        columns.append(np.tile(dofs, 81))
        stiff.append(kinds[k][0].ravel())
        heavy.append(kinds[k][1].ravel())
    used, at = np.unique(np.concatenate(rows), return_inverse=True)
    across = np.searchsorted(used, np.concatenate(columns))
    matrices = [sparse.csc_array((np.concatenate(one), (at, across)), shape=(len(used),) * 2) for one in (stiff, heavy)]
    found = eigsh(matrices[0], count + 6, matrices[1], sigma=-1e6, v0=np.cos(np.arange(len(used))))[0]
    return (np.sqrt(np.sort(found)[6:]) / (2.0 * math.pi)).tolist()
