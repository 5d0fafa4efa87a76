"""Fit of a scan by a sum of free-plate modes: a dozen parameters instead of a hundred.

A mode of the real plate is a mixture of the theory's modes of nearly the same frequency. Material and thickness mostly
scale the frequencies, so the modes are selected by wave number. `cartography` compares the prediction error with that
of the smoothing fit, which needs no free, flat and homogeneous plate.

Such modes depend on the plate's edges, so they also determine the scan's pose on the plate, its rotation and shift: the
one that, with the best mode coefficients, leaves the least squared misfit. The coefficients enter linearly and are
eliminated (variable projection: G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413; slopes by L. Kaufman, BIT
15 (1975) 49); three parameters are left for Gauss-Newton steps. From the nominal pose these converge for 5 degrees and
4 mm on the reference plate; half a wavelength (13 mm at the rim) is another minimum.

And they give its signs to a scan by added mass: how far a grain of wax lowers a mode's frequency goes with the mode's
square there, by its share of the kinetic energy (Lord Rayleigh, The Theory of Sound (1877), ch. 4). The mode that is
most like the readings' magnitudes gives the first signs; modes near its frequency, fitted to the signed readings, the
next, until no sign changes. Where a sign is wrong nevertheless, the mode is near zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.errors import ModesError
from hapticd.values import FloatArray

from . import legendre
from .glued_plate import GluedPlate
from .materials import MATERIALS
from .section import wave_hz
from .smoothing import Order, Smoothed

_EXACT = 1e-20  # share of the data's square: a smaller misfit is rounding, which no pose explains
_MIXED_FRAC = 0.01  # of the frequency: modes that are nearer to each other mix
BAND_FRAC = 0.08  # of the frequency: covers modes that the real plate mixes in, and the error of the wave number

_WAVE_RAD, _WAVE_BAND_FRAC = 36.0, 0.9  # by wax: k times the longer edge, and of the frequency about it: 11 to 50 rad
_LEAST_ALIKE = 0.75  # cosine of magnitudes; those of two modes by chance have 0.64
_MOST_ROUNDS = 30

# Frequencies of these only label the modes: a plate of another thickness has nearly the same shapes.
_THICKNESS_MM, _MATERIAL = 2.0, MATERIALS["glass"]

Basis = Callable[[FloatArray, Order], FloatArray]  # a partial derivative of all modes at points (N, 2): (N, modes)

_MOST_STEPS = 20  # four are usual
_MOST_HALVINGS = 10
_SETTLED = 1e-9  # least share of the misfit that a step must remove


class Pose(NamedTuple):
    """Rotation about the plate's centre, then a shift: takes the scan's points to the plate's frame."""

    rotation_rad: float
    x_mm: float
    y_mm: float

    def on_plate(self, points_mm: FloatArray) -> FloatArray:
        """Return the scan's `points_mm` (N, 2) in the plate's frame."""
        cos, sin = math.cos(self.rotation_rad), math.sin(self.rotation_rad)
        x, y = points_mm.T
        return np.stack((cos * x - sin * y + self.x_mm, sin * x + cos * y + self.y_mm), axis=-1)

    def moved(self, step: FloatArray) -> Pose:
        """Return the pose with `step` (3,) added."""
        rotation_rad, x_mm, y_mm = step.tolist()
        return Pose(self.rotation_rad + rotation_rad, self.x_mm + x_mm, self.y_mm + y_mm)


NOMINAL = Pose(0.0, 0.0, 0.0)


def find_pose(basis: Basis, points_mm: FloatArray, values: FloatArray) -> Pose:
    """Return the pose in which sums of `basis` best fit `values` (N, M) at `points_mm` (N, 2), from the nominal one."""
    pose, misfit = NOMINAL, math.inf
    step = np.zeros(3)
    for _ in range(_MOST_STEPS):
        for _ in range(_MOST_HALVINGS):
            now, next_step = _misfit_and_step(basis, pose.moved(step), points_mm, values)
            if now < misfit:
                break
            step = step / 2.0
        if not now < misfit * (1.0 - _SETTLED):
            return pose
        pose, misfit, step = pose.moved(step), now, next_step
    return pose


