"""The viewer's one client of the daemon, on a thread of its own: it hears states and carries out what pages want.

It is connected while a page is open, so that the daemon builds no telemetry for nobody. A daemon that goes is said,
and looked for until it is back.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import zmq

import hapticd_client

from ...errors import HapticdError
from . import messages
from .layers import LAYERS, LayerFinger
from .messages import ClearFault, Want
from .rig import TruthEar
from .shapes import modes_of, picture_grid

ANSWER_S = 2.0
STATE_S = 1.0  # a daemon that is silent for longer is gone
RETRY_S = 0.5
STATUS_EVERY_S = 1.0
FRAME_EVERY_S = 1 / 62  # as often as a screen is drawn, and a little more
MAX_WISHES = 32  # that wait, of different fingers: two for each that a client may hold

Tell = Callable[[str, str, "Plate | None"], None]
Wish = tuple[Want | ClearFault, Callable[[str], None]]


class Plate:
    """What is known of the daemon's plate: its description for the page, the grid of its shapes, where its rig is."""

    def __init__(self, body: Mapping[str, Any], client: str) -> None:
        simulated = body.get("simulated")
        self.rig_dir = Path(simulated) if simulated and Path(simulated, "fingers").is_socket() else None
        self.modes = modes_of(body)
        self.size_mm = (float(body["size_mm"][0]), float(body["size_mm"][1]))
        self.reference_limit_um = tuple(map(float, body["reference_limit_um"]))
        self.grid = picture_grid(self.modes, self.size_mm)
        self.fingers: tuple[LayerFinger, ...] = ()  # those that are wanted now
        self.text = messages.plate(body, client, sorted(LAYERS), is_simulated=self.rig_dir is not None)


class PlateClient:
    """Runs from `start` to `close`. `tell` is called on its thread with a kind, a message for all pages, and the plate
    where that is news."""

    def __init__(self, endpoint: str | None, tell: Tell) -> None:
        self.name = f"view-{os.getpid()}"
        self._endpoint = endpoint
        self._tell = tell
        self._wishes: dict[int | str | None, Wish] = {}  # by finger, None for the fault: the newest counts
        self._lock = threading.Lock()  # of the wishes
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="hapticd-view", daemon=True)

    def start(self) -> None:
        """Connect, and go on until closed."""
        self._thread.start()

    def close(self) -> None:
        """Release everything and disconnect; returns when that is done."""
        self._ending.set()
        self._thread.join()

    def ask(self, wish: Want | ClearFault, refuse: Callable[[str], None]) -> None:
        """Have it carried out soon, if no newer one for the same finger comes; `refuse` hears why not."""
        finger = wish.finger if isinstance(wish, Want) else None
        with self._lock:
            is_taken = finger in self._wishes or len(self._wishes) < MAX_WISHES
            if is_taken:
                self._wishes[finger] = wish, refuse
        if not is_taken:
            refuse(messages.refused(f"{MAX_WISHES} wishes wait for the daemon already: ask again."))

    def _run(self) -> None:
        while not self._ending.is_set():
            try:
                with hapticd_client.Client(self._endpoint, name=self.name, timeout_s=ANSWER_S) as client:
                    self._serve(client)
            except (hapticd_client.HapticdError, HapticdError) as error:
                self._tell("gone", messages.gone(str(error)), None)
                self._refuse_all(messages.refused(str(error)))
                self._ending.wait(RETRY_S)

    def _serve(self, client: hapticd_client.Client) -> None:
        plate = Plate(client.plate(), client.name)
        self._tell("plate", plate.text, plate)
        with contextlib.ExitStack() as stack:
            ear = None
            if plate.rig_dir is not None:
                context = stack.enter_context(zmq.Context())
                ear = TruthEar(context, plate.rig_dir)
                stack.callback(ear.close)
            self._follow(client, plate, ear)

    def _follow(self, client: hapticd_client.Client, plate: Plate, ear: TruthEar | None) -> None:
        t_frame_s = t_status_s = -1.0
        instance: int | None = None
        for state in client.states(timeout_s=STATE_S):
            if self._ending.is_set() or (instance is not None and state.instance != instance):
                return  # another daemon may have another plate
            instance = state.instance
            self._carry_out(client)
            t_now_s = time.monotonic()
            if t_now_s - t_frame_s >= FRAME_EVERY_S:
                t_frame_s = t_now_s
                truth = None if ear is None else ear.newest(state.t_ns)
                plate.fingers = tuple(
                    LayerFinger(finger.id, finger.x_mm, finger.y_mm, finger.target_um)
                    for finger in state.fingers
                    if finger.target_um is not None
                )
                self._tell("frame", messages.frame(state, truth), None)
            if t_now_s - t_status_s >= STATUS_EVERY_S:
                t_status_s = t_now_s
                self._tell("status", messages.status(client.status()), None)

    def _refuse_all(self, sentence: str) -> None:
        for _, refuse in self._waiting():
            refuse(sentence)

    def _carry_out(self, client: hapticd_client.Client) -> None:
        for wish, refuse in self._waiting():
            try:
                _ask(client, wish)
            except hapticd_client.RefusedError as error:
                refuse(messages.refused(str(error)))

    def _waiting(self) -> Iterator[Wish]:
        """What is wished now, each taken away; as many as may wait, for pages may wish faster than they are served."""
        for _ in range(MAX_WISHES):
            with self._lock:
                if not self._wishes:
                    return
                wish = self._wishes.pop(next(iter(self._wishes)))
            yield wish


def _ask(client: hapticd_client.Client, wish: Want | ClearFault) -> None:
    if isinstance(wish, ClearFault):
        client.clear_fault()
    elif wish.amplitude_um is None:
        client.release(wish.finger)
    else:
        client.set(wish.finger, amplitude_um=wish.amplitude_um)
