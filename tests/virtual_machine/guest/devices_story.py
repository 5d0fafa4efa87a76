"""The daemon on a touchscreen, and on a tracker: fingers land, the plate is driven; the device is pulled, and back."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
from daemon import Daemon
from datagrams import tuio1
from kernel import wait_for
from plate import MOVES_UM, RESTS_UM, is_as_asked, measured_um, wait_state
from touchscreen import RANGES, Touchscreen

from hapticd_client import Client, PlateState

SCREEN_NAME = "daemon's touchscreen"
PORT, WIDTH_MM, HEIGHT_MM = 3333, 200.0, 100.0
LEFT_MM, RIGHT_MM, SLID_MM = (-20.0, 7.5), (25.0, -7.5), 20.0  # where two fingers lie, of which one moves along x
PERIOD_S = 1 / 60
STEPS = 30

Place = tuple[float, float]


def screen_story() -> dict[str, Any]:
    """Two fingers on a screen that is plugged in, pulled under them, and plugged in again."""
    with served(f'source = "evdev"\ndevice = "{SCREEN_NAME}"') as (daemon, client):
        found = {}
        for plug in ("first", "second"):
            screen = Touchscreen(SCREEN_NAME)
            wait_for("the screen's line", lambda: "/dev/input/event" in daemon.lines()[-1])
            screen.send({0: {"id": 1} | on_screen(LEFT_MM, 0), 1: {"id": 2} | on_screen(RIGHT_MM, 0)})
            with Hand(lambda frame, left_mm, screen=screen: screen.send({0: on_screen(left_mm, frame)})) as hand:
                found[plug] = touched(client, hand.slide)
            screen.unplug()
            found[f"{plug} pulled"] = quiet(client)
        return ended(daemon, client, found)


def on_screen(place_mm: Place, frame: int) -> dict[str, int]:
    """A place in the screen's units; the kernel says nothing of a finger that does not move at all, so it trembles."""
    (_, x_high, per_x), (_, y_high, per_y) = RANGES["x"], RANGES["y"]
    return {"x": round(x_high / 2 + place_mm[0] * per_x) + frame % 2, "y": round(y_high / 2 - place_mm[1] * per_y)}


def tracker_story() -> dict[str, Any]:
    """Two fingers on a tracker that stops, and speaks again."""
    where = f'tuio_address = "127.0.0.1:{PORT}"\nsize_mm = [{WIDTH_MM}, {HEIGHT_MM}]'
    with served(f'source = "tuio"\n{where}') as (daemon, client), socket.socket(type=socket.SOCK_DGRAM) as tracker:

        def speak(frame: int, left_mm: Place) -> None:
            fingers_mm = {1: left_mm, 2: RIGHT_MM}
            places = {number: (0.5 + x / WIDTH_MM, 0.5 - y / HEIGHT_MM) for number, (x, y) in fingers_mm.items()}
            tracker.sendto(tuio1(frame, places), ("127.0.0.1", PORT))

        found = {}
        for plug in ("first", "second"):
            with Hand(speak) as hand:
                found[plug] = touched(client, hand.slide)
            found[f"{plug} pulled"] = quiet(client)
        return ended(daemon, client, found)


class Hand:
    """Calls `say` sixty times a second, with the frame's number and where the left finger is; ends in mid-touch."""

    def __init__(self, say: Callable[[int, Place], None]) -> None:
        self._say = say
        self._left_mm = LEFT_MM
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._rest, daemon=True)

    def __enter__(self) -> Hand:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def slide(self) -> None:
        for step in range(1, STEPS + 1):
            self._left_mm = LEFT_MM[0] + SLID_MM * step / STEPS, LEFT_MM[1]
            time.sleep(PERIOD_S)

    def _rest(self) -> None:
        frame = 1
        while not self._ended.wait(PERIOD_S):
            self._say(frame, self._left_mm)
            frame += 1


@contextmanager
def served(trackpad: str) -> Iterator[tuple[Daemon, Client]]:
    """The daemon as root on this trackpad, and a client of it."""
    daemon = Daemon(trackpad, ())
    try:
        with daemon.client() as client:
            yield daemon, client
    finally:
        daemon.kill()


def touched(client: Client, slide: Callable[[], None]) -> dict[str, Any]:
    """What a client sees of two fingers with opposite targets, of which one then moves."""
    landed = wait_state(client, "two fingers", lambda state: len(state.fingers) == 2)
    moved_um = 0.0

    def is_driven(state: PlateState) -> bool:
        nonlocal moved_um
        if not is_as_asked(client, state):
            return False
        moved_um = measured_um(client)
        return any(state.modal_um) and moved_um > MOVES_UM

    driven = wait_state(client, "a plate that is driven and moves", is_driven)
    slide()
    slid = wait_state(client, "the slide's end", has_slid)
    seen = {"landed": landed, "driven": driven, "slid": slid}
    return {name: msgspec.to_builtins(state) for name, state in seen.items()} | {"plate_um": moved_um}


def has_slid(state: PlateState) -> bool:
    to_mm = LEFT_MM[0] + SLID_MM
    return len(state.fingers) == 2 and min(abs(finger.x_mm - to_mm) for finger in state.fingers) < 0.2


def quiet(client: Client) -> dict[str, Any]:
    state = wait_state(client, "a quiet plate", lambda state: not state.fingers and not any(state.modal_um))
    wait_for("a plate at rest", lambda: measured_um(client) < RESTS_UM)
    seen: dict[str, Any] = msgspec.to_builtins(state)
    return seen


def ended(daemon: Daemon, client: Client, found: dict[str, Any]) -> dict[str, Any]:
    latency_ms = client.status()["latency_ms"]
    return found | {"exit": daemon.end(), "log": daemon.lines(), "latency_ms": latency_ms}
