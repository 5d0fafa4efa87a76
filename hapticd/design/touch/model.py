"""The plate under fingers, as a residual that is zero where pad, sensors and mode map are right.

In coordinates of what the sensors report, y with W = C y, the plate follows (design/README.md)

    dy/dt = C^-1 D C y + A y + B V - sum_i load_i C^-1 G_i C y,      G_i = phi phi^T + r_i grad phi . grad phi^T at P_i

G_i is a finger: a disc of radius a, over which a wave of k rad/mm has, to second order, the mean (1 - a^2 k^2 / 4)
phi phi^T + a^2 / 4 grad phi . grad phi^T; the load takes the first factor, and r_i (mm2) tells the size. D, each mode's
own rate, drifts smoothly with the temperature; it is diagonal in the plate's modes, so that modes of different
frequencies show what of each a sensor sees. A is small. B and what the control law does within a tick are free and
linear, as are the loads in each window. What is sought is where P_i is (pad), C (sensors) and phi (map). C is known up
to a factor, which the loads take: C[0, 0] stays 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ...core.plate.mode_shapes import ModeShapes, ParasiticModes
from ...values import ComplexArray, FloatArray
from .observations import Windows
from .terms import own_rates, regressors, shapes_at, with_slope
from .waves import Waves

PAD = ("x_mm", "y_mm", "rotation_rad", "scale_x", "scale_y", "latency_s", "centroid_mm")
LATENCY, CENTROID = PAD.index("latency_s"), PAD.index("centroid_mm")
# One sigma of what a laboratory meets. Latency, scale and centroid are ill-determined together without.
PAD_PRIOR = np.array((1.0, 1.0, 0.02, 0.005, 0.005, 0.004, 0.3))
SENSE_PRIOR = 0.03
CENTROID_MM_S = 20.0  # speed at which a contact's centroid has moved by 0.7 of its shift
DRIFT_PRIOR_1_S = 150.0  # 25 Hz
COUPLING_PRIOR_1_S = 3.0  # of modes to each other, fingers apart: by supports and damping
APART_PRIOR_MM = 0.35  # of a touch's centroid on each axis: its finger, its posture, its pressure
APART_WEIGHT = 8.0  # numbers that this prior counts as, where touches say how far apart they are
LOAD_PRIOR_FRAC = 0.15  # by which a window's load differs from that of the touch at the time
SPREAD_MM2 = 9.0  # r of a disc of 5.2 mm; 4 mm have 4.7, 7 mm 23, on waves of 32 mm
SPREAD_PRIOR_MM2 = 7.0
LEAST_SIZED_MODES = 4  # that tell a touch's size and its place apart
MOST_SPREAD_MM2 = 30.0  # no finger is larger than that of 9 mm
FOLLOWED_UM_S = 25.0  # measured less reference, per tick: as far off, a mode's slope errs as by noise
_APART_MM = 0.05  # of two gradients that give a curvature: it only steers the search
FORCE_S = 0.15  # in which a finger's force changes
_BLOCK = 256  # windows at most, whose derivatives are in memory at once
Block = tuple[npt.NDArray[np.int64], slice]  # windows, and those of their ticks that any of them has


@dataclass(frozen=True, slots=True)
class Calibration:
    """Unknowns: `pad` (7,) as in PAD, `sense` (M, M) complex, `waves` (M, K) that the map lacks; or its error."""

    pad: FloatArray
    sense: ComplexArray
    waves: FloatArray

    @classmethod
    def nominal(cls, modes: int) -> Calibration:
        """Return that of a plate which is as it was calibrated."""
        return cls(np.zeros(len(PAD)), np.eye(modes, dtype=np.complex128), np.zeros((modes, 0)))

    @property
    def affine(self) -> tuple[FloatArray, FloatArray]:
        """Return matrix (2, 2) and offset (2,): from where the fingers were taken to be, to where they are."""
        x_mm, y_mm, rotation_rad, scale_x, scale_y = self.pad[:5]
        return np.array(((1.0 + scale_x, -rotation_rad), (rotation_rad, 1.0 + scale_y))), np.array((x_mm, y_mm))


class Apart(StrEnum):
    """Scope of a centroid, next to the pad's place: nothing, each session (its posture), or each touch."""

    NONE = ""
    SESSIONS = "sessions"
    TOUCHES = "touches"


