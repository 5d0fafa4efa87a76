"""Core settings from a configuration: plain values, nothing opened."""

from __future__ import annotations

from functools import partial

from ..config.sections import Config
from ..core.pipeline import PipelineSettings
from ..core.prediction.predictor import DEFAULT
from ..core.targets.scene import DEFAULT_FRICTION_CURVE, FrictionCurve
from ..values import AffineMap


def warm_up(config: Config) -> None:
    """Compute the predictor's gains, which takes some 0.2 s, before a finger needs them."""
    pipeline_settings(config).make_predictor()


def pipeline_settings(config: Config) -> PipelineSettings:
    """Return the pipeline's settings."""
    prediction = config.prediction
    return PipelineSettings(
        w_limit_um=config.limits.reference_limit_um,
        make_predictor=partial(DEFAULT.for_touch, period_ms=prediction.period_ms, noise_mm=prediction.noise_mm),
        derating_mm2_um2=config.solver.derating_mm2_um2,
        phase_rotation=config.solver.phase_rotation,
        contact_radius_mm=config.solver.contact_radius_mm,
        tolerance_um=config.solver.tolerance_um,
        max_knots=config.solver.max_knots,
        sensor_latency_ns=round(config.trackpad.latency_ms * 1e6),
        loop_delay_ns=round(config.device.plate_delay_ms * 1e6),
        cover_ns=round(1.5e6 * prediction.period_ms),
        silence_ns=round(config.trackpad.silence_ms * 1e6),
    )


def friction_curve(config: Config) -> FrictionCurve:
    """Return amplitude against friction: measured, or the built-in curve."""
    if not config.plate.friction_curve:
        return DEFAULT_FRICTION_CURVE
    return FrictionCurve.from_amplitudes(config.plate.friction_curve)


def plate_from_pad(config: Config) -> AffineMap:
    """Return the pose of the pad under the plate."""
    pad = config.trackpad
    if pad.matrix:
        return AffineMap(*pad.matrix, *pad.offset_mm)
    return AffineMap.from_placement(
        (pad.offset_mm[0], pad.offset_mm[1]), pad.rotation_deg, (pad.scale[0], pad.scale[1])
    )
