"""Encodes a simulated client's targets as the message that a real client would have sent."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import msgpack

from ...content_values import (
    AmplitudeTarget,
    Cause,
    Circle,
    ClientTargets,
    Effect,
    Envelope,
    FrictionTarget,
    GradientTarget,
    GratingTarget,
    MapTarget,
    Modulation,
    NoiseTarget,
    Pulse,
    Start,
    Surface,
    Target,
    VirtualPath,
)
from ...wire.client import PROTOCOL_VERSION


def payload_of(message: ClientTargets) -> bytes:
    """A message of the `targets` socket with the same meaning."""
    stamp = {} if message.stamp is None else {"stamp": message.stamp}
    return bytes(
        msgpack.packb(
            {
                "v": PROTOCOL_VERSION,
                "client": message.client,
                "ttl_s": message.ttl_ns * 1e-9,
                **stamp,
                "targets": [_finger_target(message, key) for key in message.targets],
                "virtuals": [{"name": name, **_path(path)} for name, path in message.virtuals.items()],
                "surfaces": [surface_fields(name, surface) for name, surface in message.surfaces.items()],
                "effects": [_effect(name, effect) for name, effect in message.effects.items()],
            }
        )
    )


def _finger_target(message: ClientTargets, key: int | str) -> dict[str, Any]:
    priority = {"priority": message.priorities[key]} if key in message.priorities else {}
    return {"finger": key, **_target(message.targets[key]), **priority}


def _target(target: Target) -> dict[str, Any]:
    match target:
        case AmplitudeTarget(amplitude_um):
            return {"amplitude_um": amplitude_um}
        case FrictionTarget(friction_frac):
            return {"friction": friction_frac}
        case GratingTarget():
            return {"grating": asdict(target)}
        case MapTarget():
            return {"map": _map(target)}
        case GradientTarget():
            return {"gradient": asdict(target)}
        case NoiseTarget():
            return {"noise": asdict(target)}


def _map(image: MapTarget) -> dict[str, Any]:
    levels = {"asset": image.asset} if image.asset else {"levels": image.levels}
    scale: dict[str, Any] = {"low_um": image.low_um, "high_um": image.high_um}
    if image.frictions is not None:
        scale = {"friction": image.frictions}
    return {"width": image.width, "height": image.height, **levels, **scale}


def surface_fields(name: str, surface: Surface) -> dict[str, Any]:
    """Return the fields of a surface in a message."""
    fields = {"name": name, **_target(surface.content), "blend": surface.blend.value}
    if isinstance(surface.shape, Circle):
        fields["circle_mm"] = surface.shape.radius_mm
    elif surface.shape is not None:
        fields["polygon_mm"] = surface.shape.points_mm
    if surface.t_pose_ns is not None:
        fields["t_pose_ns"] = surface.t_pose_ns
    if surface.path is not None:
        fields |= _path(surface.path)
    else:
        fields |= {name: getattr(surface, name) for name in ("position_mm", "velocity_mm_s")}
    return fields | {name: getattr(surface, name) for name in ("angle_rad", "scale", "turning_rad_s", "z")}


def _path(path: VirtualPath) -> dict[str, Any]:
    points = [list(point) for point in path.points_mm]
    return {"path_mm": points, "speed_mm_s": path.speed_mm_s, "loop": path.loop}


def _effect(name: str, effect: Effect) -> dict[str, Any]:
    scope = {} if effect.on is None else {"surface" if isinstance(effect.on, str) else "finger": effect.on}
    return {"name": name, **_form(effect), **scope, "start": _start(effect.start), "loops": effect.loops}


def _form(effect: Effect) -> dict[str, Any]:
    match effect.form:
        case Pulse():
            return {"pulse": asdict(effect.form)}
        case Envelope(points, is_factor):
            return {"envelope": {"points": points, "is_factor": is_factor}}
        case Modulation(frequency_hz, depth_frac, wave, length_s):
            length = {} if length_s is None else {"length_s": length_s}
            fields = {"frequency_hz": frequency_hz, "depth": depth_frac, "shape": wave.value, **length}
            return {"modulation": fields}


def _start(start: Start) -> dict[str, Any]:
    match start.cause:
        case Cause.NOW:
            fields: dict[str, Any] = {"id": start.start_id}
        case Cause.AT:
            fields = {"t_ns": start.t_ns}
        case Cause.ENTERING | Cause.LEAVING | Cause.CROSSING:
            fields = {"surface": start.surface}
        case Cause.PRESSURE:
            fields = {"threshold": start.threshold_frac, "release": start.release_frac}
        case _:
            fields = {}
    return {"cause": start.cause.value, **fields}
