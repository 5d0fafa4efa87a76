"""Self-calibration with a verdict: what moved, and whether touches that taught nothing confirm it.

The windows are divided by sessions, or those of one by turns of a second (`evidence`). Each half is fitted, and judged
on the other one: by how much the residual falls there against the calibration before, in units of what chance does.
What is not confirmed on both is not adopted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.plate.mode_shapes import ModeShapes, ParasiticModes
from ...values import FloatArray
from .coverage import Ninth, box_sigma, map_sigma, touched_box, where_next
from .evidence import SURE, TURN_S, WORTH_FRAC, HeldOutGain, gain_of
from .fit import Fit, fit
from .model import CENTROID, CENTROID_MM_S, LATENCY, LEAST_SIZED_MODES, PAD_PRIOR, Apart, Calibration, Free
from .observations import WINDOW_S, Windows
from .posture import PASSING, session_postures_mm, transferable, without_bias
from .waves import Waves, wave_number

LEAST_TOUCHED_S = 5.0
SENSE_OF_MAP = 0.012  # what a map as it is scanned, with 2 % of noise, passes for in an element of the sensors
MOST_WINDOWS = 1500  # for pad and sensors, evenly from all: more add time, not accuracy
MOST_FOR_MAP = 3600  # 72 s, as the service has at most: memory and time of a fit grow with them
# One sigma beyond which a recording does not tell: the pad's x, y in mm, rotation, scales, effective latency in s.
UNKNOWN = np.array((0.1, 0.1, 0.005, 0.003, 0.003))
UNKNOWN_LATENCY_S = 0.0015
NO_CHANGE = "The held-out touches confirm no change: the calibration is as good as this recording can tell."
FEW_WINDOWS = 500  # for a first fit, and whether fingers are points
POINT_MM2 = 3.0  # of spread: a disc of 3.4 mm, smaller than any finger's; a pad off by 1 mm passes for 1 mm2
MOST_SIGMAS = 4.0  # of the pad's prior: what is farther off needs another step first
MOST_CROSSTALK = 0.2  # of sensors, and of modes that turned into each other since the scan: by 6 degrees, 0.1
MOST_DRIFT_HZ = 200.0  # of a mode in a recording: 20 kelvin and more
APART = 6.0  # sigmas by which halves may differ, and this much in units of UNKNOWN
_FAR = "The fit is far from the calibration before: repeat `hapticd calibrate trackpad` or `resonance` first."


@dataclass(frozen=True, slots=True)
class Judged:
    """The calibration to adopt, which is the one in force if `refusal` says why; `fitted` is what the fit found.

    `gain_frac`: by how much of itself the held-out residual's square falls, of pad and sensors, and of the map.
    `touched_s`: the windows' time. `waves` is the basis of the map's change, `map_refusal` why it has none, and
    `next_place` where more touching would help then. `map_sigma` (3, 3) is one sigma of the changed map by ninths
    (`coverage`), `touched_sigma` that in the box that was touched, `touched_mm` (2, 2), its least and largest x and y.
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
    next_place: Ninth | None = None
    map_sigma: FloatArray | None = None
    touched_mm: FloatArray | None = None
    touched_sigma: float = 0.0


@dataclass(frozen=True, slots=True)
class _Fitter:
    """The plate that touches are fitted to: its map, and the parasitic modes if they are known."""

    modes: ModeShapes
    parasitic_modes: ParasiticModes | None
    waves: Waves | None = None
    are_points: bool = False

    def fit(self, windows: Windows, free: Free, start: Calibration, judged_by_um_s: FloatArray | None = None) -> Fit:
        return fit(
            *(windows, self.modes, free, start, self.waves),
            judged_by_um_s=judged_by_um_s,
            parasitic_modes=self.parasitic_modes,
            are_points=self.are_points,
        )

    def gain(self, held_out: Windows, before: Calibration, after: Calibration) -> HeldOutGain:
        """Return what a calibration gains on windows that did not teach it."""
        at_start = self.fit(held_out, Free(), before)
        return gain_of(held_out, at_start, self.fit(held_out, Free(), after, at_start.noise_um_s))


