"""Core settings from a configuration: plain values, nothing opened."""

from __future__ import annotations

import math
from functools import partial

from ..board_protocol import KNOTS_MAX, REFERENCE
from ..config.sections import LEAST_CONTACT_MODES, Config
from ..core.friction import FrictionCurve
from ..core.pipeline import PipelineSettings
from ..core.prediction.motion import AdaptivePredictor
from ..core.prediction.pad_memory import PadMemory
from ..core.solver.felt_descent import UNCERTAIN_FRAC
from ..core.uncertainty import Uncertainty
from ..values import AffineMap

MOST_KNOTS = 16  # in one reference frame without effects
LATENCY_SIGMA_S = 1.7e-3  # of trackpad.latency_ms
PERSONS_FRAC, MATCHED_FRAC = 0.2, 0.06  # of the amplitude for a friction, by the built-in curve and a measured one
SILENCE_NS = 40_000_000  # fingers count as lifted after it without a report, of a slow pad after 3.5 periods
RIG_SILENCE_NS = 1_000_000_000  # a loaded host that stalls the simulated pad must not lift its fingers
LONGEST_FRAME_S = 0.003
LONGEST_EFFECT_FRAME_S = 0.005  # while an effect plays: 24 knots of two modes at 921600 baud
BITS_PER_BYTE = 10  # 8N1
ENVELOPE_BYTES = 7  # of a frame: type, CRC, COBS and its delimiter


def warm_up(config: Config) -> None:
    """Compute the predictor's gains, which takes some 0.1 s, before a finger needs them."""
    pipeline_settings(config).make_predictor()


def pipeline_settings(config: Config) -> PipelineSettings:
    """Return the pipeline's settings. Their predictors share what they learn of the pad: take new ones for each core.

    Fingers are contacts on plates of LEAST_CONTACT_MODES or more. With fewer a still contact cannot be had, whatever
    is done, and the point's rule gives the slippery finger five times as much. Their frames have as many knots as the
    link carries in LONGEST_FRAME_S.
    """
    prediction, solver, unsure = config.prediction, config.solver, config.uncertainty
    are_contacts = has_contacts(config)
    return PipelineSettings(
        w_limit_um=config.reference_limit_um,
        make_predictor=partial(
            AdaptivePredictor, memory=PadMemory.of(prediction.pad_weights), period_ms=prediction.period_ms
        ),
        contact_radius_mm=solver.contact_radius_mm if are_contacts else 0.0,
        ellipse_scale=config.trackpad.ellipse_scale if solver.contact_radius_mm > 0.0 else 0.0,
        ellipse_offset_mm=config.trackpad.ellipse_offset_mm,
        uncertain_frac=max(math.hypot(unsure.map_frac, unsure.sensors_frac), UNCERTAIN_FRAC),
        max_knots=max_knots(config, config.device.baud),
        effect_knots=effect_knots(config, config.device.baud),
        sensor_latency_ns=round(config.trackpad.latency_ms * 1e6),
        loop_delay_ns=round(config.device.plate_delay_ms * 1e6),
        frame_duration_ns=round(1.5e6 * prediction.period_ms),
        silence_ns=RIG_SILENCE_NS if config.rig_dir else SILENCE_NS,
    )


def max_knots(config: Config, baud: int) -> int:
    """Return the most knots of a frame on a link of this speed."""
    modes = len(config.limits.w_limit_um)
    return min(MOST_KNOTS, knots_in(LONGEST_FRAME_S, baud, modes)) if has_contacts(config) else MOST_KNOTS


def effect_knots(config: Config, baud: int) -> int:
    """Return the most knots of a frame while an effect plays, which may need more than places do."""
    modes = len(config.limits.w_limit_um)
    return max(max_knots(config, baud), min(KNOTS_MAX, knots_in(LONGEST_EFFECT_FRAME_S, baud, modes)))


def has_contacts(config: Config) -> bool:
    """Whether amplitudes count over contacts, not at points."""
    return len(config.limits.w_limit_um) >= LEAST_CONTACT_MODES and config.solver.contact_radius_mm > 0.0


def knots_in(span_s: float, baud: int, modes: int) -> int:
    """Return how many knots a frame may have that the link carries within `span_s`; at least one."""
    knot_bytes = 2 + 8 * modes  # its time, and a phasor of two floats per mode
    return max(1, int((span_s * baud / BITS_PER_BYTE - REFERENCE.size - ENVELOPE_BYTES) / knot_bytes))


def friction_curve(config: Config) -> FrictionCurve:
    """Return amplitude against friction: measured, or the built-in curve."""
    plate = config.plate
    speed_mm_s = plate.friction_speed_mm_s or math.inf
    if plate.friction_curve:
        return FrictionCurve.from_amplitudes(plate.friction_curve, plate.friction_floor_frac, speed_mm_s)
    return FrictionCurve.exponential(speed_mm_s=speed_mm_s)


def uncertainty(config: Config) -> Uncertainty:
    """Return what is not known of plate, sensors, pad and person."""
    of, curve_frac = config.uncertainty, MATCHED_FRAC if config.plate.friction_curve else PERSONS_FRAC
    if of.place_mm == 0.0:
        return Uncertainty(of.map_frac, of.sensors_frac)
    return Uncertainty(of.map_frac, of.sensors_frac, of.place_mm, LATENCY_SIGMA_S, curve_frac)


def plate_from_pad(config: Config) -> AffineMap:
    """Return the pose of the pad under the plate."""
    return AffineMap(*config.trackpad.matrix, *config.trackpad.offset_mm)
