"""The viewer's client of the daemon, on a thread of its own: it receives states and passes them on to the pages.

It is connected only while a page is open, so that the daemon builds no unused telemetry. It reports a lost daemon and
reconnects. What pages request of the daemon they send as clients of their own (`../gateway`).
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zmq

import hapticd_client

from ...config import loader as config
from ...core.plate.mode_shapes import ModeShapes
from ...errors import HapticdError, ModesError
from ...sim.rig.process import PLATE_FILE
from ..served_friction import served_curve
from . import messages
from .rig import TruthSubscriber
from .surfaces import SurfacePainter

ANSWER_S = 2.0
STATE_S = 2.0  # timeout of a silent daemon, which a busy computer delays
RETRY_S = 0.5
STATUS_EVERY_S = 1.0
MAX_EVENTS = 64  # between two frames
SURFACES_EVERY_S = 0.1  # while they change
FRAME_EVERY_S = 1 / 62  # slightly above the refresh rate of a screen
GRID = 101  # points of the page's shapes per side; the browser interpolates between them

_Publish = Callable[[str, str, "PagePlate | None"], None]


class PagePlate:
    """The daemon's plate: its description for the page, the grid of its shapes, the folder of its rig."""

    def __init__(self, body: Mapping[str, Any], person: str = "") -> None:
        simulated = body.get("simulated")
        self.rig_dir = Path(simulated) if simulated and Path(simulated, "fingers").is_socket() else None
        size_mm = (float(body["size_mm"][0]), float(body["size_mm"][1]))
        self.grid = picture_grid(modes_of(body), size_mm)
        self.painter = SurfacePainter(served_curve(body), size_mm, max(map(float, body["w_limit_um"])))
        self.text = messages.plate(body, _name(self.rig_dir), person)


class PlateClient:
    """Runs from `start` to `close`. `publish` is called on its thread with a kind, a message for all pages, and the
    plate if it changed."""

    def __init__(self, endpoint: str | None, publish: _Publish) -> None:
        self._endpoint = endpoint
        self._publish = publish
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="hapticd-view", daemon=True)

    def start(self) -> None:
        """Connect, and run until closed."""
        self._thread.start()

    def close(self) -> None:
        """Disconnect; return when that is done."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ending.is_set():
            try:
                with (
                    hapticd_client.Client(self._endpoint, name=f"view-{os.getpid()}", timeout_s=ANSWER_S) as client,
                    contextlib.ExitStack() as stack,
                ):
                    plate, subscriber = PagePlate(client.plate()), None
                    self._publish("plate", plate.text, plate)
                    if plate.rig_dir is not None:
                        subscriber = TruthSubscriber(stack.enter_context(zmq.Context()), plate.rig_dir)
                        stack.callback(subscriber.close)
                    self._follow(client, plate, subscriber)
            except (hapticd_client.HapticdError, HapticdError) as error:
                self._publish("gone", messages.sentence("gone", str(error)), None)
                self._ending.wait(RETRY_S)

    def _follow(self, client: hapticd_client.Client, plate: PagePlate, subscriber: TruthSubscriber | None) -> None:
        t_frame_s = t_status_s = t_surfaces_s = -1.0
        instance: int | None = None
        surfaces, person = None, ""
        events: deque[hapticd_client.PlateEvent] = deque(maxlen=MAX_EVENTS)  # since the last frame
        for state in client.states(timeout_s=STATE_S):
            if self._ending.is_set() or (instance is not None and state.instance != instance):
                return  # another daemon, perhaps with another plate
            instance = state.instance
            events.extend(state.events)
            t_now_s = time.monotonic()
            if t_now_s - t_frame_s >= FRAME_EVERY_S:
                t_frame_s = t_now_s
                truth = None if subscriber is None else subscriber.newest(state.t_ns)
                self._publish("frame", messages.frame(state, truth, events), None)
                events.clear()
            if state.surfaces_version != surfaces and t_now_s - t_surfaces_s >= SURFACES_EVERY_S:
                t_surfaces_s, surfaces = t_now_s, state.surfaces_version
                self._publish("surfaces", messages.surfaces(plate.painter.painted(client.surfaces())), None)
            if t_now_s - t_status_s >= STATUS_EVERY_S:
                t_status_s, status = t_now_s, client.status()
                if status.get("person", "") != person:  # and so another friction curve
                    surfaces, person = None, status["person"]
                    plate = PagePlate(client.plate(), person)
                    self._publish("plate", plate.text, None)
                self._publish("status", messages.status(status), None)


def _name(rig_dir: Path | None) -> str | None:
    """Return the name of a simulated plate, empty if its rig does not tell it; None for a real one."""
    if rig_dir is None:
        return None
    file = rig_dir / PLATE_FILE
    return config.load(file).sim.plate if file.is_file() else ""


def modes_of(body: Mapping[str, Any]) -> ModeShapes:
    """Return the daemon's mode map from its reply to `plate`. Raises HapticdError for a reply without one."""
    try:
        x_mm, y_mm = body["x_mm"], body["y_mm"]
        values = np.frombuffer(body["shapes"], "<f4").reshape(body["modes"], len(y_mm), len(x_mm))
        return ModeShapes.from_grid(x_mm, y_mm, values.astype(np.float64))
    except (KeyError, TypeError, ValueError, ModesError) as error:
        raise HapticdError(
            f"The daemon's reply to `plate` holds no mode shapes ({error}): restart it in this version."
        ) from None


def picture_grid(modes: ModeShapes, size_mm: tuple[float, float]) -> bytes:
    """Return the shapes as float32, little-endian: by mode, by rows from the top (+y) down, by columns."""
    x_mm = np.linspace(-size_mm[0] / 2, size_mm[0] / 2, GRID)
    y_mm = np.linspace(size_mm[1] / 2, -size_mm[1] / 2, GRID)
    points_mm = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    return np.ascontiguousarray(modes.evaluate(points_mm).T, dtype="<f4").tobytes()
