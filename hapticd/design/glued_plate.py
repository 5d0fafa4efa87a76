"""Natural modes of a free rectangular plate, bare or with patches on one face.

The energies of `section` are written in tensor products of its functions, with nodes at the edges of plate and patches,
where strains jump; free edges are natural to the method and need no condition (W. Ritz, Annalen der Physik 333 (1909)
737). Even and odd functions do not mix on a bare plate, so each of its four symmetry classes is a problem of its own;
of patches on one face all motion is coupled.

Left out: the glue's own layer and its softness, electrical stiffness, what holds the plate, and damping. Frequencies
are for finding modes, shapes for simulating them; a real plate is measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..values import FloatArray
from . import section
from .materials import Material
from .mode_shape import ModeShape, mode_shape
from .section import ALONG_X, ALONG_Y, DEFLECTION, FIELDS, TURN_X, TURN_Y, Bases, Lamina, LineBasis, wave_rad_mm

PZT = Material(62.0, 0.34, 7800.0, "PI Ceramic, PIC255")
BENDING, IN_PLANE = (DEFLECTION, TURN_X, TURN_Y), (ALONG_X, ALONG_Y)
_PER_RAD = 1.4  # degrees per radian of the shortest wave over half an interval
_MORE, _MORE_GLUED = 10, 6  # degrees, for an edge's decaying waves: 0.1 Hz at 30 kHz
_SERIES_MORE = 12  # degrees of the series of a shape with patches, for the bends at their edges
_MAX_DEGREE = 120
_BENDING_SHARE = 0.5  # of the kinetic energy in the deflection, at least; modes in the plane have a tenth at most
_SPARE_MODES = 8  # that are sought beyond the number estimated


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

    def modes(self, band_hz: tuple[float, float], finer: int = 0) -> list[tuple[float, ModeShape]]:
        """Return the bending modes in `band_hz` as (frequency_hz, shape), lowest first.

        `finer` degrees of the polynomials in addition show what is left of convergence.

        On a square bare plate the modes odd along one axis and even along the other come in pairs of equal frequency:
        the one odd along x first, then the same turned (x and y exchanged), so that "11x0" is the X mode and "0x11" the
        Y mode. All other modes of a square plate are single: f(x, y) + f(y, x) and f(x, y) - f(y, x) differ in
        frequency and are returned as they are, named "12x2+2x12".
        Raises ValueError for an impossible plate, or a band beyond what the basis resolves.
        """
        found = _solved(self, band_hz, FIELDS if self.patches else BENDING, finer)
        return [(one.hz, mode_shape(self.size_mm, one.fields)) for one in found if one.bending >= _BENDING_SHARE]

    def in_plane_hz(self, band_hz: tuple[float, float]) -> list[float]:
        """Return the frequencies of the modes in which the plate moves in its plane; a drive keeps away from them."""
        found = _solved(self, band_hz, FIELDS if self.patches else IN_PLANE)
        return [one.hz for one in found if one.bending < _BENDING_SHARE]


def plate_modes(
    size_mm: tuple[float, float] = (137.5, 137.5),
    thickness_mm: float = 2.0,
    young_gpa: float = 72.5,
    poisson: float = 0.22,
    density_kg_m3: float = 2500.0,
    band_hz: tuple[float, float] = (28000.0, 30500.0),
    *,
    patches: Sequence[tuple[float, float, float, float, float]] = (),
) -> list[tuple[float, ModeShape]]:
    """Return the modes of a plate of these constants, with patches of PZT (x, y, width, depth, thickness in mm) on one
    face; see `GluedPlate.modes`."""
    of = Material(young_gpa, poisson, density_kg_m3, "given")
    glued = tuple(Patch(*patch[:2], patch[2:4], patch[4]) for patch in patches)
    return GluedPlate((float(size_mm[0]), float(size_mm[1])), thickness_mm, of, glued).modes(band_hz)


free_plate_modes = plate_modes  # without patches


class _Mode(NamedTuple):
    """A mode of unit modal mass: `fields` (5, nx, ny) as Legendre series, and the deflection's share of the energy."""

    hz: float
    bending: float
    fields: FloatArray


@lru_cache(maxsize=8)
def _solved(
    plate: GluedPlate, band_hz: tuple[float, float], solved: Sequence[int], finer: int = 0
) -> tuple[_Mode, ...]:
    _require(plate, band_hz)
    layers = [Lamina(plate.material, plate.thickness_mm, 0.0, (0.0, 0.0), plate.size_mm)]
    for patch in plate.patches:
        height_mm = (plate.thickness_mm + patch.thickness_mm) / 2.0
        layers.append(Lamina(patch.material, patch.thickness_mm, height_mm, (patch.x_mm, patch.y_mm), patch.size_mm))
    rad_mm = wave_rad_mm(band_hz[1], plate.thickness_mm, plate.material)
    lines = []
    for axis, edge_mm in enumerate(plate.size_mm):
        sides = [(layer.place_mm[axis], layer.size_mm[axis] / 2.0) for layer in layers]
        ends_mm = [middle_mm + side * half_mm for middle_mm, half_mm in sides for side in (-1.0, 1.0)]
        if not _PER_RAD * rad_mm * edge_mm / 2.0 <= _MAX_DEGREE:
            raise ValueError("band_hz reaches waves too short for this plate size; lower its upper end.")
        lines.append(section.line_basis(ends_mm, rad_mm * _PER_RAD, (_MORE_GLUED if plate.patches else _MORE) + finer))
    degrees = [math.ceil(_PER_RAD * rad_mm * edge_mm / 2.0) + _MORE + finer for edge_mm in plate.size_mm]
    if plate.patches:
        degrees = [degree + _SERIES_MORE for degree in degrees]
        found = list(_modes(layers, dict.fromkeys(solved, (lines[0], lines[1])), band_hz, degrees))
    else:
        found = _of_classes(layers, (lines[0], lines[1]), solved, band_hz, degrees)
    return tuple(sorted(found, key=lambda one: one.hz))  # stable: of an equal pair the one odd along x stays first


