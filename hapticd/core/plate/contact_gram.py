"""Gram matrices of contact discs: the mean of phi phi^T over a disc, as a map.

A contact is a disc of some 5 mm radius, and a mode varies within it (half a wavelength is 13 mm). The mean square
amplitude under the contact is W' G W with the Gram matrix G = mean of phi phi^T over the disc; the part of the disc
beyond the plate's edge does not count. G is a smooth function of the disc's centre, so it is computed once on the
knots of the shapes' own map and interpolated by the same splines.

The maps hold the symmetric root S of G, not G: the square of an interpolated S is always a Gram matrix, without the
negative eigenvalues that interpolating G could give.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from .bicubic import FloatArray
from .mode_shapes import ModeShapes, Row

_NODES = 10  # per panel and direction: 2e-5 of the peak's square for discs of up to 5 mm on the reference plate
_LEAST_RADIUS_MM, _MOST_RADIUS_MM = 1e-6, 1e6  # a wider disc could overflow
_AT_ONCE = 2000  # discs integrated together: some tens of megabytes


class ContactGram:
    """Gram matrices of M shapes over discs of `radius_mm`; immutable.

    The maps are within 5e-4 of the quadrature inside the plate for discs of 5 mm, and within 1e-2 nearer the edge than
    that, where it cuts the disc; smaller discs vary faster (1 mm: 4e-3 and 2e-2), and a point needs no disc.
    """

    __slots__ = ("M", "_pairs", "_roots", "radius_mm")

    def __init__(self, modes: ModeShapes, radius_mm: float) -> None:
        """Integrate over a disc about every knot of `modes`. Raises ValueError as `disc_gram` does."""
        self.M, self.radius_mm = modes.M, float(radius_mm)
        knots = np.stack(np.meshgrid(modes.x_mm, modes.y_mm), axis=-1).reshape(-1, 2)
        roots = _symmetric_root(disc_gram(modes, knots, radius_mm))
        rows, columns = np.triu_indices(modes.M)
        upper = roots[:, rows, columns].T.reshape(-1, modes.y_mm.size, modes.x_mm.size)
        self._roots = ModeShapes(modes.x_mm, modes.y_mm, upper)
        # Index of the root's entry (j, k) among the maps of its upper triangle.
        place = {pair: index for index, pair in enumerate(zip(rows.tolist(), columns.tolist(), strict=True))}
        self._pairs = tuple([tuple([place[min(j, k), max(j, k)] for k in range(self.M)]) for j in range(self.M)])

    def at(self, x_mm: float, y_mm: float) -> tuple[Row, ...]:
        """G (M rows of M) of the disc about one point, plain floats only. Clamped outside; zeros for NaN."""
        entries = self._roots.at(x_mm, y_mm)
        if self.M == 2:
            s, t, u = entries
            mixed = t * (s + u)
            return (s * s + t * t, mixed), (mixed, t * t + u * u)
        root = [[entries[index] for index in row] for row in self._pairs]
        return tuple(
            [tuple([sum([a * b for a, b in zip(left, right, strict=True)]) for right in root]) for left in root]
        )

    def evaluate(self, points_mm: npt.ArrayLike) -> FloatArray:
        """G (N, M, M) of the discs about `points_mm` (N, 2). Raises ValueError for any other form."""
        root = self._roots.evaluate(points_mm)[:, np.array(self._pairs)]
        gram: FloatArray = root @ root
        return gram


def disc_gram(modes: ModeShapes, points_mm: npt.ArrayLike, radius_mm: float, nodes: int = _NODES) -> FloatArray:
    """G (N, M, M) by Gauss quadrature over each disc's part on the map.

    A disc about a point beyond the edge is moved to the edge, as shapes are; NaN gives zeros.
    Raises ValueError for points of another form and for a radius beyond 1e-6 to 1e6 mm.
    """
    if not _LEAST_RADIUS_MM <= radius_mm <= _MOST_RADIUS_MM:
        raise ValueError(f"radius_mm is {radius_mm}; give a contact's radius in mm, above 0.")
    points = np.asarray(points_mm, np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points_mm has shape {points.shape}; give (N, 2), a row per point.")
    unknown = np.asarray(np.isnan(points).any(axis=1), np.bool_)
    points = np.where(unknown[:, None], 0.0, points)
    gram = np.zeros((len(points), modes.M, modes.M))
    for start in range(0, len(points), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        where, weight = _disc_nodes(modes, points[part], float(radius_mm), nodes)
        phi = np.zeros((*weight.shape, modes.M))
        counts = weight > 0.0  # most panels are empty away from the edges
        phi[counts] = modes.evaluate(where[counts])
        gram[part] = np.swapaxes(phi, 1, 2) @ (phi * weight[..., None])
    gram[unknown] = 0.0
    return gram


def _disc_nodes(modes: ModeShapes, centres: FloatArray, radius_mm: float, nodes: int) -> tuple[FloatArray, FloatArray]:
    """Points (N, n, 2) and their weights (N, n), of sum 1, for the mean over each disc's part on the map.

    Chords along x at heights r sin(t), where t makes the disc's ends smooth. A chord is cut where it leaves the map; t
    is divided where cutting begins, so that every panel is smooth and Gauss's rule is exact to rounding.
    """
    (left, right), (bottom, top) = (modes.x_mm[[0, -1]], modes.y_mm[[0, -1]])
    x, y = np.clip(centres[:, 0], left, right), np.clip(centres[:, 1], bottom, top)
    low, high = (np.arcsin(np.clip((edge - y) / radius_mm, -1.0, 1.0)) for edge in (bottom, top))
    cuts = [_cut_rad(room, radius_mm) for room in (x - left, right - x)]
    bounds = np.sort([low, *(np.clip(sign * cut, low, high) for cut in cuts for sign in (-1, 1)), high], axis=0)

    node, share = np.polynomial.legendre.leggauss(nodes)
    half = np.diff(bounds, axis=0)[..., None] / 2.0  # (panels, N, 1)
    t = bounds[:-1, :, None] + half * (node + 1.0)
    reach = radius_mm * np.cos(t)
    start = np.maximum(-reach, (left - x)[:, None])
    half_chord = (np.minimum(reach, (right - x)[:, None]) - start) / 2.0
    along = (x[:, None] + start + half_chord)[..., None] + half_chord[..., None] * node  # (panels, N, n, n)
    height = np.broadcast_to((y[:, None] + radius_mm * np.sin(t))[..., None], along.shape)
    weight = (half * share * np.cos(t) * half_chord)[..., None] * share
    where = np.moveaxis(np.stack((along, height), axis=-1), 0, 1).reshape(len(centres), -1, 2)
    weight = np.moveaxis(weight, 0, 1).reshape(len(centres), -1)
    return where, weight / weight.sum(axis=1, keepdims=True)


def _cut_rad(room_mm: FloatArray, radius_mm: float) -> FloatArray:
    """|t| up to which chords are cut on a side with `room_mm` left; the disc's end where none is."""
    return np.where(room_mm < radius_mm, np.arccos(np.minimum(room_mm / radius_mm, 1.0)), math.pi / 2.0)


def _symmetric_root(gram: FloatArray) -> FloatArray:
    eigenvalues, vectors = np.linalg.eigh(gram)
    root: FloatArray = (vectors * np.sqrt(np.maximum(eigenvalues, 0.0))[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return root
