"""The sockets and threads of one client: connected together, closed together."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import threading
from collections.abc import Iterator
from typing import Any

import zmq

from hapticd_contract.base import PROTOCOL_VERSION
from hapticd_contract.contents import CONTENTS
from hapticd_contract.requests import Release
from hapticd_contract.surfaces import Surface
from hapticd_contract.targets import FingerTarget

from .asset import KEEPER, AssetKeeper, upload
from .control import Control
from .endpoint import KeyFile, find
from .errors import HapticdError, RefusedError
from .refresher import REFRESHER, Refresher
from .target_set import TargetSet, no_stamp, stamp_now
from .targets import Asset
from .telemetry import EventReader, Telemetry

FIRST_CONTENTS = 4  # that every daemon knows
RELEASE_S = 0.5  # timeout of the final release
SILENT_S = 1.0  # of waiting for a daemon
SHORT_S = 2.0  # a timeout after which the error comes soon enough
THREADS = (REFRESHER, KEEPER)


class Connection:
    """One connection to a daemon. It has no reference to the Client, so it can close when that is collected."""

    def __init__(
        self,
        name: str,
        endpoint: str | os.PathLike[str] | None,
        server_key: KeyFile | None,
        own_key: KeyFile | None,
        timeout_s: float,
    ) -> None:
        """Connect, and greet the daemon. Raises DaemonGoneError, HapticdError."""
        self.name = name
        self._timeout_s = timeout_s
        self.endpoint = place = find(endpoint, os.environ, server_key, own_key)
        self._context = zmq.Context()
        try:
            self._control = Control(self._context, place)
            with _announced(f"Waiting for hapticd at {place} ...", timeout_s):
                self.hello = _hello(self._control, timeout_s)
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            raise HapticdError(f"{place}: is not a valid runtime directory ({error.strerror}).") from None
        except BaseException:
            self._context.destroy(linger=0)
            raise
        self.stamp = stamp_now if self.has("stamp") else no_stamp
        self.telemetry = Telemetry(self._context, place)
        self.events = EventReader(self._context, place)
        self.refresher = Refresher(self._context, place)
        self.keeper = AssetKeeper(self._context, place, name)

    def request(self, op: str, body: object = None) -> dict[str, Any]:
        """Return the reply's body. Raises RefusedError, DaemonGoneError."""
        return self._control.request(op, body, timeout_s=self._timeout_s)

    def upload(self, asset: Asset) -> None:
        """Send the parts of an asset that the daemon does not have. Raises RefusedError, HapticdError."""
        upload(lambda body: self.request("asset", body), self.name, asset)

    def has(self, optional: str) -> bool:
        """Return whether the daemon knows a part of the protocol that older ones lack."""
        return optional in self.hello.get("optional", ())

    def check(self, optional: str, what: str) -> None:
        """Raise RefusedError for a daemon that lacks it."""
        if not self.has(optional):
            raise RefusedError(f"{what}: this daemon does not have that: update it.")

    def check_content(self, target: FingerTarget | Surface) -> None:
        """Raise RefusedError for content that an older daemon does not know."""
        for kind in CONTENTS[FIRST_CONTENTS:]:
            if getattr(target, kind) is not None and kind not in self.hello.get("targets", ()):
                raise RefusedError(f"{kind}: this daemon does not have it: update it.")
        if isinstance(target, FingerTarget) and target.priority > 0:
            self.check("priority", "priorities")
        if target.map is not None and target.map.friction is not None:
            self.check("friction_map", "maps of frictions")
        if target.map is not None and target.map.asset is not None:
            self.check("assets", "assets")

    def close(self) -> None:
        """Release all fingers and disconnect."""
        # By the garbage collector: no thread can join itself, and another client's must not wait.
        if threading.current_thread().name in THREADS:
            threading.Thread(target=self.close).start()
            return
        last = self.stamp()
        self.refresher.send(TargetSet().payload(self.name, last), math.inf)
        self.refresher.stop()
        self.keeper.stop()
        with contextlib.suppress(HapticdError):  # then the time to live expires
            self._control.request("release", Release(self.name, stamp=last), timeout_s=RELEASE_S)
        self._control.close()
        self.telemetry.close()
        self.events.close()
        self._context.term()


@contextlib.contextmanager
def _announced(sentence: str, timeout_s: float) -> Iterator[None]:
    """Print a sentence on stderr where something takes long and may take longer."""
    timer = threading.Timer(SILENT_S, print, (sentence,), {"file": sys.stderr, "flush": True})
    timer.daemon = True
    if timeout_s > SHORT_S:
        timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _hello(control: Control, timeout_s: float) -> dict[str, Any]:
    hello = control.request("hello", timeout_s=timeout_s)
    if hello.get("protocol") != PROTOCOL_VERSION:
        raise HapticdError(
            f"The daemon has protocol version {hello.get('protocol')!r}, this library {PROTOCOL_VERSION}: "
            "install the hapticd-client of the daemon's version."
        )
    return hello
