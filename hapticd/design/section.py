"""Energies of a plate of layers by first-order shear deformation, as matrices over functions of x and y.

A section stays plane and turns by itself: five fields, the deflection, the turns along x and y, and the middle's motion
along x and y, to which a height z adds its product with the turns. Energies are integrals through the layers, the
plate and its patches, so that bending, stretching and their coupling, shear and rotary inertia follow; no neutral axis
is assumed. In mm, kg and s.

Sources: R. D. Mindlin, J. Appl. Mech. 18 (1951) 31; the factor of shear, 5 / (6 - nu) of the plate also where a patch
is: T. Kaneko, J. Phys. D 8 (1975) 1927; laminates: J. N. Reddy, Mechanics of Laminated Composite Plates, ch. 3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .line_basis import LineBasis
from .materials import Material

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

    def density(of: Material) -> dict[tuple[str, str], float]:
        return {(axis, axis): of.density_kg_m3 * 1e-9 for axis in _MOTIONS}

    return _summed(_MOTIONS, [(layer, density(layer.material)) for layer in layers], bases)


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
