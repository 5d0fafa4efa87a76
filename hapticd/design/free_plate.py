"""Natural modes of a free rectangular plate: thin-plate (Kirchhoff) theory solved by Ritz's method.

The plate's strain energy, D/2 * integral of w_xx^2 + w_yy^2 + 2 nu w_xx w_yy + 2 (1 - nu) w_xy^2, and its kinetic
energy are written in products of Legendre polynomials; free edges are natural to Ritz's method and need no
condition. Even and odd polynomials do not mix, so each of the four symmetry classes is a problem of its own.

Left out: shear and rotary inertia (they lower a 27 mm wave on 2 mm glass by a few per cent), what is glued to the
plate, and damping. Frequencies are for finding modes, shapes for simulating them; a real plate is measured.

Sources: W. Ritz, Annalen der Physik 333 (1909) 737; A. W. Leissa, Vibration of Plates (NASA SP-160), ch. 4.3.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from ..values import FloatArray
from . import legendre
from .materials import Material

_TERMS_PER_RADIAN = 1.4  # Legendre degrees per radian of the shortest wave over half an edge: 1e-7 in frequency
_TERMS_FOR_EDGES = 10  # and some more for the edge's decaying waves
_MAX_DEGREE = 120  # the reference plate needs 34 at 30 kHz; at 120 each symmetry class takes half a minute
_PEAK_GRID = 257
_EQUAL_FRAC = 0.999  # products of beam functions this close in size form one combination


@dataclass(frozen=True, eq=False)
class ModeShape:
    """A mode's shape as products of orthonormal Legendre polynomials in 2x/width and 2y/depth, peak |shape| of 1.

    `coefficients` (nx, ny) is read-only. `nodal_lines` counts the lines crossed along x and along y by the product
    of beam functions that dominates the shape; that product is positive in the corner (+x, +y).
    """

    size_mm: tuple[float, float]
    coefficients: FloatArray
    nodal_lines: tuple[int, int]
    name: str

    def __call__(self, points_mm: npt.ArrayLike) -> FloatArray:
        """Same as `evaluate`."""
        return self.evaluate(points_mm)

    def evaluate(self, points_mm: npt.ArrayLike) -> FloatArray:
        """Return the shape (N,) at `points_mm` (N, 2), clamped to the plate. NaN stays NaN."""
        x, y = _on_plate(points_mm, self.size_mm)
        return self._at(x, y, (0, 0))

    def gradient(self, points_mm: npt.ArrayLike) -> FloatArray:
        """Return derivatives (N, 2) along x and y in 1/mm at `points_mm` (N, 2), clamped to the plate."""
        x, y = _on_plate(points_mm, self.size_mm)
        width_mm, depth_mm = self.size_mm
        return np.stack((self._at(x, y, (1, 0)) * (2.0 / width_mm), self._at(x, y, (0, 1)) * (2.0 / depth_mm)), axis=-1)

    def on_grid(self, x_mm: npt.ArrayLike, y_mm: npt.ArrayLike) -> FloatArray:
        """Return the shape (ny, nx) on the grid of `x_mm` (nx,), `y_mm` (ny,): much cheaper than point by point."""
        width_mm, depth_mm = self.size_mm
        x = np.clip(np.asarray(x_mm, np.float64) * (2.0 / width_mm), -1.0, 1.0)
        y = np.clip(np.asarray(y_mm, np.float64) * (2.0 / depth_mm), -1.0, 1.0)
        return _tensor(self.coefficients, x, y)

    def _at(self, x: FloatArray, y: FloatArray, orders: tuple[int, int]) -> FloatArray:
        terms_x, terms_y = self.coefficients.shape
        across = legendre.values(x, terms_x - 1, orders[0]) @ self.coefficients
        result: FloatArray = np.einsum("nj,nj->n", across, legendre.values(y, terms_y - 1, orders[1]))
        return result


def free_plate_modes(
    size_mm: tuple[float, float] = (137.5, 137.5),
    thickness_mm: float = 2.0,
    young_gpa: float = 72.5,
    poisson: float = 0.22,
    density_kg_m3: float = 2500.0,
    band_hz: tuple[float, float] = (28000.0, 30500.0),
) -> list[tuple[float, ModeShape]]:
    """Return the modes of a plate of the material with these constants; see `free_modes`."""
    return free_modes(size_mm, thickness_mm, Material(young_gpa, poisson, density_kg_m3, "given"), band_hz)


def free_modes(
    size_mm: tuple[float, float], thickness_mm: float, material: Material, band_hz: tuple[float, float]
) -> list[tuple[float, ModeShape]]:
    """Return the modes with frequencies in `band_hz` as (frequency_hz, shape), lowest first.

    Frequencies solve the theory to better than 1e-6. On a square plate the modes odd along one axis and even along
    the other come in pairs of exactly equal frequency: the one odd along x first, then the same turned (x and y
    exchanged), so that "11x0" is the X mode and "0x11" the Y mode. All other modes of a square plate are single:
    f(x, y) + f(y, x) and f(x, y) - f(y, x) differ in frequency and are returned as they are, named "12x2+2x12".
    Raises ValueError for an impossible plate, or a band beyond what the theory resolves.
    """
    _require_plate(size_mm, thickness_mm, material)
    low_hz, high_hz = (float(edge) for edge in band_hz)
    if not 0.0 <= low_hz <= high_hz < math.inf:
        raise ValueError(f"band_hz is {band_hz}; give two frequencies, the lower one first.")
    size = (float(size_mm[0]), float(size_mm[1]))
    return list(_modes_in_band(size, material.poisson, wave_speed_m2_s(thickness_mm, material), low_hz, high_hz))


def distinct_names(modes: Sequence[tuple[float, ModeShape]]) -> list[str]:
    """Return the shapes' names; where several have one, those after the first end with "#2", "#3" ..."""
    seen: Counter[str] = Counter()
    names = []
    for _, shape in modes:
        seen[shape.name] += 1
        names.append(shape.name if seen[shape.name] == 1 else f"{shape.name}#{seen[shape.name]}")
    return names