def calibrate(windows: Windows, modes: ModeShapes, parasitic_modes: ParasiticModes | None = None) -> Judged:
    """Fit and judge, the map last. Processor time for 60 s of touching: 25 s on four modes, minutes on eight."""
    before = Calibration.nominal(modes.M)
    touched_s = len(windows) * WINDOW_S
    if touched_s < LEAST_TOUCHED_S:
        refusal = (
            f"Only {touched_s:.1f} s of touching while the plate followed its references, {LEAST_TOUCHED_S:g} s are "
            "needed: move two fingers for a minute, one of them slippery."
        )
        return Judged(before, before, before, touched_s, 0.0, np.inf, 0.0, 0.0, refusal, refusal)
    few = _evenly(windows, MOST_WINDOWS)
    free = Free(pad=True, sense=True)
    fitter = _Fitter(modes, parasitic_modes, are_points=True)
    near = fitter.fit(_evenly(windows, FEW_WINDOWS), free, before).calibration
    fitter = replace(fitter, are_points=_are_points(_evenly(windows, FEW_WINDOWS), fitter, near))
    free = free._replace(apart=_apart_on(modes))
    first, second = _halves(few)
    one = fitter.fit(first, free, near)
    other = fitter.fit(second, free, one.calibration)
    lessons = ((second, transferable(windows, one.calibration)), (first, transferable(windows, other.calibration)))
    gains = [fitter.gain(part, before, lesson) for part, lesson in lessons]
    found = fitter.fit(few, free, other.calibration)
    latency_s, latency_sigma_s = effective_latency(few, found)
    refusal = (
        _unknown(found.sigma, latency_sigma_s)
        or _implausible(found.calibration)
        or _adrift(found)
        or _differ(one, other, len(windows.sessions))
        or _unconfirmed(gains)
    )
    adopted = before if refusal else _effective(found.calibration, latency_s)
    judged = Judged(
        calibration=adopted,
        fitted=found.calibration,
        sigma=found.sigma,
        touched_s=touched_s,
        latency_s=latency_s,
        latency_sigma_s=latency_sigma_s,
        gain_frac=float(np.mean([gain.frac for gain in gains])),
        refusal=refusal,
        fit=found,
    )
    judged = _with_map(_without_gains(judged, before), _evenly(windows, MOST_FOR_MAP), fitter)
    if not judged.refusal and _is_crossed(judged.fitted):
        return replace(judged, calibration=before, refusal=_FAR, map_refusal=_FAR, waves=None, touched_mm=None)
    if judged.refusal:
        return judged
    return replace(judged, calibration=without_bias(judged.calibration, session_postures_mm(few, found)))


def _apart_on(modes: ModeShapes) -> Apart:
    """On few modes errors of the map pass for centroids of single touches."""
    return Apart.TOUCHES if modes.M >= LEAST_SIZED_MODES else Apart.SESSIONS


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
    s_per_mm = float((drawn * speed).sum() / max(float((speed**2).sum()), 1e-9))
    weights = np.zeros(len(found.calibration.pad))
    weights[LATENCY], weights[CENTROID] = 1.0, s_per_mm
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


def _unknown(sigma: Calibration, latency_sigma_s: float) -> str:
    """Return why the recording does not determine the pad."""
    if (sigma.pad[: len(UNKNOWN)] > UNKNOWN).any():
        return (
            f"The touches do not tell where the pad lies (x, y to within {sigma.pad[0]:.2f}, {sigma.pad[1]:.2f} mm): "
            "the fingers crossed too few node lines. Move them over the whole plate, along x and y."
        )
    if latency_sigma_s > UNKNOWN_LATENCY_S:
        return (
            f"The touches do not tell the pad's latency (to within {1e3 * latency_sigma_s:.1f} ms): "
            "move the fingers faster, in all directions."
        )
    return ""


def _implausible(found: Calibration) -> str:
    return _FAR if (np.abs(found.pad) > MOST_SIGMAS * PAD_PRIOR).any() else ""


def _is_crossed(found: Calibration) -> bool:
    """Whether sensors seem to see too much of other modes; without the map modes that have turned into each other pass
    for that, so it is asked last."""
    sense = np.abs(found.sense - np.eye(len(found.sense)))
    np.fill_diagonal(sense, 0.0)  # without the map its errors pass for gains
    return bool((sense > MOST_CROSSTALK).any())


def _adrift(found: Fit) -> str:
    mode = int(np.argmax(found.drift_hz))
    if found.drift_hz[mode] > MOST_DRIFT_HZ:
        return (
            f"Mode {mode} moved by {found.drift_hz[mode]:.0f} Hz while the plate was touched, more than a fit follows: "
            "let the plate warm up, and record again."
        )
    return ""


def _differ(one: Fit, other: Fit, sessions: int) -> str:
    size = len(UNKNOWN)
    away = np.abs(one.calibration.pad - other.calibration.pad)[:size]
    posture = PASSING if sessions > 1 else np.zeros(size)
    allowed = APART * np.hypot(np.hypot(one.sigma.pad, other.sigma.pad)[:size], posture) + UNKNOWN
    if (away > allowed).any():
        return "The two halves of the touches disagree: something moved meanwhile, or the fit failed. Record again."
    return ""


