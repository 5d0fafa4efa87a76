"""What the touch path is set to, and what it counts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .solver.instant import PointSolver
from .touch.fingers import FingerPredictor


@dataclass(frozen=True, slots=True)
class PipelineSettings:
    """Pipeline settings.

    `contact_radius_mm` above 0 makes
    fingers discs, and where `ellipse_scale` is not 0 what the pad reports of them (see `core.touch.contact_form`).
    `frame_duration_ns` is how long one frame must last: one and a half report periods, to
    bridge a lost report; a slower pad gets frames of one and a half of its own periods. While an effect plays, a frame
    may have `effect_knots`, and be shorter: 1.1 report periods. `loop_delay_ns` is by how much the plate follows its
    reference late. `solve` takes the place of all rules for points.
    """

    w_limit_um: tuple[float, ...]
    make_predictor: Callable[[], FingerPredictor]
    contact_radius_mm: float = 0.0
    ellipse_scale: float = 0.0
    ellipse_offset_mm: float = 0.0
    tolerance_um: float = 0.02
    max_knots: int = 16
    effect_knots: int = 24
    sensor_latency_ns: int = 10_000_000
    loop_delay_ns: int = 0
    frame_duration_ns: int = 17_000_000
    silence_ns: int = 40_000_000
    solve: PointSolver | None = None


@dataclass(slots=True)
class PipelineCounters:
    """How often each thing was done or spared; shown in `status`."""

    frames: int = 0
    passes: int = 0
    solves: int = 0
    limited: int = 0
    gated: int = 0
    knots: int = 0
    skipped_knots: int = 0
    left_out_knots: int = 0
    left_out_fingers: int = 0
    skipped_no_finger: int = 0
    skipped_no_target: int = 0
    skipped_standing: int = 0
