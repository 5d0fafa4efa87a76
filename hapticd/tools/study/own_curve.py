"""A participant's own friction curve: what `hapticd calibrate friction --participant` measured, in that session.

The service has one curve for everybody. So a friction of the experiment becomes the amplitude that gives it under this
participant's finger, at rest; maps and textures of frictions stay as the service has them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from hapticd_contract.surfaces import Surface
from hapticd_contract.targets import ClientTargets, FingerTarget

from ...config import loader as config
from ...core.friction import FrictionCurve
from ...errors import ConfigError
from ..calibrate.folder import CONFIG_FILE, PARTICIPANTS
from .experiment import StudyError

KEY = "friction_curve"  # of the session's first line
_Target = TypeVar("_Target", FingerTarget, Surface)


def measured(calibration: Path, participant: str) -> dict[str, Any]:
    """Read a participant's curve from a folder of results, for the session's first line. Raises StudyError."""
    path = calibration / PARTICIPANTS / participant / CONFIG_FILE
    if not path.is_file():
        raise StudyError(
            f"{path}: is missing: measure {participant}'s curve with `hapticd calibrate friction --participant "
            f"{participant} --out {calibration}`, or omit --calibration."
        )
    try:
        plate = config.load(path).plate
    except ConfigError as error:
        raise StudyError(str(error)) from None
    if not plate.friction_curve:
        raise StudyError(f"{path}: holds no friction curve: measure it again.")
    return {"amplitude_um": list(plate.friction_curve), "floor_frac": plate.friction_floor_frac}


def of_session(about: Mapping[str, Any]) -> FrictionCurve | None:
    """Return the curve of a session's first line; None without one. Raises StudyError."""
    if KEY not in about:
        return None
    try:
        return FrictionCurve.from_amplitudes(about[KEY]["amplitude_um"], about[KEY]["floor_frac"])
    except (KeyError, TypeError, ValueError) as error:
        raise StudyError(f"{KEY}: is no friction curve ({error}): the session's file was changed.") from None


def felt_by(curve: FrictionCurve, scene: ClientTargets) -> ClientTargets:
    """Return the scene with the amplitudes that give this participant its frictions."""
    return msgspec.structs.replace(
        scene,
        targets=tuple(_as_amplitude(curve, one) for one in scene.targets),
        surfaces=tuple(_as_amplitude(curve, one) for one in scene.surfaces),
    )


def _as_amplitude(curve: FrictionCurve, one: _Target) -> _Target:
    if one.friction is None or not math.isfinite(one.friction):
        return one
    return msgspec.structs.replace(one, friction=None, amplitude_um=curve.amplitude_um(one.friction))