class Free(NamedTuple):
    """Unknown parts of the calibration."""

    pad: bool = False
    sense: bool = False
    waves: bool = False
    apart: Apart = Apart.NONE


@dataclass(frozen=True, slots=True)
class FitState:
    """A calibration and all else that is free: `rates` (M, L) of the regressors, `own` (M, K) of the splines in each
    mode's own rate, `loads` (B, N), `spread_mm2` (T,) of the contact of each of T touches, and `apart_mm` (R, 2), by
    which their centroids differ (`Model.contrasts`)."""

    calibration: Calibration
    rates: ComplexArray
    own: ComplexArray
    loads: ComplexArray
    spread_mm2: FloatArray
    apart_mm: FloatArray

    @classmethod
    def start(cls, calibration: Calibration, model: Model, spread_mm2: float) -> FitState:
        """Return that of a plate without fingers on it."""
        modes, windows = len(calibration.sense), model.windows
        shapes = (modes, model.terms.shape[-1]), (modes, model.splines.shape[-1]), windows.track.shape
        rates, own, loads = (np.zeros(shape, np.complex128) for shape in shapes)
        spreads_mm2 = np.full(len(windows.tracks), spread_mm2)
        return cls(calibration, rates, own, loads, spreads_mm2, np.zeros((model.contrasts.shape[1], 2)))


class ModelPoint(NamedTuple):
    """The model at one state: residual (B, S, M) in um/s, its derivatives `by_loads` (B, S, M, 2 N + 1), with itself
    last, and those by what parameters these windows meet, of `places` (U,) in the order of `TouchProblem.parts`: by the
    waves, if free, `by_shapes` (B, S, M, M 3 N) times their `shapes` (B, S, 3 N, K) under fingers, `columns` (B, S, M,
    C) by what else all modes meet, and `by_rates` (B, S, R) of each mode's by its rates, which no other mode meets."""

    residual: ComplexArray
    by_loads: ComplexArray
    by_shapes: ComplexArray
    shapes: npt.NDArray[np.float32]
    columns: ComplexArray
    by_rates: ComplexArray
    places: npt.NDArray[np.int64]

    def of_mode(self, mode: int, weight: FloatArray) -> tuple[FloatArray, list[tuple[slice, Any]]]:
        """Return a mode's weighted rows, real (B, 2 S, ..): by the loads' parts, with the residual as last column; and
        by slices of `places`, of which the waves, most of all and with priors, are in single precision."""
        each = self.by_loads[:, :, mode], self.by_shapes[:, :, mode], self.columns[:, :, mode], self.by_rates
        own, by_shapes, columns, by_rates = (_rows(one * weight[..., None]) for one in each)
        by_tick = by_shapes.astype(np.float32).reshape(*weight.shape, -1, self.shapes.shape[2])
        by_waves = (by_tick @ self.shapes).reshape(len(own), own.shape[1], -1)
        waves, common, rates = (one.shape[-1] for one in (by_waves, columns, by_rates))
        first = waves + common + mode * rates
        places = slice(waves), slice(waves, waves + common), slice(first, first + rates)
        return own, list(zip(places, (by_waves, columns, by_rates), strict=True))


class Placed(NamedTuple):
    """Fingers of all windows as a calibration has them: positions and velocities (B, S, N, 2) as reported, `points` as
    corrected, `drawn`, the direction in which a centroid is drawn, `phi` (B, S, N, 3, M), shapes and their derivatives
    along x and y, `seen_um` (B, S, M) of the sensors, and `under_um` (B, S, N, 3), what driven modes make of `phi`."""

    position: FloatArray
    velocity: FloatArray
    points: FloatArray
    drawn: FloatArray
    phi: FloatArray
    seen_um: ComplexArray
    under_um: ComplexArray


