"""Self-calibration with a verdict: what moved, and whether held-out touches confirm it.

The windows are divided by sessions, or those of one by turns of a second. Each half is fitted, and judged on the other
one: by how much the residual of the plate's own sensors falls there against the calibration before, in units of what
chance does. The residual's square is summed over turns, which then count alike: a few with much residual would hide the
others. What is not confirmed on both halves is not adopted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ...core.plate.mode_shapes import ModeShapes, ParasiticModes
from ...values import FloatArray
from .coverage import map_sigma, touched_box, where_next
from .fit import Fit, fit
from .model import CENTROID, CENTROID_MM_S, LATENCY, LEAST_SIZED_MODES, PAD_PRIOR, Apart, Calibration, Free
from .observations import WINDOW_S, Windows
from .posture import PASSING, session_postures_mm, transferable, without_bias
from .waves import Waves, wave_number

LEAST_TOUCHED_S = 5.0
TURN_S = 1.0  # turns are as good as independent, so that their spread tells how sure the mean is
SURE = 3.0  # standard errors
WORTH_FRAC = 0.002  # of the residual's square: less is not felt
SENSE_OF_MAP = 0.012  # what a map as it is scanned, with 2 % of noise, passes for in an element of the sensors
MOST_WINDOWS = 6000  # times modes, for pad and sensors, evenly from all: more add time, not accuracy
MOST_FOR_MAP = 3600  # 72 s, as the service has at most: memory and time of a fit grow with them
# One sigma beyond which a recording does not tell: the pad's x, y in mm, rotation, scales, effective latency in s.
UNKNOWN = np.array((0.1, 0.1, 0.005, 0.003, 0.003))
UNKNOWN_LATENCY_S = 0.0015
NO_CHANGE = "The held-out touches confirm no change: the calibration is as good as this recording can tell."
FEW_WINDOWS = 2000  # times modes, for a first fit, and whether fingers are points
POINT_MM2 = 3.0  # of spread: a disc of 3.4 mm, smaller than any finger's; a pad off by 1 mm passes for 1 mm2
MOST_SIGMAS = 4.0  # of the pad's prior: what is farther off needs another step first
MOST_CROSSTALK = 0.2  # of sensors, and of modes that turned into each other since the scan: by 6 degrees, 0.1
MOST_DRIFT_HZ = 200.0  # of a mode in a recording: 20 kelvin and more
APART = 6.0  # sigmas by which halves may differ, and this much in units of UNKNOWN
Result = TypeVar("Result")
_FAR = "The fit is far from the calibration before: repeat `hapticd calibrate trackpad` or `resonance` first."


class HeldOutGain(NamedTuple):
    """By how much of itself the residual's square falls, and of how many standard errors a turn's gain is."""

    frac: float
    standard_errors: float


@dataclass(frozen=True, slots=True)
class TouchCalibration:
    """The calibration to adopt, which is the one in force if `refusal` says why; `fitted` is what the fit found.

    `gain_frac`: by how much of itself the held-out residual's square falls, of pad and sensors, and of the map.
    `touched_s`: the windows' time. `waves` is the basis of the map's change, `map_refusal` why it has none. `map_sigma`
    (3, 3) is one sigma of the changed map by ninths (`coverage`).
    """

    calibration: Calibration
    fitted: Calibration
    sigma: Calibration
    touched_s: float
    latency_s: float
    latency_sigma_s: float
    gain_frac: float
    map_gain_frac: float = 0.0
    refusal: str = ""
    map_refusal: str = ""
    waves: Waves | None = None
    fit: Fit | None = None
    map_sigma: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class _Fitter:
    """The plate that touches are fitted to: its map, and the parasitic modes if they are known."""

    modes: ModeShapes
    parasitic_modes: ParasiticModes | None
    waves: Waves | None = None
    are_points: bool = False

    @property
    def free(self) -> Free:
        """On few modes errors of the map pass for centroids of single touches."""
        apart = Apart.TOUCHES if self.modes.M >= LEAST_SIZED_MODES else Apart.SESSIONS
        return Free(pad=True, sense=True, waves=self.waves is not None, apart=apart)

    def fit(self, windows: Windows, free: Free, start: Calibration, near: Fit | None = None) -> Fit:
        return fit(
            *(windows, self.modes, free, start, self.waves, near),
            parasitic_modes=self.parasitic_modes,
            are_points=self.are_points,
        )

    def gain(self, held_out: Windows, before: Calibration, after: Calibration, near: Fit | None = None) -> HeldOutGain:
        """Return what a calibration gains on windows that did not teach it, of which `near` is a fit from `before`."""
        near = near or self.fit(held_out, Free(), before)
        at_start, at_end = (self.fit(held_out, Free(), one, near) for one in (before, after))
        turn = np.unique(np.floor(held_out.start_s / TURN_S), return_inverse=True)[1]
        before_cost, after_cost = np.bincount(turn, at_start.cost), np.bincount(turn, at_end.cost)
        worth = np.log(before_cost / after_cost)
        error = float(np.std(worth)) / np.sqrt(len(worth)) + 1e-12
        return HeldOutGain(float(1.0 - after_cost.sum() / before_cost.sum()), float(worth.mean()) / error)


def calibrate(windows: Windows, modes: ModeShapes, parasitic_modes: ParasiticModes | None = None) -> TouchCalibration:
    """Fit and judge, the map last. 60 s of touching on eight modes take 33 s of processor time, 20 s on two cores."""
    before = Calibration.nominal(modes.M)
    touched_s = len(windows) * WINDOW_S
    if touched_s < LEAST_TOUCHED_S:
        refusal = (
            f"Only {touched_s:.1f} s of touching while the plate followed its references, {LEAST_TOUCHED_S:g} s are "
            "needed: move two fingers for a minute, one of them slippery."
        )
        return TouchCalibration(before, before, before, touched_s, 0.0, np.inf, 0.0, 0.0, refusal, refusal)
    few, fewest = (_evenly(windows, most // modes.M) for most in (MOST_WINDOWS, FEW_WINDOWS))
    fitter = _Fitter(modes, parasitic_modes, are_points=True)
    near = fitter.fit(fewest, Free(pad=True, sense=True), before).calibration
    fitter = replace(fitter, are_points=_are_points(fewest, fitter, near))
    halves = _halves(few)
    one, other = _on_two_cores(lambda half: fitter.fit(half, fitter.free, near), halves)
    lessons = [transferable(windows, taught.calibration) for taught in (one, other)]
    gains = _on_two_cores(lambda half, lesson: fitter.gain(half, before, lesson), halves[::-1], lessons)
    found = fitter.fit(few, fitter.free, other.calibration)
    latency_s, latency_sigma_s = effective_latency(few, found)
    refusals = _refusals(found, latency_sigma_s, one, other, len(windows.sessions))
    refusal = next(refusals, "") or _unconfirmed(gains)
    judged = TouchCalibration(
        calibration=before if refusal else _without_gains(_effective(found.calibration, latency_s)),
        fitted=found.calibration,
        sigma=found.sigma,
        touched_s=touched_s,
        latency_s=latency_s,
        latency_sigma_s=latency_sigma_s,
        gain_frac=float(np.mean([gain.frac for gain in gains])),
        refusal=refusal,
        fit=found,
    )
    judged = _with_map(judged, _evenly(windows, MOST_FOR_MAP), fitter)
    if judged.refusal:
        return judged
    if _is_crossed(judged.fitted):
        return replace(judged, calibration=before, refusal=_FAR, map_refusal=_FAR, waves=None)
    return replace(judged, calibration=without_bias(judged.calibration, session_postures_mm(few, found)))


def _on_two_cores(task: Callable[..., Result], *arguments: Sequence[Any]) -> list[Result]:
    """Return what a task makes of both halves, by threads: numpy lets others run meanwhile."""
    with ThreadPoolExecutor(2) as cores:
        return list(cores.map(task, *arguments))


def _are_points(windows: Windows, fitter: _Fitter, near: Calibration) -> bool:
    """Whether touches act like points, smaller than skin does, or modes are too few to tell: a pad out of place would
    pass for a size then. `near` is where a fit of points has pad and sensors."""
    if fitter.modes.M < LEAST_SIZED_MODES:
        return True
    found = replace(fitter, are_points=False).fit(windows, Free(), near)
    return float(found.spread_mm2[windows.track[windows.track >= 0]].mean()) < POINT_MM2


def effective_latency(windows: Windows, found: Fit) -> tuple[float, float]:
    """Return latency and its sigma (s) with the centroid's shift as far as it acts as one at the fingers' speeds."""
    _, velocity = windows.fingers_mm()
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    speed = speed[np.isfinite(speed)]
    drawn = speed / np.hypot(speed, CENTROID_MM_S)
    weights = np.zeros(len(found.calibration.pad))
    weights[LATENCY], weights[CENTROID] = 1.0, (drawn * speed).sum() / max(float((speed**2).sum()), 1e-9)
    variance = float(weights @ found.covariance @ weights)
    return float(weights @ found.calibration.pad), float(np.sqrt(max(variance, 0.0)))


def _effective(found: Calibration, latency_s: float) -> Calibration:
    """The same with the latency that covers the centroid's shift, which the service does not model."""
    pad = found.pad.copy()
    pad[LATENCY], pad[CENTROID] = latency_s, 0.0
    return replace(found, pad=pad)


