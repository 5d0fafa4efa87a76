"""A participant's own friction curve: what `hapticd calibrate friction --participant` measured, in that session.

A service that was started with it (`hapticd run --friction`) has all of this participant: maps, textures, sliding and
what its states say is felt. For another service a friction of the experiment becomes the amplitude that gives it under
this participant's finger, at rest; all else stays as the service has it.
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
from ...config.sections import Config
from ...core.friction import FrictionCurve
from ...errors import ConfigError
from ..calibrate.folder import CONFIG_FILE, PARTICIPANTS
from .experiment import StudyError

KEY = "friction_curve"  # of the session's first line
ANOTHER = (
    "The service has another friction curve than {participant}: frictions of targets and surfaces become amplitudes; "
    "maps, textures, sliding and felt_friction are by the service's. "
    "For all of it, start `hapticd run --friction {path}`, or copy that file over the one that the service was started "
    "with and reload it (SIGHUP)."
)
_Target = TypeVar("_Target", FingerTarget, Surface)


def path_of(calibration: Path, participant: str) -> Path:
    """Return the file of a participant's curve in a folder of results."""
    return calibration / PARTICIPANTS / participant / CONFIG_FILE


def measured(calibration: Path, participant: str) -> dict[str, Any]:
    """Read a participant's curve from a folder of results, for the session's first line. Raises StudyError."""
    path = path_of(calibration, participant)
    if not path.is_file():
        raise StudyError(
            f"{path}: is missing: measure {participant}'s curve with `hapticd calibrate friction --participant "
            f"{participant} --out {calibration}`, or omit --calibration."
        )
    try:
        plate = config.with_friction(Config(), path).plate
    except ConfigError as error:
        raise StudyError(str(error)) from None
    return {"amplitude_um": list(plate.friction_curve), "floor_frac": plate.friction_floor_frac}


def settings(about: Mapping[str, Any]) -> str:
    """Return the curve of a session's first line as a service's configuration; "" without one."""
    if of_session(about) is None:
        return ""
    curve = about[KEY]
    return f"[plate]\nfriction_curve = {list(curve['amplitude_um'])}\nfriction_floor_frac = {curve['floor_frac']}\n"


def is_served(curve: FrictionCurve, plate: Mapping[str, Any]) -> bool:
    """Return whether a service, by its `plate` reply, has this curve."""
    own = [value for _, um in reversed(curve.knots) for value in (um, curve.friction(um))]
    served = [float(value) for pair in plate.get("friction_curve", ()) for value in pair]
    return len(own) == len(served) and all(math.isclose(a, b, rel_tol=1e-9) for a, b in zip(own, served, strict=True))


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