class Model:
    """Residual and derivatives over some windows. The waves are evaluated once, where `start` has the fingers: they are
    some per cent of a map, and positions move by some per cent of a wavelength."""

    def __init__(
        self,
        windows: Windows,
        modes: ModeShapes,
        start: Calibration,
        waves: Waves | None = None,
        parasitic_modes: ParasiticModes | None = None,
        apart: Apart = Apart.TOUCHES,
    ) -> None:
        self.windows, self.modes, self.waves, self._parasitic = windows, modes, waves, parasitic_modes
        self._beside_um = np.zeros((*windows.t_s.shape, windows.track.shape[1], 3), np.complex128)
        ticks = windows.is_used.sum(axis=1)
        parts = np.array_split(np.argsort(ticks, kind="stable"), -(-len(windows) // _BLOCK))  # by ticks, then time
        self.blocks: list[Block] = [(rows, slice(int(ticks[rows].max()))) for rows in parts]
        self.terms = regressors(windows)
        self.splines = own_rates(windows)
        doubt = np.hypot(1.0, np.abs(windows.behind_um_s) / FOLLOWED_UM_S)
        self.doubt = np.where(windows.is_used[..., None], doubt, np.inf)  # of a tick, in units of the noise
        self._placed: tuple[Calibration, FloatArray, Placed] | None = None
        self._beside: tuple[Placed, FloatArray, ComplexArray] | None = None  # parasitic shapes, and how they yield
        self._known = windows.slope_um_s + 1j * windows.turning_rad_s[..., None] * windows.measured_um
        points = _moved(start, *windows.fingers_mm(float(start.pad[LATENCY])))[0]
        self._touches = (windows.track[..., None] == np.arange(len(windows.tracks))).astype(np.float64)  # (B, N, T)
        moved_um = np.einsum("bsnm,bsm->bsn", shapes_at(modes, points)[..., 0, :], windows.measured_um @ start.sense.T)
        weights = np.einsum("bsn,bnt->t", np.abs(moved_um) ** 2, self._touches)
        sessions = np.array([one.session for one in windows.tracks], np.int64)
        group = sessions if apart is Apart.SESSIONS else np.arange(len(weights))
        self.contrasts = _contrasts(np.bincount(group, weights).astype(np.float64))[group]  # (T, R)
        # Of a minute of touching by far the largest array.
        self._shapes = np.zeros((*points.shape[:2], 3 * points.shape[2], len(waves or ())), np.float32)
        if waves is not None:
            is_down = np.isfinite(points).all(axis=-1)
            shapes = with_slope(waves.at(points[is_down]), waves.slope(points[is_down]))
            self._shapes.reshape(*points.shape[:-1], 3, -1)[is_down] = shapes

    def _place(self, state: FitState) -> Placed:
        """Return where a state has the fingers; kept for the next call, since most have the same places."""
        found, apart_mm = state.calibration, state.apart_mm
        if self._placed is None or self._placed[0] is not found or self._placed[1] is not apart_mm:
            position, velocity = self.windows.fingers_mm(float(found.pad[LATENCY]))
            points, drawn = _moved(found, position, velocity)
            points = points + (self._touches @ self.contrasts @ apart_mm)[:, None]
            phi = shapes_at(self.modes, points)
            if self.waves is not None:
                phi = phi + (self._shapes @ found.waves.T.astype(np.float32)).reshape(phi.shape)
            seen_um = self.windows.measured_um @ found.sense.T
            under_um = np.asarray(np.einsum("bsnqk,bsk->bsnq", phi, seen_um), np.complex128)
            self._placed = found, apart_mm, Placed(position, velocity, points, drawn, phi, seen_um, under_um)
        return self._placed[2]

    def residual(self, state: FitState) -> ComplexArray:
        """Return the residual alone, of all windows (B, S, M)."""
        placed = self._place(state)
        out = placed.phi @ np.linalg.inv(state.calibration.sense).T
        force = np.einsum("bsnqk,bsnq->bsk", out, (placed.under_um + self._beside_um) * self._shared(state))
        moving = (self.splines @ state.own.T * placed.seen_um) @ np.linalg.inv(state.calibration.sense).T
        return np.asarray(self._known + self.terms @ state.rates.T + moving + force, np.complex128)

    def settle(self, state: FitState) -> None:
        """Take the parasitic modes to move as the fingers of `state` drive them; far from the drive, they follow."""
        parasitic = self._parasitic
        if parasitic is None:
            return
        placed = self._place(state)
        if self._beside is None or self._beside[0] is not placed:
            phi = shapes_at(parasitic.modes, placed.points)
            own = np.array(parasitic.decay_1_s) - 1j * np.array(parasitic.detuning_rad_s)
            yielding = np.asarray(1.0 / (own + 1j * self.windows.turning_rad_s[..., None]), np.complex128)
            self._beside = placed, phi, yielding
        _, phi, yielding = self._beside
        under_um = self._shared(state) * (placed.under_um + self._beside_um)
        moved_um = -np.einsum("bsnqp,bsnq->bsp", phi, under_um) * yielding
        self._beside_um = np.einsum("bsnqp,bsp->bsnq", phi, moved_um)

    def _shared(self, state: FitState, rows: slice | npt.NDArray[np.int64] = slice(None)) -> ComplexArray:
        """Return the load (B, 1, N, 3) on the shape under a finger and on its derivatives."""
        touch = self.windows.track[rows]
        spread_mm2 = np.where(touch >= 0, state.spread_mm2[touch], 0.0)
        shares = np.stack((np.ones_like(spread_mm2), spread_mm2, spread_mm2), axis=-1)
        return np.asarray((state.loads[rows][..., None] * shares)[:, None], np.complex128)

    def at(self, state: FitState, ticks: Block, free: Free) -> ModelPoint:
        """Return the model at `state` for some windows, with derivatives by what is free."""
        found, rows = state.calibration, ticks[0]
        placed = Placed._make(one[ticks] for one in self._place(state))
        phi, loads = placed.phi, self._shared(state, rows)
        inverse = np.asarray(np.linalg.inv(found.sense), np.complex128)
        out = np.asarray(phi @ inverse.T, np.complex128)  # C^-1 phi
        under_um = np.asarray(placed.under_um + self._beside_um[ticks], np.complex128)
        pushed = out * under_um[..., None]
        force = np.einsum("bsnqk,bznq->bsk", pushed, loads)
        own = self.splines[ticks] @ state.own.T
        moving = (own * placed.seen_um) @ inverse.T
        residual = self._known[ticks] + self.terms[ticks] @ state.rates.T + moving + force
        columns: list[ComplexArray] = []
        if free.pad or free.waves or free.apart:
            # By phi_m of finger n: load (C^-1[:, m] phi.Cy + C^-1 phi (Cy)_m).
            by_phi = loads[..., None, None] * (
                inverse * under_um[..., None, None] + out[..., :, None] * placed.seen_um[:, :, None, None, None, :]
            )
        if free.pad or free.apart:
            by_place = np.einsum("bsnqkm,bsnqmd->bsnkd", by_phi, self._slope(placed.points), optimize=True)
        if free.pad:
            columns.append(np.einsum("bsnkd,bsndp->bskp", by_place, _by_pad(placed, found), optimize=True))
        if free.sense:
            turned = moving + np.einsum("bznq,bsnqk->bsk", loads, pushed)
            scaled = np.einsum("bsnqk,bsnqm->bskm", loads[..., None] * out, phi) + inverse * own[..., None, :]
            by_sense = _by_sense(self.windows.measured_um[ticks], turned, scaled, inverse)
            columns += [by_sense, 1j * by_sense]
        if free.apart:
            by_apart = np.einsum("bsnkd,bnr->bskrd", by_place, self._touches[rows] @ self.contrasts, optimize=True)
            columns.append(by_apart.reshape(*residual.shape, -1))
        by_spread = np.einsum("bsnqk,bn->bskn", pushed[..., 1:, :], state.loads[rows])
        columns.append(by_spread @ self._touches[rows][:, None])
        met = np.flatnonzero(self.splines[ticks].any(axis=(0, 1)))  # splines are local, but for the constant
        by_own = np.einsum("km,bsm,bsl->bskml", inverse, placed.seen_um, self.splines[ticks][..., met])
        by_own, by_rates = by_own.reshape(*residual.shape, -1), self._expected_terms(state, residual, ticks)
        waves = len(inverse) * self._shapes.shape[-1] if free.waves else 0
        by_shapes = by_phi.transpose(0, 1, 4, 5, 2, 3) if free.waves else np.zeros((*residual.shape, 0))
        first = np.arange(waves + sum(one.shape[-1] for one in columns))
        own_places = len(first) + np.arange(2 * state.own.size).reshape(2, *state.own.shape)
        rates = len(first) + own_places.size + np.arange(2 * state.rates.size).reshape(2, *state.rates.shape)
        ones = self._shared(replace(state, loads=np.ones_like(state.loads)), rows)
        by_loads = np.einsum("bsnqk,bznq->bskn", pushed, ones)
        return ModelPoint(
            residual,
            np.concatenate((by_loads, 1j * by_loads, residual[..., None]), axis=-1),
            by_shapes.reshape(*residual.shape, -1),
            self._shapes[ticks],
            np.concatenate((*columns, by_own, 1j * by_own), axis=-1),
            np.concatenate((by_rates, 1j * by_rates), axis=-1),
            np.concatenate((first, own_places[..., met].ravel(), rates.swapaxes(0, 1).ravel())),
        )

    def _expected_terms(self, state: FitState, residual: ComplexArray, ticks: Block) -> ComplexArray:
        """Return the linear terms (B, S, L) with the voltages that the model expects.

        A tick's own voltage holds what the control law makes of the sensors' noise. Noise in a regressor makes its
        coefficient, and with it all forces, too small.
        """
        terms, volts = self.terms[ticks].copy(), slice(residual.shape[-1], 2 * residual.shape[-1])
        gain = state.rates[:, volts]
        if gain.any():
            terms[..., volts] -= residual @ np.linalg.inv(gain).T
        return terms

    def _slope(self, points: FloatArray) -> FloatArray:
        """Return the gradient of the same of the map (B, S, N, 3, M, 2), zero where there is no finger."""
        steps = np.eye(2) * _APART_MM
        ahead, behind = ([shapes_at(self.modes, points + sign * step) for step in steps] for sign in (1.0, -1.0))
        slope = (np.stack(ahead, axis=-1) - np.stack(behind, axis=-1)) / (2.0 * _APART_MM)
        return np.asarray(slope, np.float64)


def _contrasts(weights: FloatArray) -> FloatArray:
    """Return R ways (T, R) in which touches differ: orthonormal, and 0 on their mean by these weights (T,), the
    pad's place. A finger shows its place as far as it moves the plate: what a still one hides blurs no mean."""
    seen = np.flatnonzero(weights)
    if len(seen) == 0:
        return np.zeros((len(weights), 0))
    basis = np.linalg.qr(np.column_stack((weights[seen], np.eye(len(seen))[:, 1:])))[0]
    found = np.zeros((len(weights), len(seen) - 1))
    found[seen] = basis[:, 1:]
    return found


def _rows(columns: ComplexArray) -> FloatArray:
    """Real rows of each window: (B, S, C) to (B, 2 S, C)."""
    return np.stack((columns.real, columns.imag), axis=2).reshape(len(columns), 2 * columns.shape[1], -1)


def _moved(found: Calibration, position: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return where the fingers are (..., 2), and the direction in which their centroids are drawn, with its share."""
    matrix, offset_mm = found.affine
    drawn = velocity / np.sqrt((velocity**2).sum(axis=-1, keepdims=True) + CENTROID_MM_S**2)
    return position @ matrix.T + offset_mm + found.pad[CENTROID] * drawn, drawn


def _by_sense(y_um: ComplexArray, turned: ComplexArray, scaled: ComplexArray, inverse: ComplexArray) -> ComplexArray:
    """By C[m, l]: -C^-1[:, m] `turned`_l + `scaled`[:, m] y_l, of C^-1 F C y its value and C^-1 F."""
    by_sense = scaled[..., None] * y_um[:, :, None, None, :]
    by_sense -= np.einsum("km,bsl->bskml", inverse, turned)
    return np.asarray(by_sense.reshape(*by_sense.shape[:3], -1)[..., 1:], np.complex128)


def stepped(found: Calibration, pad: FloatArray, sense: ComplexArray, waves: FloatArray) -> Calibration:
    """Return a calibration that is changed by a solution's parts; `sense` is without its first."""
    modes = len(found.sense)
    step = np.concatenate(((0.0,), sense)).reshape(modes, modes) if len(sense) else 0.0
    lacking = waves.reshape(found.waves.shape) if waves.size else 0.0
    moved = found.pad + pad if pad.size else found.pad
    return replace(found, pad=moved, sense=found.sense + step, waves=found.waves + lacking)


def _by_pad(placed: Placed, found: Calibration) -> FloatArray:
    """Derivatives of the position (..., 2, 7) by PAD; zero where there is no finger."""
    position = placed.position
    by_pad = np.zeros((*position.shape, len(PAD)))
    by_pad[..., 0, 0] = by_pad[..., 1, 1] = 1.0
    by_pad[..., 0, 2], by_pad[..., 1, 2] = -position[..., 1], position[..., 0]
    by_pad[..., 0, 3], by_pad[..., 1, 4] = position[..., 0], position[..., 1]
    by_pad[..., LATENCY], by_pad[..., CENTROID] = placed.velocity @ found.affine[0].T, placed.drawn
    return np.nan_to_num(by_pad)