def _evenly(windows: Windows, most: int) -> Windows:
    """Return at most so many windows, evenly from all."""
    return windows.part(np.arange(most) * len(windows) // most if len(windows) > most else slice(None))


def _halves(windows: Windows) -> tuple[Windows, Windows]:
    """Every second session, or turn of the only one, and the others: what one posture teaches is judged on others."""
    sessions = windows.sessions
    is_first = np.any(sessions[::2], axis=0) if len(sessions) > 1 else np.floor(windows.start_s / TURN_S) % 2 == 0
    return windows.part(is_first), windows.part(~is_first)


def _refusals(found: Fit, latency_sigma_s: float, one: Fit, other: Fit, sessions: int) -> Iterator[str]:
    """Yield why nothing is to be adopted of a fit and those of its halves."""
    size, sigma = len(UNKNOWN), found.sigma
    if (sigma.pad[:size] > UNKNOWN).any():
        yield (
            f"The touches do not tell where the pad lies (x, y to within {sigma.pad[0]:.2f}, {sigma.pad[1]:.2f} mm): "
            "the fingers crossed too few node lines. Move them over the whole plate, along x and y."
        )
    if latency_sigma_s > UNKNOWN_LATENCY_S:
        yield (
            f"The touches do not tell the pad's latency (to within {1e3 * latency_sigma_s:.1f} ms): "
            "move the fingers faster, in all directions."
        )
    if (np.abs(found.calibration.pad) > MOST_SIGMAS * PAD_PRIOR).any():
        yield _FAR
    mode = int(np.argmax(found.drift_hz))
    if found.drift_hz[mode] > MOST_DRIFT_HZ:
        yield (
            f"Mode {mode} moved by {found.drift_hz[mode]:.0f} Hz while the plate was touched, more than a fit follows: "
            "let the plate warm up, and record again."
        )
    away = np.abs(one.calibration.pad - other.calibration.pad)[:size]
    posture = PASSING if sessions > 1 else np.zeros(size)
    allowed = APART * np.hypot(np.hypot(one.sigma.pad, other.sigma.pad)[:size], posture) + UNKNOWN
    if (away > allowed).any():
        yield "The two halves of the touches disagree: something moved meanwhile, or the fit failed. Record again."


def _is_crossed(found: Calibration) -> bool:
    """Whether sensors seem to see too much of other modes; without the map modes that have turned into each other pass
    for that, so it is asked last."""
    sense = np.abs(found.sense - np.eye(len(found.sense)))
    np.fill_diagonal(sense, 0.0)  # without the map its errors pass for gains
    return bool((sense > MOST_CROSSTALK).any())


def _unconfirmed(gains: list[HeldOutGain]) -> str:
    """Both halves have to be sure together, and each worth something and no mere chance."""
    together = sum(gain.standard_errors for gain in gains) / np.sqrt(len(gains))
    each = all(gain.frac >= WORTH_FRAC and gain.standard_errors >= 1.0 for gain in gains)
    return "" if together >= SURE and each else NO_CHANGE


def _with_map(judged: TouchCalibration, windows: Windows, fitter: _Fitter) -> TouchCalibration:
    """Fit and judge the map from where pad and sensors are."""
    if judged.refusal not in ("", NO_CHANGE):
        return replace(judged, map_refusal=judged.refusal)
    modes, parasitic = fitter.modes, fitter.parasitic_modes
    # On fewer modes, whose fingers are points, finer surfaces take up what contacts do: in one laboratory of four it
    # cost 3 % of the leak.
    box_mm = touched_box(windows, modes) if modes.M >= LEAST_SIZED_MODES else None
    waves = Waves(modes, wave_number(modes), None if parasitic is None else parasitic.modes, box_mm)
    fitter = replace(fitter, waves=waves)
    start = replace(judged.calibration, waves=np.zeros((modes.M, len(waves))))
    halves = _halves(windows)
    fits = _on_two_cores(lambda half: fitter.fit(half, fitter.free, start), halves)
    lessons = [taught.calibration for taught in fits]
    if len(windows.sessions) > 1:
        lessons = [replace(lesson, pad=start.pad) for lesson in lessons]
    gains = _on_two_cores(lambda half, *of: fitter.gain(half, start, *of), halves[::-1], lessons, fits[::-1])
    judged = replace(judged, map_gain_frac=float(np.mean([gain.frac for gain in gains])))
    if _unconfirmed(gains):
        place = where_next(windows, modes).sentence(len(windows) * WINDOW_S)
        return replace(judged, map_refusal=f"The map stays as it is. {place}")
    found = _mean(*fits)
    # Both halves know the priors, which count once.
    precision = fits[0].waves_precision + fits[1].waves_precision - np.diag(waves.prior.ravel() ** -2.0)
    latency_s, latency_sigma_s = effective_latency(windows, found)
    adopted = _effective(found.calibration, latency_s)
    return replace(
        judged,
        calibration=_with_gains_in_map(replace(adopted, waves=waves.of_scale(adopted.waves)), waves),
        fitted=found.calibration,
        sigma=found.sigma,
        latency_s=latency_s,
        latency_sigma_s=latency_sigma_s,
        refusal="",
        waves=waves,
        fit=found,
        map_sigma=map_sigma(waves, precision, modes),
    )


def _with_gains_in_map(found: Calibration, waves: Waves) -> Calibration:
    """Return the same motion of the plate by a map that makes up for the sensors' gains, which stay as calibrated.

    Touches tell the product of both alone, since the amplifiers' gains are free: a mode's limit is better kept by a
    gain that was measured.
    """
    gains = np.abs(np.diag(found.sense))
    return replace(found, sense=found.sense / gains[:, None], waves=waves.scaled(found.waves, gains))


def _without_gains(found: Calibration) -> Calibration:
    """Return pad and sensors alone, these as far as they are above what the map's errors pass for (James and Stein).

    Gains stay as they were: errors of the map pass for them, but not for crosstalk.
    """
    nominal = np.eye(len(found.sense), dtype=np.complex128)
    away = found.sense - nominal
    sure = np.maximum(0.0, 1.0 - SENSE_OF_MAP**2 / np.maximum(np.abs(away) ** 2, 1e-12))
    np.fill_diagonal(sure, 0.0)
    return replace(found, sense=nominal + sure * away)


def _mean(one: Fit, other: Fit) -> Fit:
    """The mean of both halves' fits, as good as a fit of all, whose cost it spares."""
    found, twin, a, b = one.calibration, other.calibration, one.sigma, other.sigma
    sense = np.hypot(a.sense.real, b.sense.real) / 2.0 + 1j * np.hypot(a.sense.imag, b.sense.imag) / 2.0
    return replace(
        one,
        calibration=Calibration(
            (found.pad + twin.pad) / 2.0, (found.sense + twin.sense) / 2.0, (found.waves + twin.waves) / 2.0
        ),
        sigma=Calibration(np.hypot(a.pad, b.pad) / 2.0, sense, np.hypot(a.waves, b.waves) / 2.0),
        covariance=(one.covariance + other.covariance) / 4.0,
        spread_mm2=(one.spread_mm2 + other.spread_mm2) / 2.0,
        spread_sigma_mm2=np.hypot(one.spread_sigma_mm2, other.spread_sigma_mm2) / 2.0,
    )