def wave_speed_m2_s(thickness_mm: float, material: Material) -> float:
    """Return omega / k^2 of a plate's bending waves."""
    stiffness_nm = material.young_gpa * 1e9 * (thickness_mm * 1e-3) ** 3 / (12.0 * (1.0 - material.poisson**2))
    return math.sqrt(stiffness_nm / (material.density_kg_m3 * thickness_mm * 1e-3))


@lru_cache(maxsize=16)
def _modes_in_band(
    size_mm: tuple[float, float], poisson: float, wave_speed: float, low_hz: float, high_hz: float
) -> tuple[tuple[float, ModeShape], ...]:
    wave_rad_m = math.sqrt(2.0 * math.pi * high_hz / wave_speed)
    degrees = tuple(_degree(wave_rad_m * edge * 5e-4) for edge in size_mm)
    shift = wave_rad_m**4 + (1e3 / max(size_mm)) ** 4
    found: list[tuple[float, FloatArray]] = []
    for parity_x, parity_y in ((1, 0), (0, 1), (0, 0), (1, 1)):
        if size_mm[0] == size_mm[1] and (parity_x, parity_y) == (0, 1):
            found += [(frequency_hz, np.ascontiguousarray(shape.T)) for frequency_hz, shape in found]
            continue
        eigenvalues, shapes = _class_modes(size_mm, degrees, (parity_x, parity_y), poisson, shift)
        frequencies_hz = np.sqrt(np.maximum(eigenvalues, 0.0)) * (wave_speed / (2.0 * math.pi))
        inside = (frequencies_hz >= low_hz) & (frequencies_hz <= high_hz)
        found += list(zip(frequencies_hz[inside].tolist(), shapes[inside], strict=True))
    found.sort(key=lambda mode: mode[0])  # stable: of a degenerate pair the one odd along x stays first
    return tuple((frequency_hz, _mode_shape(size_mm, coefficients)) for frequency_hz, coefficients in found)


def _class_modes(
    size_mm: tuple[float, float], degrees: tuple[int, ...], parities: tuple[int, int], poisson: float, shift: float
) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues k^4 (n,) in 1/m^4, and the modes of one symmetry class as coefficients (n, nx, ny)."""
    edges = (
        _edge_integrals(degree, parity, edge) for degree, parity, edge in zip(degrees, parities, size_mm, strict=True)
    )
    (mass_x, twist_x, bend_x, cross_x), (mass_y, twist_y, bend_y, cross_y) = edges
    stiffness = np.kron(bend_x, mass_y) + np.kron(mass_x, bend_y)
    stiffness += poisson * (np.kron(cross_x, cross_y.T) + np.kron(cross_x.T, cross_y))
    stiffness += 2.0 * (1.0 - poisson) * np.kron(twist_x, twist_y)
    eigenvalues, vectors = _smallest_first(stiffness, shift)
    shapes = np.zeros((eigenvalues.size, degrees[0] + 1, degrees[1] + 1))
    shapes[:, parities[0] :: 2, parities[1] :: 2] = vectors.T.reshape(-1, len(mass_x), len(mass_y))
    return eigenvalues, shapes


def _smallest_first(stiffness: FloatArray, shift: float) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues and vectors of `stiffness`, smallest first; the largest are 1e6 to 1e10 times larger.

    A symmetric eigensolver errs by the rounding of the largest eigenvalue, so it gets the inverse of stiffness + shift,
    whose largest eigenvalues are the small ones; scaled to a diagonal of 1 that inverse is well conditioned.
    """
    raised = stiffness + shift * np.eye(len(stiffness))
    scale = 1.0 / np.sqrt(np.diag(raised))
    inverse = np.linalg.inv(raised * scale[:, None] * scale) * scale[:, None] * scale
    inverses, vectors = np.linalg.eigh((inverse + inverse.T) / 2.0)
    eigenvalues: FloatArray = 1.0 / np.maximum(inverses[::-1], np.finfo(float).tiny) - shift
    return eigenvalues, np.ascontiguousarray(vectors[:, ::-1])


