"""The client: what a program asks of the plate, and what it learns of it."""

from __future__ import annotations

import contextlib
import math
import os
import secrets
import sys
import threading
import weakref
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import zmq

from .control import Control
from .endpoint import KeyFile, find
from .errors import HapticdError, RefusedError
from .messages import PROTOCOL_VERSION, FingerState, PlateState
from .refresher import Refresher
from .targets import MAX_TTL_S, MIN_TTL_S, Fields, Grating, Map, label, number, path_fields, target_fields
from .telemetry import Telemetry
from .wanted import DEFAULT_TTL_S, Key, Wanted, no_stamp, stamp_now

FAREWELL_S = 0.5  # for the daemon to confirm that all is released


class Client:
    """A connection to hapticd. What it asked for holds until it changes it, or it is closed, or its program ends.

    `endpoint` is the daemon's runtime directory, as a path or `ipc://` path; without it the daemon's own rule finds
    it. A daemon on another machine is `tcp://HOST:PORT`, with two certificate files: `server_key`, its public key, and
    `own_key`, this client's secret one, which it must have been told to allow. `name` tells this client from others:
    1 .. 32 printable characters, made up where not given. Use one Client per thread. Raises DaemonGoneError where no
    daemon answers within `timeout_s`, HapticdError for an endpoint or a key that cannot be one.
    """

    def __init__(
        self,
        endpoint: str | os.PathLike[str] | None = None,
        name: str | None = None,
        *,
        timeout_s: float = 2.0,
        server_key: KeyFile | None = None,
        own_key: KeyFile | None = None,
    ) -> None:
        self.name = label("name", _made_up_name() if name is None else name)
        self._timeout_s = timeout_s
        self._wanted = Wanted()
        self._down: set[Key] = set()
        self._instance: int | None = None
        place = find(endpoint, os.environ, server_key, own_key)
        context = zmq.Context()
        try:
            self._control = Control(context, place)
            self.hello = _greeted(self._control, timeout_s)
        except zmq.ZMQError as error:
            context.destroy(linger=0)
            raise HapticdError(f"{place}: cannot be the daemon's directory ({error.strerror}).") from None
        except BaseException:
            context.destroy(linger=0)
            raise
        self._stamp = stamp_now if "stamp" in self.hello.get("optional", ()) else no_stamp
        self._telemetry = Telemetry(context, place)
        self._refresher = Refresher(context, place)
        self._finalizer = weakref.finalize(
            self, _say_farewell, self.name, self._stamp, self._refresher, self._control, self._telemetry, context
        )

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Release everything and disconnect. Also done when the client is garbage or the interpreter exits."""
        self._finalizer()

    # --- what fingers feel ---

    def set(
        self,
        finger: FingerState | Key,
        *,
        friction: float | None = None,
        amplitude_um: float | None = None,
        grating: Grating | None = None,
        map: Map | None = None,  # noqa: A002
        ttl_s: float = DEFAULT_TTL_S,
        wait: bool = True,
    ) -> None:
        """What this finger feels from now on: exactly one of the four.

        `finger` is one of `fingers()`, its id, or the name of a virtual finger. `friction` runs from 0, the most
        slippery that the plate can do, to 1, bare glass; `amplitude_um` is the vibration itself, peak to peak.
        `ttl_s` is how long the plate goes on should this program freeze. Raises RefusedError, with the daemon's
        sentence, and then nothing has changed; with `wait=False` it returns at once and only local errors are seen.
        """
        target = target_fields(friction=friction, amplitude_um=amplitude_um, grating=grating, image=map)
        key = _key(finger)
        self._want(self._wanted.with_target(key, target, number("ttl_s", ttl_s, MIN_TTL_S, MAX_TTL_S)), wait)

    def virtual(
        self,
        name: str,
        position_mm: Sequence[float] | None = None,
        path: Sequence[Sequence[float]] | None = None,
        *,
        speed_mm_s: float = 50.0,
        loop: bool = True,
        ttl_s: float = DEFAULT_TTL_S,
        wait: bool = True,
    ) -> None:
        """A finger that is not on the plate: it rests at a position, or walks a `path` of such, to and fro with `loop`.

        Give it a target with `set(name, ...)`; repeating the same path does not start it anew. Raises RefusedError.
        """
        if position_mm is not None and path is None:
            path = [position_mm]
        elif path is None or position_mm is not None:
            raise RefusedError("virtual: give exactly one of position_mm and path.")
        fields = path_fields(path, speed_mm_s, loop)
        ttl_s = number("ttl_s", ttl_s, MIN_TTL_S, MAX_TTL_S)
        self._want(self._wanted.with_virtual(label("name", name), fields, ttl_s), wait)

    def release(self, finger: FingerState | Key | None = None) -> None:
        """Give up one finger, or a virtual finger by its name; without an argument, all."""
        stamp = self._stamp()
        body: dict[str, object] = {"client": self.name, **stamp}
        wanted = Wanted()
        if finger is not None:
            body["finger"] = _key(finger)
            wanted = self._wanted.without(_key(finger))
        try:
            self._ask("release", body)
        finally:
            self._keep(wanted, stamp, is_told=True)

    # --- what the plate does ---

    def fingers(self, timeout_s: float = 1.0) -> list[FingerState]:
        """The fingers on the plate now, oldest first. Raises DaemonGoneError where no state comes in time."""
        self._check_open()
        state = self._telemetry.current(timeout_s)
        self._forget_lifted(state)
        return [finger for finger in state.fingers if not finger.virtual]

    def states(self, timeout_s: float = 2.0) -> Iterator[PlateState]:
        """The newest state, again and again; those in between are skipped. Raises DaemonGoneError when none comes."""
        while True:
            self._check_open()
            state = self._telemetry.next(timeout_s)
            self._forget_lifted(state)
            yield state

    def status(self) -> dict[str, Any]:
        """The daemon's health: counters, latencies, the board."""
        return self._ask("status")

    def plate(self) -> dict[str, Any]:
        """The plate's size, limits, drive and mode shapes, as `plate` in clients/PROTOCOL.md has them."""
        return self._ask("plate")

    def capabilities(self) -> dict[str, Any]:
        """What this daemon can be asked, and within which bounds."""
        return self._ask("capabilities")

    def clear_fault(self) -> None:
        """Leave a latched fault. Raises RefusedError where its cause persists."""
        self._ask("clear_fault")

    def marker(self, text: str) -> int:
        """Note an instant of an experiment, such as "trial 7 begins", in the recording and in every client's states.

        1 .. 100 printable characters. Returns the instant: nanoseconds on the daemon's monotonic clock. Raises
        RefusedError, also for a daemon that knows no markers yet.
        """
        return int(self._ask("marker", {"client": self.name, "text": text})["t_ns"])

    # --- what is wanted ---

    def _want(self, wanted: Wanted, wait: bool) -> None:
        self._check_open()
        stamp = self._stamp()
        if not wait:
            self._keep(wanted, stamp)
            return
        wanted.payload(self.name, stamp)  # too large is refused before anything is asked
        try:
            self._ask("set", wanted.fields(self.name, stamp))
        except HapticdError:
            self._keep(self._wanted, self._stamp())  # the daemon may have taken what it did not refuse
            raise
        self._keep(wanted, stamp, is_told=True)

    def _ask(self, op: str, body: dict[str, object] | None = None) -> dict[str, Any]:
        self._check_open()
        return self._control.request(op, body, timeout_s=self._timeout_s)

    def _check_open(self) -> None:
        if not self._finalizer.alive:
            raise HapticdError("This client is closed: make another.")

    def _keep(self, wanted: Wanted, stamp: Fields, *, is_told: bool = False) -> None:
        """From now on refresh this; at once, unless the daemon was told by a request."""
        payload = wanted.payload(self.name, stamp)
        ttl_s = math.inf if wanted.is_empty else wanted.ttl_s
        self._wanted = wanted
        if is_told:
            self._refresher.keep(payload, ttl_s)
        else:
            self._refresher.send(payload, ttl_s)

    def _forget_lifted(self, state: PlateState) -> None:
        """A lifted finger's id is never used again, so what was wanted for it would be refreshed in vain."""
        if state.instance != self._instance:  # another daemon counts its fingers from 1
            self._instance, self._down = state.instance, set()
        down: set[Key] = {finger.id for finger in state.fingers if not finger.virtual}
        lifted = (self._down - down) & self._wanted.targets.keys()
        self._down = down
        if lifted:
            self._keep(self._wanted.without(*lifted), self._stamp())