def _unconfirmed(gains: list[HeldOutGain]) -> str:
    """Both halves have to be sure together, and each for its part."""
    together = sum(gain.standard_errors for gain in gains) / np.sqrt(len(gains))
    return NO_CHANGE if together < SURE or not all(map(_confirms, gains)) else ""


def _confirms(half: HeldOutGain) -> bool:
    return half.frac >= WORTH_FRAC and half.standard_errors >= 1.0


def _with_map(judged: Judged, windows: Windows, fitter: _Fitter) -> Judged:
    """Fit and judge the map from where pad and sensors are."""
    if judged.refusal not in ("", NO_CHANGE):
        return replace(judged, map_refusal=judged.refusal)
    parasitic = None if fitter.parasitic_modes is None else fitter.parasitic_modes.modes
    # On fewer modes, whose fingers are points, finer surfaces take up what contacts do: in one laboratory of four it
    # cost 3 % of the leak.
    box_mm = touched_box(windows, fitter.modes)
    has_fine = fitter.modes.M >= LEAST_SIZED_MODES
    waves = Waves(fitter.modes, wave_number(fitter.modes), parasitic, box_mm if has_fine else None)
    fitter = replace(fitter, waves=waves)
    start = replace(judged.calibration, waves=np.zeros((fitter.modes.M, len(waves))))
    halves = _halves(windows)
    free = Free(pad=True, sense=True, waves=True, apart=_apart_on(fitter.modes))
    fits, gains = [], []
    for taught, held_out in (halves, halves[::-1]):
        fits.append(fitter.fit(taught, free, start))
        lesson = fits[-1].calibration
        if len(windows.sessions) > 1:
            lesson = replace(lesson, pad=start.pad)
        gains.append(fitter.gain(held_out, start, lesson))
        if not _confirms(gains[-1]):
            break  # which the other half cannot mend
    judged = replace(judged, map_gain_frac=float(np.mean([gain.frac for gain in gains])))
    if _unconfirmed(gains):
        place = where_next(windows, fitter.modes)
        sentence = place.sentence(len(windows) * WINDOW_S)
        return replace(judged, map_refusal=f"The map stays as it is. {sentence}", next_place=place)
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
        map_sigma=map_sigma(waves, precision, fitter.modes),
        touched_mm=box_mm,
        touched_sigma=box_sigma(waves, precision, box_mm),
    )


def _with_gains_in_map(found: Calibration, waves: Waves) -> Calibration:
    """Return the same motion of the plate by a map that makes up for the sensors' gains, which stay as calibrated.

    Touches tell the product of both alone, since the amplifiers' gains are free: a mode's limit is better kept by a
    gain that was measured.
    """
    gains = np.abs(np.diag(found.sense))
    return replace(found, sense=found.sense / gains[:, None], waves=waves.scaled(found.waves, gains))


def _without_gains(judged: Judged, before: Calibration) -> Judged:
    """Return pad and sensors alone, these as far as they are above what the map's errors pass for (James and Stein).

    Gains stay as they were: errors of the map pass for them, but not for crosstalk.
    """
    if judged.refusal:
        return judged
    away = judged.calibration.sense - before.sense
    sure = np.maximum(0.0, 1.0 - SENSE_OF_MAP**2 / np.maximum(np.abs(away) ** 2, 1e-12))
    np.fill_diagonal(sure, 0.0)
    sense = np.asarray(before.sense + sure * away, np.complex128)
    return replace(judged, calibration=replace(judged.calibration, sense=sense))


def _mean(one: Fit, other: Fit) -> Fit:
    """The mean of both halves' fits, as good as a fit of all, whose cost it spares."""
    found, twin = one.calibration, other.calibration
    mean = Calibration((found.pad + twin.pad) / 2.0, (found.sense + twin.sense) / 2.0, (found.waves + twin.waves) / 2.0)
    a, b = one.sigma, other.sigma
    sense = np.hypot(a.sense.real, b.sense.real) / 2.0 + 1j * np.hypot(a.sense.imag, b.sense.imag) / 2.0
    sigma = Calibration(np.hypot(a.pad, b.pad) / 2.0, sense, np.hypot(a.waves, b.waves) / 2.0)
    return replace(
        one,
        calibration=mean,
        sigma=sigma,
        covariance=(one.covariance + other.covariance) / 4.0,
        spread_mm2=(one.spread_mm2 + other.spread_mm2) / 2.0,
        spread_sigma_mm2=np.hypot(one.spread_sigma_mm2, other.spread_sigma_mm2) / 2.0,
    )
