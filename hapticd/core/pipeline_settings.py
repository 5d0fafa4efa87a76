"""What the touch path is set to, and what it counts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .solver.instant import PointSolver
from .solver.points.general import solve_fast
from .touch.fingers import FingerPredictor


@dataclass(frozen=True, slots=True)
class PipelineSettings:
    """Pipeline settings.

    `derating_mm2_um2` is how far amplitude is derated where a limit keeps a slippery finger from its target anyway (see
    `core.solver.derating`; 0 also removes the bound on the reference's slope). `phase_rotation`: two slipping fingers
    change their signs by turning their phase (see `core.solver.instant`). `contact_radius_mm` above 0 makes
    fingers discs, and where `ellipse_scale` is not 0 what the pad reports of them (see `core.touch.contact_form`).
    `cover_ns` is how long one frame must last: one and a half report periods, to
    bridge a lost report; a slower pad gets frames of one and a half of its own periods. While an effect plays, a frame
    may have `effect_knots`, and be shorter: 1.1 report periods. `loop_delay_ns` is by how much the plate follows its
    reference late.
    """

    w_limit_um: tuple[float, ...]
    make_predictor: Callable[[], FingerPredictor]
    derating_mm2_um2: float = 0.0
    phase_rotation: bool = True
    contact_radius_mm: float = 0.0
    ellipse_scale: float = 0.0
    ellipse_offset_mm: float = 0.0
    tolerance_um: float = 0.02
    max_knots: int = 16
    effect_knots: int = 24
    sensor_latency_ns: int = 10_000_000
    loop_delay_ns: int = 0
    cover_ns: int = 17_000_000
    silence_ns: int = 40_000_000
    solve: PointSolver = solve_fast


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
