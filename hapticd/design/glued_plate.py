"""Natural modes of a free plate with patches glued to one face: Ritz's method in the free plate's own modes.

A patch adds its mass, and the stiffness of a two-layer section about their common neutral axis (A. W. Leissa, Vibration
of Plates, NASA SP-160, ch. 10.2, for layers). The basis are the free plate's modes up to BASIS_FRAC of the band's upper
end. Left out: the glue's own layer and its softness, the patch's rotary inertia and electrical stiffness, and the
Poisson ratio of the patch, which is taken as the plate's for twisting.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..values import FloatArray
from . import legendre
from .free_plate import ModeShape, _class_modes, _degree, _mode_shape, free_modes
from .materials import Material

PZT = Material(62.0, 0.34, 7800.0, "PI Ceramic, PIC255")
BASIS_FRAC = 2.0
_GAUSS_POINTS = 12  # per side of a patch, which is shorter than a wave


@dataclass(frozen=True, slots=True)
class Patch:
    """A rectangular patch of a material, its centre on the plate, its edges along the plate's."""

    x_mm: float
    y_mm: float
    size_mm: tuple[float, float]
    thickness_mm: float
    material: Material = PZT


@dataclass(frozen=True, slots=True)
class GluedPlate:
    """A free plate with the patches that are glued to it, or without any."""

    size_mm: tuple[float, float]
    thickness_mm: float
    material: Material
    patches: tuple[Patch, ...] = ()

    def modes(self, band_hz: tuple[float, float]) -> list[tuple[float, ModeShape]]:
        """Return the modes in the band, lowest first. Raises ValueError."""
        if self.patches:
            return glued_plate_modes(self.size_mm, self.thickness_mm, self.material, self.patches, band_hz)
        return free_modes(self.size_mm, self.thickness_mm, self.material, band_hz)


def glued_plate_modes(
    size_mm: tuple[float, float],
    thickness_mm: float,
    material: Material,
    patches: tuple[Patch, ...],
    band_hz: tuple[float, float],
) -> list[tuple[float, ModeShape]]:
    """Return the modes in the band as `free_modes` does. Raises ValueError for a patch off the plate."""
    for patch in patches:
        reach_mm = abs(patch.x_mm) + patch.size_mm[0] / 2.0, abs(patch.y_mm) + patch.size_mm[1] / 2.0
        if reach_mm[0] > size_mm[0] / 2.0 + 1e-9 or reach_mm[1] > size_mm[1] / 2.0 + 1e-9:
            raise ValueError(f"the patch at {patch.x_mm:g},{patch.y_mm:g} mm reaches over the plate's edge.")
    areal_kg_m2 = material.density_kg_m3 * thickness_mm * 1e-3
    stiffness_nm = _layer_nm(material, thickness_mm, thickness_mm / 2.0, thickness_mm / 2.0)
    wave_speed = math.sqrt(stiffness_nm / areal_kg_m2)
    fourth_1_m4, basis = _basis(size_mm, material.poisson, (2.0 * math.pi * BASIS_FRAC * band_hz[1] / wave_speed) ** 2)
    mass, stiffness = np.eye(len(basis)), np.diag(fourth_1_m4)
    for patch in patches:
        added_mass, added_stiffness = _patch_integrals(basis, size_mm, patch, material.poisson)
        patch_kg_m2 = patch.material.density_kg_m3 * patch.thickness_mm * 1e-3
        mass += added_mass * (patch_kg_m2 / areal_kg_m2)
        stiffness += added_stiffness * (_section_nm(material, thickness_mm, patch) / stiffness_nm - 1.0)
    root = np.linalg.inv(np.linalg.cholesky(mass))
    values, vectors = np.linalg.eigh(root @ stiffness @ root.T)
    frequency_hz = np.sqrt(np.maximum(values, 0.0)) * (wave_speed / (2.0 * math.pi))
    inside = np.flatnonzero((frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1]))
    shapes = np.einsum("na,nij->aij", root.T @ vectors[:, inside], basis)
    return [(float(frequency_hz[at]), _mode_shape(size_mm, shape)) for at, shape in zip(inside, shapes, strict=True)]


