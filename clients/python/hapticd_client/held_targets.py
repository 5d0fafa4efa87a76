"""The targets that one client asks for now: requested, refreshed while they hold, dropped with lifted fingers."""

from __future__ import annotations

import math

from hapticd_contract.requests import Release
from hapticd_contract.states import PlateState

from .connection import Connection
from .errors import HapticdError
from .target_set import SceneKey, TargetSet
from .targets import Asset, Map


class HeldTargets:
    """Targets that a client holds. It has no reference to the Client, so that one can be collected."""

    def __init__(self, link: Connection) -> None:
        self.targets = TargetSet()
        self._link = link
        self._assets: dict[bytes, Asset] = {}  # that maps of the targets may use
        self._down: set[SceneKey] = set()
        self._instance: int | None = None

    def request(self, targets: TargetSet, *, wait: bool) -> None:
        """Ask for these instead. Raises RefusedError, and then nothing has changed, DaemonGoneError with `wait`."""
        stamp = self._link.stamp()
        if not wait:
            self._keep(targets, stamp)
            return
        targets.payload(self._link.name, stamp)  # refuses too many bytes before the request
        try:
            self._link.request("set", targets.message(self._link.name, stamp))
        except HapticdError:
            self._keep(self.targets, self._link.stamp())  # the daemon may have accepted the other targets
            raise
        self._keep(targets, stamp, is_sent=True)

    def release(self, key: SceneKey | None) -> None:
        """Release one finger, or all. Raises RefusedError, DaemonGoneError; the targets are dropped even then."""
        stamp = self._link.stamp()
        targets = TargetSet() if key is None else self.targets.without(key)
        try:
            self._link.request("release", Release(self._link.name, key, stamp))
        finally:
            self._keep(targets, stamp, is_sent=True)

    def use_asset(self, image: Map | None, *, wait: bool) -> None:
        """Keep a map's asset; upload it if the daemon has dropped it, or without `wait` let the keeper do that."""
        if image is None or not isinstance(image.rows, Asset):
            return
        self._assets[image.rows.digest] = image.rows
        if wait:
            self._link.upload(image.rows)

    def drop_lifted(self, state: PlateState) -> None:
        """Drop the targets of lifted fingers, whose ids are never used again."""
        if state.instance != self._instance:  # a restarted daemon counts its fingers from 1
            self._instance, self._down = state.instance, set()
        down: set[SceneKey] = {finger.id for finger in state.fingers if not finger.virtual}
        lifted = (self._down - down) & self.targets.fingers
        self._down = down
        if lifted:
            self._keep(self.targets.without(*lifted), self._link.stamp())

    def _keep(self, targets: TargetSet, stamp: int | None, *, is_sent: bool = False) -> None:
        """Refresh these targets from now on; send them at once unless a request did."""
        payload = targets.payload(self._link.name, stamp)
        ttl_s = math.inf if targets.is_empty else targets.ttl_s
        self.targets = targets
        if self._assets:
            self._assets = {digest: self._assets[digest] for digest in targets.assets}
            self._link.keeper.keep(tuple(self._assets.values()))
        if is_sent:
            self._link.refresher.keep(payload, ttl_s)
        else:
            self._link.refresher.send(payload, ttl_s)