def _misfit_and_step(basis: Basis, pose: Pose, points_mm: FloatArray, values: FloatArray) -> tuple[float, FloatArray]:
    """Return the squared misfit of a pose, and its Gauss-Newton step (3,)."""
    points = pose.on_plate(points_mm)
    design = basis(points, (0, 0))
    span, _ = np.linalg.qr(design)
    coefficients = np.linalg.lstsq(design, values, rcond=None)[0]
    residual = values - design @ coefficients
    along_x, along_y = (basis(points, order) @ coefficients for order in ((1, 0), (0, 1)))
    arm_x, arm_y = (points - (pose.x_mm, pose.y_mm)).T  # a rotation moves a point across its arm
    turned = along_y * arm_x[:, None] - along_x * arm_y[:, None]
    slopes = np.stack((turned, along_x, along_y), axis=-1)
    slopes -= np.tensordot(span, np.tensordot(span.T, slopes, axes=1), axes=1)
    step = np.linalg.lstsq(slopes.reshape(-1, 3), residual.ravel(), rcond=None)[0]
    return float(np.vdot(residual, residual)), step


def nearest_free_modes(
    modes: ModeShapes, wavelength_mm: float, size_mm: tuple[float, float]
) -> tuple[tuple[str, float], ...]:
    """Return for each mode the most similar free-plate mode near its wavelength: its name, and the squared correlation
    over the map with the best mixture of it and its neighbours in frequency, which patches, supports and tolerances
    mix. () where theory has none.

    Source of the measure: R. J. Allemang and D. L. Brown, Proc. 1st Int. Modal Analysis Conf. (1982) 110.
    """
    try:
        free = FreePlateModes(size_mm, 2.0 * math.pi / wavelength_mm)
    except ValueError:
        return ()
    if not len(free):
        return ()
    points = np.stack(np.meshgrid(modes.x_mm, modes.y_mm), axis=-1).reshape(-1, 2)
    theory, measured = free.at(points), modes.shapes.reshape(modes.M, -1)
    found = []
    for mode in measured:
        likest = int(np.argmax((mode @ theory) ** 2 / (theory**2).sum(axis=0)))
        near = theory[:, np.abs(free.frequencies_hz / free.frequencies_hz[likest] - 1.0) <= _MIXED_FRAC]
        held = near @ np.linalg.lstsq(near, mode, rcond=None)[0]
        found.append((free.names[likest], float(held @ held / max(mode @ mode, np.finfo(float).tiny))))
    return tuple(found)


class FreeFit(NamedTuple):
    """A fit by free-plate modes, and the scan's pose."""

    fit: Smoothed
    pose: Pose