@lru_cache(maxsize=2)  # of the same plate with other patches
def _basis(size_mm: tuple[float, float], poisson: float, most_1_m4: float) -> tuple[FloatArray, FloatArray]:
    """Return k^4 (n,) and the coefficients (n, nx, ny) of the free plate's modes up to `most_1_m4`."""
    wave_rad_m = most_1_m4**0.25
    degrees = tuple(_degree(wave_rad_m * edge_mm * 5e-4) for edge_mm in size_mm)
    shift = most_1_m4 + (1e3 / max(size_mm)) ** 4
    classes = [_class_modes(size_mm, degrees, (odd_x, odd_y), poisson, shift) for odd_x in (0, 1) for odd_y in (0, 1)]
    kept = [values <= most_1_m4 for values, _ in classes]
    values = np.concatenate([values[keep] for (values, _), keep in zip(classes, kept, strict=True)])
    shapes = np.concatenate([shapes[keep] for (_, shapes), keep in zip(classes, kept, strict=True)])
    return values, shapes


def _patch_integrals(
    basis: FloatArray, size_mm: tuple[float, float], patch: Patch, poisson: float
) -> tuple[FloatArray, FloatArray]:
    """Return the integrals over a patch of f g, and of the plate's strain energy in f and g, in 1/m^4: (n, n) each."""
    points, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    sides, per_m, scale = [], [], []
    for axis, centre_mm in enumerate((patch.x_mm, patch.y_mm)):
        half_mm = size_mm[axis] / 2.0
        share = patch.size_mm[axis] / 2.0 / half_mm
        places = centre_mm / half_mm + share * points
        sides.append([legendre.values(places, basis.shape[axis + 1] - 1, order) for order in (0, 1, 2)])
        per_m.append(1e3 / half_mm)
        scale.append(weights * share)
    weight = np.outer(*scale).ravel()

    def at(order_x: int, order_y: int) -> FloatArray:
        values = np.einsum("nij,qi,rj->nqr", basis, sides[0][order_x], sides[1][order_y], optimize=True)
        return np.asarray(values.reshape(len(basis), -1) * per_m[0] ** order_x * per_m[1] ** order_y)

    f, xx, yy, xy = at(0, 0), at(2, 0), at(0, 2), at(1, 1)
    both = (xx * weight) @ yy.T
    energy = (xx * weight) @ xx.T + (yy * weight) @ yy.T + poisson * (both + both.T)
    return (f * weight) @ f.T, energy + 2.0 * (1.0 - poisson) * (xy * weight) @ xy.T


def _section_nm(plate: Material, thickness_mm: float, patch: Patch) -> float:
    """Return the bending stiffness of plate and patch about their neutral axis."""
    middles_mm = thickness_mm / 2.0, thickness_mm + patch.thickness_mm / 2.0
    axis_mm = neutral_axis_mm(plate, thickness_mm, patch)
    layers = ((plate, thickness_mm, middles_mm[0]), (patch.material, patch.thickness_mm, middles_mm[1]))
    return sum(_layer_nm(of, layer_mm, middle_mm, axis_mm) for of, layer_mm, middle_mm in layers)


def neutral_axis_mm(plate: Material, thickness_mm: float, patch: Patch) -> float:
    """Return the height of the neutral axis of plate and patch above the bare face."""
    stiff = [_plane_gpa(plate) * thickness_mm, _plane_gpa(patch.material) * patch.thickness_mm]
    return (stiff[0] * thickness_mm / 2.0 + stiff[1] * (thickness_mm + patch.thickness_mm / 2.0)) / sum(stiff)


def _layer_nm(of: Material, thickness_mm: float, middle_mm: float, axis_mm: float) -> float:
    return _plane_gpa(of) * (thickness_mm**3 / 12.0 + thickness_mm * (middle_mm - axis_mm) ** 2)


def _plane_gpa(of: Material) -> float:
    return of.young_gpa / (1.0 - of.poisson**2)
