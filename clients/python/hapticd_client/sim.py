"""Fingers to rehearse with, on the simulated plate of `hapticd run --sim` or `hapticd view --sim`.

    with Client() as plate, Finger(plate) as finger:
        finger.land(-30, 0)
        finger.move((30, 0), (30, 20), speed_mm_s=80)
        finger.press(0.6)
        finger.lift()

Each method returns when the finger has done it. The simulated pad reports it as a real one does, some 20 ms later.
"""

from __future__ import annotations

import math
import secrets
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, get_type_hints

import msgpack
import zmq

from hapticd_contract.simulated import MAX_TOUCHES, USUAL_PRESSURE_FRAC, SimulatedTouch

from .checks import plain
from .client import Client
from .endpoint import Endpoint
from .errors import HapticdError, RefusedError
from .refresher import Refresher

__all__ = ["MAX_TOUCHES", "USUAL_PRESSURE_FRAC", "Finger"]

STEP_S: Final = 0.01  # between two places on a way
REPEAT_S: Final = 0.4  # less than the rig waits for a message of a finger that stays
_NAME: Final = "finger"
_SOCKET: Final = "fingers"
_BOUNDS: Final = get_type_hints(SimulatedTouch, include_extras=True)


class Finger:
    """One finger on a simulated plate, five at most at once, over all programs and pages.

    `plate` is a client of the simulated plate's service on this machine. The finger lifts when it is closed, and half a
    second after its program ends. The scenario's own fingers lift meanwhile, and land again 3 s later. Raises
    HapticdError for a plate that is not simulated here.
    """

    def __init__(self, plate: Client) -> None:
        described = plate.plate()
        rig = described.get("simulated")
        if not rig or not (Path(rig) / _SOCKET).is_socket():
            raise HapticdError("Only a simulated plate can be touched: start `hapticd run --sim` on this machine.")
        self._half_mm = tuple(0.5 * float(edge_mm) for edge_mm in described["size_mm"])
        self._sender = f"{plate.name[:23]}-{secrets.token_hex(4)}"
        self._touch: SimulatedTouch | None = None
        self._context = zmq.Context[zmq.Socket[bytes]]()
        self._refresher = Refresher(self._context, Endpoint(Path(rig)), _SOCKET)
        self._is_open = True

    def __enter__(self) -> Finger:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Lift the finger and disconnect."""
        if self._is_open:
            self._is_open = False
            self._send(None)
            self._refresher.stop()
            self._context.destroy()

    def land(self, x_mm: float, y_mm: float, *, pressure_frac: float = USUAL_PRESSURE_FRAC) -> None:
        """Land at a place on the plate. Raises RefusedError for one outside it, or for a finger that is down."""
        if self._touch is not None:
            raise RefusedError("land: this finger is down: move it, or lift it first.")
        self._go(self._checked("land", x_mm, y_mm, pressure_frac))

    def move(self, *points_mm: Sequence[float], speed_mm_s: float = 100.0) -> None:
        """Move along points (x_mm, y_mm), straight from one to the next, at a constant speed."""
        if not 0.0 < speed_mm_s < math.inf:
            raise RefusedError("move: speed_mm_s must be greater than 0.")
        start = self._down("move")
        if not all(len(point_mm) == 2 for point_mm in points_mm):
            raise RefusedError("move: each point has two numbers, x_mm and y_mm.")
        for x_mm, y_mm in points_mm:
            end = self._checked("move", x_mm, y_mm, start.pressure_frac, *_contact(start))
            for touch in ways(start, end, math.dist((start.x_mm, start.y_mm), (end.x_mm, end.y_mm)) / speed_mm_s):
                self._go(touch)
            start = end

    def press(
        self,
        pressure_frac: float,
        seconds: float = 0.1,
        *,
        major_mm: float = 0.0,
        minor_mm: float = 0.0,
        angle_rad: float = 0.0,
    ) -> None:
        """Press harder or less within `seconds`: 0 .. 1 of the pad's highest; a resting finger is at 0.11.

        `major_mm` and `minor_mm` are the whole axes of its contact from then on, the major one at `angle_rad` to x;
        without them it is a disc that grows with the third root of the pressure.
        """
        start = self._down("press")
        end = self._checked("press", start.x_mm, start.y_mm, pressure_frac, major_mm, minor_mm, angle_rad)
        for touch in ways(start, end, seconds):
            self._go(touch)

    def hold(self, seconds: float) -> None:
        """Stay as it is for so long."""
        self._down("hold")
        time.sleep(seconds)

    def lift(self) -> None:
        """Lift the finger; one that is lifted stays so."""
        self._go(None)

    def _down(self, what: str) -> SimulatedTouch:
        if self._touch is None:
            raise RefusedError(f"{what}: this finger is lifted: land it first.")
        return self._touch

    def _checked(self, what: str, x_mm: float, y_mm: float, *pressed: float) -> SimulatedTouch:
        """Return a touch of the plate. Raises RefusedError."""
        given = zip(SimulatedTouch.__struct_fields__, (x_mm, y_mm, *pressed), strict=False)
        touch = SimulatedTouch(*(plain(f"{what}: {name}", value, _BOUNDS[name]) for name, value in given))
        if problem := touch.problem():
            raise RefusedError(f"{what}{problem}")
        for name, place_mm, most_mm in zip(("x_mm", "y_mm"), (touch.x_mm, touch.y_mm), self._half_mm, strict=True):
            if abs(place_mm) > most_mm:
                raise RefusedError(
                    f"{what}: {name} is {place_mm:g}: the plate reaches from {-most_mm:g} to {most_mm:g} mm."
                )
        return touch

    def _go(self, touch: SimulatedTouch | None) -> None:
        """Be there for a step."""
        if not self._is_open:
            raise HapticdError("This finger is closed: create a new one.")
        self._send(touch)
        time.sleep(STEP_S)

    def _send(self, touch: SimulatedTouch | None) -> None:
        self._touch = touch
        self._refresher.send(message(self._sender, touch), REPEAT_S if touch is not None else math.inf)


def message(sender: str, touch: SimulatedTouch | None) -> bytes:
    """Return the message that all fingers of a sender are this one, or none."""
    fingers = {} if touch is None else {_NAME: [touch.x_mm, touch.y_mm, touch.pressure_frac, *_contact(touch)]}
    return bytes(msgpack.packb({"fingers": fingers, "sender": sender}))


def ways(start: SimulatedTouch, end: SimulatedTouch, seconds: float) -> Iterator[SimulatedTouch]:
    """Yield a touch for each step of STEP_S from the one to the other, which is the last."""
    steps = max(round(seconds / STEP_S), 1)
    for step in range(1, steps):
        share = step / steps
        x_mm, y_mm, pressure_frac = (
            getattr(start, name) + share * (getattr(end, name) - getattr(start, name))
            for name in ("x_mm", "y_mm", "pressure_frac")
        )
        yield SimulatedTouch(x_mm, y_mm, pressure_frac, *_contact(end))
    yield end


def _contact(touch: SimulatedTouch) -> tuple[float, float, float]:
    return touch.major_mm, touch.minor_mm, touch.angle_rad