def _edge_integrals(degree: int, parity: int, edge_mm: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the integrals along one edge of f f, f' f', f'' f'' and f f'' for one parity, scaled to 1/m."""
    per_m = 2e3 / edge_mm
    own = slice(parity, None, 2)
    orders = ((0, 0), (1, 1), (2, 2), (0, 2))
    mass, twist, bend, cross = (
        legendre.overlap(degree, left, right)[own, own] * per_m ** (left + right) for left, right in orders
    )
    return mass, twist, bend, cross


def _degree(radians: float) -> int:
    degree = math.ceil(_TERMS_PER_RADIAN * radians) + _TERMS_FOR_EDGES
    if degree > _MAX_DEGREE:
        raise ValueError("band_hz reaches waves too short for this plate size; lower its upper end.")
    return degree


def _mode_shape(size_mm: tuple[float, float], coefficients: FloatArray) -> ModeShape:
    nodal_lines, name, sign = _dominant_product(coefficients)
    scaled = coefficients * (sign / _peak(coefficients))
    scaled.setflags(write=False)
    return ModeShape(size_mm, scaled, nodal_lines, name)


def _dominant_product(coefficients: FloatArray) -> tuple[tuple[int, int], str, float]:
    """Nodal lines, name and sign, by expanding the shape in products of free-beam modes (Leissa's naming)."""
    terms_x, terms_y = coefficients.shape
    products = _beam_modes(terms_x - 1) @ coefficients @ _beam_modes(terms_y - 1).T
    size = np.abs(products)
    candidates = np.argwhere(size >= _EQUAL_FRAC * size.max()).tolist()
    i, j = max(candidates)
    name = f"{i}x{j}"
    if i != j and [j, i] in candidates:
        name += f"{'+' if products[i, j] * products[j, i] > 0.0 else '-'}{j}x{i}"
    return (i, j), name, math.copysign(1.0, float(products[i, j]))


@lru_cache(maxsize=8)
def _beam_modes(degree: int) -> FloatArray:
    """Free-beam modes (degree + 1, degree + 1) as rows of Legendre coefficients: row n has n nodes, end +1 positive."""
    bend = legendre.overlap(degree, 2, 2)
    beam = np.zeros_like(bend)
    for parity in (0, 1):
        own = slice(parity, None, 2)
        beam[own, own] = np.linalg.eigh(bend[own, own])[1].T
    at_end = beam @ legendre.values(np.ones(1), degree)[0]
    return beam * np.where(at_end < 0.0, -1.0, 1.0)[:, None]


def _peak(coefficients: FloatArray) -> float:
    """Return the largest |shape| on the plate: on a grid, then on two finer ones around the best point (to 1e-9)."""
    x = y = np.linspace(-1.0, 1.0, _PEAK_GRID)
    reach, peak = 2.0 / (_PEAK_GRID - 1), 0.0
    for _ in range(3):
        height = np.abs(_tensor(coefficients, x, y))
        row, column = np.unravel_index(int(np.argmax(height)), height.shape)
        peak = float(height[row, column])
        x, y = (np.clip(np.linspace(at - reach, at + reach, 33), -1.0, 1.0) for at in (x[column], y[row]))
        reach /= 16.0
    return peak


def _tensor(coefficients: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the shape on a grid of normalised coordinates -1 .. 1, (ny, nx)."""
    terms_x, terms_y = coefficients.shape
    result: FloatArray = legendre.values(y, terms_y - 1) @ coefficients.T @ legendre.values(x, terms_x - 1).T
    return result


def _on_plate(points_mm: npt.ArrayLike, size_mm: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    points = np.asarray(points_mm, np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points_mm has shape {points.shape}; give (N, 2), a row per point.")
    plate = np.clip(points * (2.0 / np.array(size_mm)), -1.0, 1.0)
    return plate[:, 0], plate[:, 1]


def _require_plate(size_mm: tuple[float, float], thickness_mm: float, material: Material) -> None:
    positive = {
        "size_mm[0]": size_mm[0],
        "size_mm[1]": size_mm[1],
        "thickness_mm": thickness_mm,
        "young_gpa": material.young_gpa,
        "density_kg_m3": material.density_kg_m3,
    }
    for name, value in positive.items():
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name} is {value}; give a positive number.")
    if not -1.0 < material.poisson <= 0.5:
        raise ValueError(f"poisson is {material.poisson}; an isotropic solid's lies above -1 and up to 0.5.")