def _of_classes(
    layers: Sequence[Lamina],
    lines: tuple[LineBasis, LineBasis],
    solved: Sequence[int],
    band_hz: tuple[float, float],
    degrees: Sequence[int],
) -> list[_Mode]:
    """Return a bare plate's modes, class by class; a class is named by the parity of the deflection."""
    parities = [[line.of_parity(odd) for odd in (0, 1)] for line in lines]
    turned = [DEFLECTION, TURN_Y, TURN_X, ALONG_Y, ALONG_X]
    found: list[_Mode] = []
    for odd_x, odd_y in ((1, 0), (0, 1), (0, 0), (1, 1)):
        if layers[0].size_mm[0] == layers[0].size_mm[1] and (odd_x, odd_y) == (0, 1):
            found += [one._replace(fields=one.fields[turned].transpose(0, 2, 1)) for one in found]
            continue
        bases = {
            field: (
                parities[0][1 - odd_x if field in (TURN_X, ALONG_X) else odd_x],
                parities[1][1 - odd_y if field in (TURN_Y, ALONG_Y) else odd_y],
            )
            for field in solved
        }
        found += _modes(layers, bases, band_hz, degrees)
    return found


def _modes(
    layers: Sequence[Lamina], bases: Bases, band_hz: tuple[float, float], degrees: Sequence[int]
) -> Iterator[_Mode]:
    """Yield the modes in the band, by Lanczos iterations on the inverse about its middle."""
    from scipy.sparse.linalg import LinearOperator, eigsh, splu  # late: see `section`

    stiff, heavy = section.stiffness(layers, bases), section.mass(layers, bases)
    low, high = ((2.0 * math.pi * hz) ** 2 for hz in band_hz)
    middle = (low + high) / 2.0
    factors = splu(stiff - middle * heavy, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    inverse = LinearOperator(stiff.shape, factors.solve)
    most = stiff.shape[0] - 2
    plate = layers[0]
    low_rad_mm, high_rad_mm = (wave_rad_mm(hz, plate.thickness_mm, plate.material) for hz in band_hz)
    # R. Courant and D. Hilbert, Methods of Mathematical Physics, ch. 6.4; those in the plane are a fifth of the others
    estimated = 1.2 * plate.size_mm[0] * plate.size_mm[1] * (high_rad_mm**2 - low_rad_mm**2) / (4.0 * math.pi)
    number = _SPARE_MODES + math.ceil(estimated / (1 if len(bases) == len(FIELDS) else 4))
    start = np.cos(np.arange(most + 2.0))  # no mode is at a right angle to it
    while True:
        number = min(number, most)
        values, vectors = eigsh(stiff, number, heavy, middle, v0=start, OPinv=inverse, tol=1e-11)
        if number == most or np.abs(values - middle).max() > high - middle:
            break
        number *= 2
    series = {field: [line.as_series(n) for line, n in zip(of, degrees, strict=True)] for field, of in bases.items()}
    shapes = {field: (of[0].shape[1], of[1].shape[1]) for field, of in series.items()}
    ends = np.cumsum([across * along for across, along in shapes.values()])[:-1]
    for value, vector in zip(values, vectors.T, strict=True):
        hz = math.sqrt(max(value, 0.0)) / (2.0 * math.pi)
        if band_hz[0] <= hz <= band_hz[1]:
            fields = np.zeros((len(FIELDS), degrees[0] + 1, degrees[1] + 1))
            parts = dict(zip(bases, np.split(vector, ends), strict=True))
            for field, part in parts.items():
                fields[field] = series[field][0] @ part.reshape(shapes[field]) @ series[field][1].T
            moving = np.split(heavy @ vector, ends)[0] @ parts[DEFLECTION] if DEFLECTION in parts else 0.0
            yield _Mode(hz, float(moving), fields)


def _require(plate: GluedPlate, band_hz: tuple[float, float]) -> None:
    of = plate.material
    positive = {
        "size_mm[0]": plate.size_mm[0],
        "size_mm[1]": plate.size_mm[1],
        "thickness_mm": plate.thickness_mm,
        "young_gpa": of.young_gpa,
        "density_kg_m3": of.density_kg_m3,
    }
    for name, value in positive.items():
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name} is {value}; give a positive number.")
    if not -1.0 < of.poisson <= 0.5:
        raise ValueError(f"poisson is {of.poisson}; an isotropic solid's lies above -1 and up to 0.5.")
    if not 0.0 <= band_hz[0] <= band_hz[1] < math.inf:
        raise ValueError(f"band_hz is {band_hz}; give two frequencies, the lower one first.")
    for patch in plate.patches:
        reach_mm = abs(patch.x_mm) + patch.size_mm[0] / 2.0, abs(patch.y_mm) + patch.size_mm[1] / 2.0
        if reach_mm[0] > plate.size_mm[0] / 2.0 + 1e-9 or reach_mm[1] > plate.size_mm[1] / 2.0 + 1e-9:
            raise ValueError(f"the patch at {patch.x_mm:g},{patch.y_mm:g} mm reaches over the plate's edge.")
