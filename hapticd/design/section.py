"""Energies of a plate of layers by first-order shear deformation, as matrices over functions of x and y.

A section stays plane and turns by itself: five fields, the deflection, the turns along x and y, and the middle's motion
along x and y, to which a height z adds its product with the turns. Energies are integrals through the layers, the
plate and its patches, so that bending, stretching and their coupling, shear and rotary inertia follow; no neutral axis
is assumed. In mm, kg and s.

The functions along one edge are continuous, and polynomials between nodes (B. Szabo and I. Babuska, Finite Element
Analysis, 1991, ch. 2): a hat at each node, and integrated Legendre polynomials that vanish at both ends of an interval.
Their slopes are Legendre polynomials, so that matrices of them are sparse up to high degrees.

Sources: R. D. Mindlin, J. Appl. Mech. 18 (1951) 31; the factor of shear, 5 / (6 - nu) of the plate also where a patch
is: T. Kaneko, J. Phys. D 8 (1975) 1927; laminates: J. N. Reddy, Mechanics of Laminated Composite Plates, ch. 3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ..values import FloatArray
from . import legendre
from .materials import Material

_MERGED_MM = 1e-6  # nodes that are nearer to each other are one


@dataclass(frozen=True, eq=False)
class LineBasis:
    """`functions[0]` (F, C) are coefficients of F functions in the orthonormal Legendre polynomials of every interval,
    one after the other; `functions[1]` those of their derivatives, per mm. `nodes_mm` (I + 1,), `starts` (I + 1,) are
    the first columns of each interval, and C."""

    nodes_mm: FloatArray
    starts: tuple[int, ...]
    functions: tuple[FloatArray, FloatArray]

    def of_parity(self, odd: int) -> LineBasis:
        """Return the even or odd functions of a basis of one interval."""
        sign = 1.0 - 2.0 * odd
        kept = [np.vstack((one[1] + sign * one[0], one[2 + odd :: 2])) for one in self.functions]
        return LineBasis(self.nodes_mm, self.starts, (kept[0], kept[1]))

    def columns(self, from_mm: float, to_mm: float) -> slice:
        """Return the columns of the intervals between two nodes."""
        first, last = (int(np.abs(self.nodes_mm - at_mm).argmin()) for at_mm in (from_mm, to_mm))
        return slice(self.starts[first], self.starts[last])

    def as_series(self, degree: int) -> FloatArray:
        """Return the functions as Legendre series over all of the line (degree + 1, F), the best in least squares."""
        points, weights = np.polynomial.legendre.leggauss(degree + 1)
        half_mm = self.nodes_mm[-1]
        kept = np.zeros((degree + 1, self.starts[-1]))
        for (first, end), (from_mm, to_mm) in zip(pairwise(self.starts), pairwise(self.nodes_mm), strict=True):
            places = ((to_mm - from_mm) * points + from_mm + to_mm) / (2.0 * half_mm)
            weighted = legendre.values(points, end - first - 1) * weights[:, None]
            kept[:, first:end] = legendre.values(places, degree).T @ weighted * np.sqrt((to_mm - from_mm) / 2.0)
        return np.asarray(kept @ self.functions[0].T / half_mm)


def line_basis(ends_mm: Sequence[float], degrees_per_mm: float, more: int) -> LineBasis:
    """Return a basis with nodes at `ends_mm`, in any order, the outermost of which are the line's ends.

    The degree of an interval is `degrees_per_mm` of half its length, and `more`.
    """
    ends = np.unique(ends_mm)
    ends = ends[np.append(np.diff(ends) > _MERGED_MM, True)]
    lengths_mm = np.diff(ends)
    degrees = [math.ceil(degrees_per_mm * length_mm / 2.0) + more for length_mm in lengths_mm.tolist()]
    starts = (0, *np.cumsum([degree + 1 for degree in degrees]).tolist())
    functions = np.zeros((starts[-1] - len(degrees) + 1, starts[-1]))
    slopes = np.zeros_like(functions)
    row = len(ends)
    for at, (degree, length_mm) in enumerate(zip(degrees, lengths_mm.tolist(), strict=True)):
        scale = np.sqrt(length_mm / 2.0)  # of polynomials that are orthonormal in mm
        size = 1.0 / np.sqrt(np.arange(degree + 1) + 0.5)  # P_n is this times the orthonormal one
        start = starts[at]
        functions[at : at + 2, start] = size[0] * scale / 2.0
        functions[at : at + 2, start + 1] = np.array((-1.0, 1.0)) * size[1] * scale / 2.0
        slopes[at : at + 2, start] = np.array((-1.0, 1.0)) * size[0] / (2.0 * scale)
        for n in range(2, degree + 1):
            norm = scale / np.sqrt(4.0 * n - 2.0)
            functions[row, start + n], functions[row, start + n - 2] = size[n] * norm, -size[n - 2] * norm
            slopes[row, start + n - 1] = 1.0 / scale
            row += 1
    return LineBasis(ends, starts, (functions, slopes))


DEFLECTION, TURN_X, TURN_Y, ALONG_X, ALONG_Y = FIELDS = range(5)
Bases = Mapping[int, tuple[LineBasis, LineBasis]]  # of each field that is solved, along x and y

Term = tuple[int, tuple[int, int], int]  # a field, its derivatives along x and y, and the power of z that it goes with
_STRAINS: dict[str, tuple[Term, ...]] = {
    "xx": ((ALONG_X, (1, 0), 0), (TURN_X, (1, 0), 1)),
    "yy": ((ALONG_Y, (0, 1), 0), (TURN_Y, (0, 1), 1)),
    "xy": ((ALONG_X, (0, 1), 0), (ALONG_Y, (1, 0), 0), (TURN_X, (0, 1), 1), (TURN_Y, (1, 0), 1)),
    "xz": ((DEFLECTION, (1, 0), 0), (TURN_X, (0, 0), 0)),
    "yz": ((DEFLECTION, (0, 1), 0), (TURN_Y, (0, 0), 0)),
}
_MOTIONS: dict[str, tuple[Term, ...]] = {
    "x": ((ALONG_X, (0, 0), 0), (TURN_X, (0, 0), 1)),
    "y": ((ALONG_Y, (0, 0), 0), (TURN_Y, (0, 0), 1)),
    "z": ((DEFLECTION, (0, 0), 0),),
}
_ROUNDING = 1e-13  # of an integral, of the largest


class Lamina(NamedTuple):
    """A rectangle of a material, its middle `height_mm` above that of the plate."""

    material: Material
    thickness_mm: float
    height_mm: float
    place_mm: tuple[float, float]
    size_mm: tuple[float, float]

    def moment_mm(self, power: int) -> float:
        """Return the integral of z^0, z^1 or z^2 through the layer."""
        h_mm, z_mm = self.thickness_mm, self.height_mm
        return (h_mm, h_mm * z_mm, h_mm * (z_mm**2 + h_mm**2 / 12.0))[power]


def shear_factor(of: Material) -> float:
    """Return the shear stiffness of a section as a share of that of uniform shear."""
    return 5.0 / (6.0 - of.poisson)


def wave_rad_mm(hz: float, thickness_mm: float, of: Material) -> float:
    """Return the wave number of a plate's bending waves.

    (S k^2 - m omega^2) (D k^2 + S - J omega^2) = S^2 k^2, with the stiffnesses S of shear and D of bending, the mass m
    and the inertia of rotation J per area.
    """
    bend, shear, mass, inertia = _constants(thickness_mm, of)
    omega2 = (2.0 * math.pi * hz) ** 2
    middle = omega2 * (shear * inertia + mass * bend)
    root = math.sqrt(middle**2 + 4.0 * shear * bend * mass * omega2 * max(shear - inertia * omega2, 0.0))
    return math.sqrt((middle + root) / (2.0 * shear * bend))


def wave_hz(rad_mm: float, thickness_mm: float, of: Material) -> float:
    """Return the frequency of bending waves of this wave number."""
    bend, shear, mass, inertia = _constants(thickness_mm, of)
    middle = (shear * inertia + mass * bend) * rad_mm**2 + mass * shear
    last = mass * inertia * shear * bend * rad_mm**4
    omega2 = 2.0 * shear * bend * rad_mm**4 / (middle + math.sqrt(middle**2 - 4.0 * last))
    return math.sqrt(omega2) / (2.0 * math.pi)


def _constants(thickness_mm: float, of: Material) -> tuple[float, float, float, float]:
    bend = of.young_gpa * 1e6 * thickness_mm**3 / (12.0 * (1.0 - of.poisson**2))
    shear = shear_factor(of) * of.young_gpa * 1e6 / (2.0 + 2.0 * of.poisson) * thickness_mm
    mass = of.density_kg_m3 * 1e-9 * thickness_mm
    return bend, shear, mass, mass * thickness_mm**2 / 12.0


def stiffness(layers: Sequence[Lamina], bases: Bases) -> Any:
    """Return the matrix of the strain energy, sparse; `layers[0]` is the plate."""
    factor = shear_factor(layers[0].material)

    def moduli(of: Material) -> dict[tuple[str, str], float]:
        plane = of.young_gpa * 1e6 / (1.0 - of.poisson**2)
        shear = of.young_gpa * 1e6 / (2.0 + 2.0 * of.poisson)
        along = dict.fromkeys((("xx", "xx"), ("yy", "yy")), plane)
        across = dict.fromkeys((("xx", "yy"), ("yy", "xx")), plane * of.poisson)
        return along | across | {("xy", "xy"): shear, ("xz", "xz"): factor * shear, ("yz", "yz"): factor * shear}

    return _summed(_STRAINS, [(layer, moduli(layer.material)) for layer in layers], bases)


def mass(layers: Sequence[Lamina], bases: Bases) -> Any:
    """Return the matrix of the kinetic energy, sparse."""
    axes = [(axis, axis) for axis in _MOTIONS]
    weighted = [(layer, dict.fromkeys(axes, layer.material.density_kg_m3 * 1e-9)) for layer in layers]
    return _summed(_MOTIONS, weighted, bases)


def _summed(
    parts: dict[str, tuple[Term, ...]], weighted: Sequence[tuple[Lamina, dict[tuple[str, str], float]]], bases: Bases
) -> Any:
    """Return the sum of the layers' integrals of products of `parts`, by what each product is weighted with."""
    from scipy import sparse  # late: it takes a quarter of a second, and stored modes need none

    blocks: dict[tuple[int, int], Any] = {}
    for layer, weights in weighted:
        for (left, right), weight in weights.items():
            for one, of_one, z_one in parts[left]:
                for other, of_other, z_other in parts[right]:
                    factor = weight * layer.moment_mm(z_one + z_other)
                    if factor == 0.0 or one > other or not {one, other} <= bases.keys():
                        continue
                    along_x, along_y = (
                        _integrals(bases[one][axis], of_one[axis], bases[other][axis], of_other[axis], layer, axis)
                        for axis in (0, 1)
                    )
                    product = sparse.kron(sparse.csr_array(along_x), sparse.csr_array(factor * along_y), format="csr")
                    blocks[one, other] = product + blocks[one, other] if (one, other) in blocks else product
    blocks |= {(other, one): block.T for (one, other), block in blocks.items() if one != other}
    return sparse.block_array([[blocks.get((one, other)) for other in bases] for one in bases], format="csc")


def _integrals(one: LineBasis, of_one: int, other: LineBasis, of_other: int, layer: Lamina, axis: int) -> Any:
    """Return the integrals along a side of a layer of products of two bases' functions or derivatives."""
    middle_mm, half_mm = layer.place_mm[axis], layer.size_mm[axis] / 2.0
    inside = one.columns(middle_mm - half_mm, middle_mm + half_mm)
    found = one.functions[of_one][:, inside] @ other.functions[of_other][:, inside].T
    found[np.abs(found) < _ROUNDING * np.abs(found).max()] = 0.0
    return found
