"""Fingers of a recording as a scenario: what its pad reported, with pressure and contact, for the simulated pad.

A position is where the pad reported it, on the plate of that time; the simulated pad adds its own errors.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np

from ...core.plate.contact import ContactEllipse
from ...daemon.settings import plate_from_pad
from ...errors import UsageError
from ...files.recording.mcap_reader import open_recording, touch_frames
from ...values import Contact, TouchFrame
from . import pad_ellipse
from .pressing import LEAST_RADIUS_MM, MOST_RADIUS_MM, SampledFinger, ellipse
from .scenarios import LAND_S, Actor, Scenario

MOST_SAMPLES: Final = 250_000  # of all fingers: 20 minutes of two at 100 Hz
_APART_S: Final = 0.05  # from one touch to the next on one path, so that the pad sees the lift
_LIFT_S: Final = 1e-3

_Row = tuple[float, ...]  # t_s, x_mm, y_mm, pressure_frac, and the form
_LIFTED: Final = (math.nan, math.nan)


class _Touches:
    """Rows of each path, which has one touch at a time; a touch ends with a row without a position."""

    def __init__(self) -> None:
        self.paths: list[list[_Row]] = []
        self.samples = 0
        self._down: dict[int, list[_Row]] = {}  # by the device's id

    def take(self, frame: TouchFrame) -> None:
        """Add the contacts of one frame."""
        t_s = frame.t_ns * 1e-9
        touching = {contact.contact_id: contact for contact in frame.contacts if contact.touching}
        for contact_id in [contact_id for contact_id in self._down if contact_id not in touching]:
            self._lift(contact_id)
        for contact_id, contact in touching.items():
            rows = self._down.get(contact_id) or self._land(contact_id, t_s)
            if not rows or t_s > rows[-1][0]:
                rows.append((t_s, contact.x_mm, contact.y_mm, contact.pressure_frac, *_form(contact)))
                self.samples += 1

    def lift_all(self) -> None:
        """Lift every finger: the pad was disconnected."""
        for contact_id in tuple(self._down):
            self._lift(contact_id)

    def _land(self, contact_id: int, t_s: float) -> list[_Row]:
        """Return the first path that is free."""
        for rows in self.paths:
            if not any(rows is held for held in self._down.values()) and t_s - rows[-1][0] >= _APART_S:
                break
        else:
            rows = []
            self.paths.append(rows)
        self._down[contact_id] = rows
        return rows

    def _lift(self, contact_id: int) -> None:
        rows = self._down.pop(contact_id)
        t_s, _, _, *pressed = rows[-1]
        rows.append((t_s + _LIFT_S, *_LIFTED, *pressed))


def read(path: Path) -> Scenario:
    """Read the fingers of a recording; the first lands LAND_S after the start. Raises HapticdError."""
    recording = open_recording(path)
    touches = _Touches()
    for frame in touch_frames(recording, plate_from_pad(recording.header.config)):
        if frame is None:
            touches.lift_all()
        else:
            touches.take(frame)
        if touches.samples > MOST_SAMPLES:
            raise UsageError(f"{path}: has more than {MOST_SAMPLES} positions: record some minutes of touching.")
    touches.lift_all()
    if not touches.paths:
        raise UsageError(f"{path}: no finger touched the pad: record some strokes.")
    start_s = min(rows[0][0] for rows in touches.paths) - LAND_S
    actors = tuple(_actor(rows, start_s) for rows in touches.paths)
    seconds = max(rows[-1][0] for rows in touches.paths) - start_s
    return Scenario(path.name, "fingers of a recording", seconds, lambda _seed, _speed_mm_s: actors)


def _form(contact: Contact) -> ContactEllipse:
    """Return the true contact that the simulated pad reports as this one."""
    law = pad_ellipse.USUAL
    major_mm, minor_mm = (
        min(max(law.scale * axis_mm + law.offset_mm, 2.0 * LEAST_RADIUS_MM), 2.0 * MOST_RADIUS_MM)
        for axis_mm in (contact.major_mm, contact.minor_mm)
    )
    return ellipse(major_mm, minor_mm, contact.angle_rad)


def _actor(rows: list[_Row], start_s: float) -> Actor:
    samples = np.array(rows)
    finger = SampledFinger(samples[:, 0] - start_s, samples[:, 1:])
    return Actor(((0.0, 0.0),), finger, fingertip=finger)