def _key(finger: FingerState | Key) -> Key:
    key = finger.id if isinstance(finger, FingerState) else finger
    return label("finger", key) if isinstance(key, str) else int(number("finger", key, 1, 2**32 - 1))


def _made_up_name() -> str:
    program = "".join(c for c in Path(sys.argv[0] if sys.argv else "").stem if c.isprintable()) or "python"
    return f"{program[:16]}-{os.getpid()}-{secrets.token_hex(2)}"


def _greeted(control: Control, timeout_s: float) -> dict[str, Any]:
    hello = control.request("hello", timeout_s=timeout_s)
    if hello.get("protocol") != PROTOCOL_VERSION:
        raise HapticdError(
            f"The daemon speaks protocol version {hello.get('protocol')}, this library {PROTOCOL_VERSION}: "
            "install the hapticd-client that belongs to the daemon."
        )
    return hello


def _say_farewell(
    name: str,
    stamp: Callable[[], Fields],
    refresher: Refresher,
    control: Control,
    telemetry: Telemetry,
    context: zmq.Context[zmq.Socket[bytes]],
) -> None:
    """Release and disconnect. Knows no Client: it must be able to run when that is gone."""
    if refresher.is_current_thread:  # the garbage collector runs where it likes; there it could not wait for the end
        threading.Thread(target=_say_farewell, args=(name, stamp, refresher, control, telemetry, context)).start()
        return
    last = stamp()
    refresher.send(Wanted().payload(name, last), math.inf)
    refresher.stop()
    with contextlib.suppress(HapticdError):  # then the time to live releases it
        control.request("release", {"client": name, **last}, timeout_s=FAREWELL_S)
    control.close()
    telemetry.close()
    context.term()
