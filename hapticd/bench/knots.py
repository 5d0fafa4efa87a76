"""How many knots a reference needs: what the board interpolates against what was wanted at every control tick.

Two virtual fingers walk known ways, so nothing is predicted and all that errs is the polyline: one sticks, the other
wears each kind of target. Wanted is what the same pipeline solves at each half millisecond.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt

from ..core.pipeline import Pipeline, PipelineSettings
from ..core.plate.mode_shapes import ModeShapes
from ..core.prediction.predictor import make_predictor
from ..core.targets.scene import Scene
from ..sim.plate.ground_truth import GroundTruth
from ..values import AmplitudeTarget, ClientTargets, GratingTarget, MapTarget, SafeDrive, Target, VirtualPath
from ..wire import device
from .tables import Table, finite_rows
from .timing import REPEATS, compare

FRAME_NS, TICK_NS = 11_250_000, 500_000
SPEED_MM_S = 100.0
DEFAULT = "adaptive knots"
_LIMITS_UM = (4.0, 4.0)
_START_NS = 5_000_000_000
_WAYS = {
    "slips": VirtualPath(((-50.0, -20.0), (30.0, 24.0)), SPEED_MM_S, loop=True),
    "sticks": VirtualPath(((45.0, -41.0), (-12.0, 38.0)), SPEED_MM_S, loop=True),
}
_BASE = PipelineSettings(w_limit_um=_LIMITS_UM, make_predictor=make_predictor, fade=5.0)
SCHEMES: Mapping[str, PipelineSettings] = {
    DEFAULT: _BASE,
    "adaptive, 5 nm": replace(_BASE, tolerance_um=0.005),
    "two knots a report": replace(_BASE, max_knots=2),
    "a step a report": replace(_BASE, max_knots=1),
    "dense, 0.7 ms": replace(_BASE, tolerance_um=1e-9, max_knots=24, cover_ns=11_500_000),
}
TARGETS: Mapping[str, Target] = {
    "constant": AmplitudeTarget(1.0),
    "sine grating": GratingTarget(period_mm=4.0, angle_rad=0.4, low_um=0.2, high_um=1.0, duty_frac=0.0),
    "square grating": GratingTarget(period_mm=6.0, angle_rad=0.4, low_um=0.2, high_um=1.0, duty_frac=0.5),
    "map": MapTarget(
        width=32, height=32, levels=bytes((7 * i * i) % 256 for i in range(1024)), low_um=0.2, high_um=1.0
    ),
}


def run(*, seconds: float = 1.5, repeats: int = REPEATS) -> tuple[Table, ...]:
    """For each kind of target: error, bytes and time of each way to send a reference."""
    return tuple(_table(name, target, seconds, repeats) for name, target in TARGETS.items())


def _table(name: str, target: Target, seconds: float, repeats: int) -> Table:
    frames = round(seconds * 1e9 / FRAME_NS)
    wanted_um = _wanted_um(target, frames)
    runs = {scheme: (_driving(_pipeline(target, settings), frames), frames) for scheme, settings in SCHEMES.items()}
    times = compare(runs, repeats)
    rows = []
    for scheme, settings in SCHEMES.items():
        drives = _drives(_pipeline(target, settings), frames)
        error_um = np.abs(_played_um(drives, frames) - wanted_um).max(axis=1)
        sent = [drive for drive in drives if drive is not None]
        frame_bytes = [len(device.encode_reference(seq, drive, 0)) for seq, drive in enumerate(sent)]
        figures = {
            **times[scheme].figures(),
            "error_um": math.sqrt(float(np.mean(error_um**2))),
            "error_p99_um": float(np.quantile(error_um, 0.99)),
            "knots_count": round(sum(len(drive.knots) for drive in sent) / len(sent)),
            "frame_bytes_count": round(sum(frame_bytes) / len(sent)),
        }
        rows.append((scheme, figures))
    return Table(
        name=f"knots_{name.replace(' ', '_')}",
        title=f"knots: a {name} under a finger at {SPEED_MM_S:g} mm/s beside one that sticks and moves",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("time_us", "error_um"),
        time="time_us",
        error="error_um",
        notes=("error: modal amplitudes at every 0.5 ms, as the board interpolates them, against those wanted then",),
    )


@cache
def _modes() -> ModeShapes:
    return GroundTruth().measured_mode_map(1)


def _pipeline(target: Target, settings: PipelineSettings) -> Pipeline:
    scene = Scene(w_limit_um=max(_LIMITS_UM))
    wishes: dict[int | str, Target] = {"slips": target, "sticks": AmplitudeTarget(0.0)}
    assert scene.apply(ClientTargets("bench", 10**15, wishes, dict(_WAYS)), _START_NS) == ()
    return Pipeline(_modes(), scene, settings)


def _drives(pipeline: Pipeline, frames: int) -> list[SafeDrive | None]:
    return [pipeline.drive(_START_NS + frame * FRAME_NS, 0).drive for frame in range(frames)]


def _driving(pipeline: Pipeline, frames: int) -> Callable[[], object]:
    def drive() -> None:
        pipeline.forget_standing()
        _drives(pipeline, frames)

    return drive


def _wanted_um(target: Target, frames: int) -> npt.NDArray[np.float64]:
    """(ticks, M): what is solved when every control tick is asked for on its own."""
    pipeline = _pipeline(target, replace(_BASE, max_knots=1, tolerance_um=1e-12))
    rows = []
    for tick in range(frames * FRAME_NS // TICK_NS):
        pipeline.drive(_START_NS + tick * TICK_NS, 0)
        rows.append(pipeline.modal_um)
    return np.array(rows)


def _played_um(drives: list[SafeDrive | None], frames: int) -> npt.NDArray[np.float64]:
    """(ticks, M): what the board makes of the frames, each until the next one begins."""
    rows = []
    standing = next(drive for drive in drives if drive is not None)
    for tick in range(frames * FRAME_NS // TICK_NS):
        t_ns = tick * TICK_NS
        standing = drives[t_ns // FRAME_NS] or standing
        dt_ns = t_ns - (standing.t_apply_ns - _START_NS)
        at_ns = [knot.dt_ns for knot in standing.knots]
        amplitudes_um = np.array([knot.modal_um for knot in standing.knots]).real
        rows.append([np.interp(dt_ns, at_ns, amplitudes_um[:, mode]) for mode in range(len(_LIMITS_UM))])
    return np.array(rows)