class FreePlateModes:
    """Basis of the free-plate modes with wave numbers near `wave_rad_mm`, on a plate of `size_mm`: within `band_frac`
    of the frequency. `frequencies_hz` are those of some plate of this size."""

    def __init__(self, size_mm: tuple[float, float], wave_rad_mm: float, band_frac: float = BAND_FRAC) -> None:
        frequency_hz = wave_hz(wave_rad_mm, _THICKNESS_MM, _MATERIAL)
        band_hz = (frequency_hz * (1.0 - band_frac), frequency_hz * (1.0 + band_frac))
        found = GluedPlate(size_mm, _THICKNESS_MM, _MATERIAL).modes(band_hz)
        self._half_mm = np.array(size_mm) / 2.0
        self.frequencies_hz = np.array([hz for hz, _ in found])
        self._shapes = [shape for _, shape in found]
        self.names = tuple(shape.name for shape in self._shapes)

    def __len__(self) -> int:
        return len(self._shapes)

    def at(self, points_mm: FloatArray, order: Order = (0, 0)) -> FloatArray:
        """Return a partial derivative, per mm, of all modes at `points_mm` (N, 2), clamped to the plate: (N, modes)."""
        x, y = np.clip(points_mm / self._half_mm, -1.0, 1.0).T
        coefficients = np.stack([shape.coefficients for shape in self._shapes])  # (modes, nx, ny)
        along_x, along_y = (
            legendre.values(position, degrees - 1, derivative) / half_mm**derivative
            for position, degrees, derivative, half_mm in zip(
                (x, y), coefficients.shape[1:], order, self._half_mm, strict=True
            )
        )
        product: FloatArray = np.einsum("nmj,nj->nm", np.tensordot(along_x, coefficients, axes=(1, 1)), along_y)
        return product

    def fit(self, points_mm: FloatArray, values: FloatArray) -> FreeFit:
        """Fit `values` (N, M) at `points_mm` (N, 2) by least squares; coefficients are (modes, M).

        A pose other than the nominal one is accepted only if its three parameters lower the misfit by what Schwarz's
        criterion requires (G. Schwarz, Ann. Stat. 6 (1978) 461).
        """
        nominal = self._fit(NOMINAL, points_mm, values)
        scale = np.sqrt((values**2).mean(axis=0))
        if ((nominal.fit.residual / scale) ** 2).sum() < _EXACT * values.size:
            return nominal
        moved = self._fit(find_pose(self.at, points_mm, values / scale), points_mm, values)
        misfits = [float(((one.fit.residual / scale) ** 2).sum()) for one in (nominal, moved)]
        price = math.exp(len(Pose._fields) * math.log(values.size) / values.size)
        return moved if misfits[1] * price < misfits[0] else nominal

    def on_grid(self, coefficients: FloatArray, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return the surfaces `coefficients` (modes, M) on a grid: (M, ny, nx)."""
        shapes = np.stack([shape.on_grid(x_mm, y_mm) for shape in self._shapes])
        return np.asarray(np.tensordot(coefficients.T, shapes, axes=1))

    def _fit(self, pose: Pose, points_mm: FloatArray, values: FloatArray) -> FreeFit:
        design = self.at(pose.on_plate(points_mm))
        coefficients = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], np.float64)
        surfaces = values.shape[1]
        found = len(self) + (0.0 if pose == NOMINAL else len(pose) / surfaces)
        freedom = np.full(surfaces, float(found))
        return FreeFit(Smoothed(coefficients, freedom, values - design @ coefficients), pose)


def signed(points_mm: FloatArray, lowered_hz: FloatArray, size_mm: tuple[float, float]) -> FloatArray:
    """Return the modes at the points (N, M), in roots of Hz, NaN where missing. Raises ModesError."""
    theory = FreePlateModes(size_mm, _WAVE_RAD / max(size_mm), band_frac=_WAVE_BAND_FRAC)
    shapes = theory.at(points_mm)
    columns = [_signed(shapes, theory.frequencies_hz, lowered_hz[:, mode], mode) for mode in range(lowered_hz.shape[1])]
    return np.stack(columns, axis=1)


def _signed(shapes: FloatArray, frequencies_hz: FloatArray, lowered_hz: FloatArray, mode: int) -> FloatArray:
    known = np.isfinite(lowered_hz)
    root = np.sqrt(np.maximum(lowered_hz[known], 0.0))
    sizes = np.abs(shapes[known])
    lengths = np.linalg.norm(root) * np.linalg.norm(sizes, axis=0)
    alike = root @ sizes / np.maximum(lengths, np.finfo(float).tiny)
    likest = int(alike.argmax())
    if not alike[likest] >= _LEAST_ALIKE:
        raise ModesError(
            f"lowered_hz_{mode + 1} is like no mode of a free plate; check --size, that positions are in mm from its "
            "centre, and that lower frequencies are positive."
        )
    near = shapes[known][:, np.abs(frequencies_hz / frequencies_hz[likest] - 1.0) <= BAND_FRAC]
    signs = np.sign(shapes[known][:, likest])
    for _ in range(_MOST_ROUNDS):
        before, signs = signs, np.sign(near @ np.linalg.lstsq(near, signs * root, rcond=None)[0])
        if np.array_equal(signs, before):
            break
    found = np.full(lowered_hz.shape, np.nan)
    found[known] = signs * root
    return found
