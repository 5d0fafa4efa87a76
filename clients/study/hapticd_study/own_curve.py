"""A participant's own friction curve: what `hapticd calibrate friction --participant` measured, in that session.

A service that was started with it (`hapticd run --friction`) has all of this participant: maps, textures, sliding and
what its states say is felt. For another service a friction of the experiment becomes the amplitude that gives it under
this participant's finger, at rest; all else stays as the service has it.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np

from hapticd_contract.surfaces import Surface
from hapticd_contract.targets import ClientTargets, FingerTarget

from .experiment import StudyError, read_file

KEY = "friction_curve"  # of the session's first line
MAX_BYTES = 1 << 18
ANOTHER = (
    "The service has another friction curve than {participant}: frictions of targets and surfaces become amplitudes; "
    "maps, textures, sliding and felt_friction are by the service's. "
    "For all of it, start `hapticd run --friction {path}`, or copy that file over the one that the service was started "
    "with and reload it (SIGHUP)."
)
_Target = TypeVar("_Target", FingerTarget, Surface)


class OwnCurve(msgspec.Struct, frozen=True):
    """Amplitudes at equally spaced frictions, from 1 (bare glass) to 0, whose friction relative to bare glass is
    `floor_frac`. In between the logarithm of friction is straight, as the daemon has it. Raises ValueError."""

    amplitude_um: Annotated[tuple[float, ...], msgspec.Meta(min_length=2, max_length=1000)]
    floor_frac: Annotated[float, msgspec.Meta(gt=0.0, lt=1.0)]

    def __post_init__(self) -> None:
        um = np.array(self.amplitude_um)
        if um[0] != 0.0 or not np.isfinite(um).all() or not (np.diff(um) > 0.0).all():
            raise ValueError("amplitudes must rise from 0")

    def friction_to_um(self, friction: float) -> float:
        """Return the amplitude for a friction of 0 .. 1."""
        levels = np.log(self._relative(np.linspace(0.0, 1.0, len(self.amplitude_um))))
        return float(np.interp(np.log(self._relative(friction)), levels, self.amplitude_um[::-1]))

    def is_served(self, plate: Mapping[str, Any]) -> bool:
        """Return whether a service, by its `plate` reply, has this curve."""
        relative = self._relative(np.linspace(1.0, 0.0, len(self.amplitude_um)))
        own, served = np.column_stack([self.amplitude_um, relative]), np.array(plate.get("friction_curve", ()))
        return served.shape == own.shape and np.allclose(served, own, rtol=1e-9)

    def felt_by(self, scene: ClientTargets) -> ClientTargets:
        """Return the scene with the amplitudes that give this participant its frictions."""
        targets, surfaces = (tuple(map(self._as_amplitude, part)) for part in (scene.targets, scene.surfaces))
        return msgspec.structs.replace(scene, targets=targets, surfaces=surfaces)

    def _as_amplitude(self, one: _Target) -> _Target:
        if one.friction is None:
            return one
        return msgspec.structs.replace(one, friction=None, amplitude_um=self.friction_to_um(one.friction))

    def _relative(self, friction: Any) -> Any:
        return self.floor_frac + (1.0 - self.floor_frac) * friction


def path_of(calibration: Path, participant: str) -> Path:
    """Return the file of a participant's curve in a folder of results."""
    return calibration / "participants" / participant / "hapticd.toml"


def measured(calibration: Path, participant: str) -> dict[str, Any]:
    """Read a participant's curve from a folder of results, for the session's first line. Raises StudyError."""
    path = path_of(calibration, participant)
    try:
        plate = tomllib.loads(read_file(path, MAX_BYTES).decode())["plate"]
        found = {"amplitude_um": plate["friction_curve"], "floor_frac": plate["friction_floor_frac"]}
        return dict(msgspec.to_builtins(msgspec.convert(found, OwnCurve)))
    except FileNotFoundError:
        raise StudyError(
            f"{path}: is missing: measure {participant}'s curve with `hapticd calibrate friction --participant "
            f"{participant} --out {calibration}`, or omit --calibration."
        ) from None
    except (OSError, LookupError, TypeError, ValueError, RecursionError) as error:
        raise StudyError(f"{path}: has no friction curve ({str(error)[:100]}): measure it once more.") from None


def settings(about: Mapping[str, Any]) -> str:
    """Return the curve of a session's first line as a service's configuration; "" without one."""
    curve = of_session(about)
    if curve is None:
        return ""
    return f"[plate]\nfriction_curve = {list(curve.amplitude_um)}\nfriction_floor_frac = {curve.floor_frac}\n"


def of_session(about: Mapping[str, Any]) -> OwnCurve | None:
    """Return the curve of a session's first line; None without one. Raises StudyError."""
    if KEY not in about:
        return None
    try:
        return msgspec.convert(about[KEY], OwnCurve)
    except msgspec.ValidationError as error:
        raise StudyError(f"{KEY}: is no friction curve ({error}): the session's file was changed.") from None
