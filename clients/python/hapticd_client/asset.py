"""Uploads of assets, and a thread that uploads those in use again when the daemon no longer has them."""

from __future__ import annotations

import contextlib
import hashlib
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import zmq

from hapticd_contract.base import MAX_PART_BYTES
from hapticd_contract.contents import MAX_ASSET_SIDE

from .control import Control
from .endpoint import Endpoint
from .errors import HapticdError
from .targets import Asset, LevelRows, levels_of

LOOK_S = 0.5  # the daemon drops an asset that nothing uses after ten seconds, and has none when it starts
ANSWER_S = 0.5
KEEPER = "hapticd-assets"  # its thread

Ask = Callable[[dict[str, object]], Mapping[str, Any]]  # sends the body of a request, returns that of the reply


def asset_of(source: LevelRows | str | os.PathLike[str]) -> Asset:
    """Return the asset of rows of levels or of a picture file. Raises RefusedError."""
    if isinstance(source, (str, os.PathLike)):
        from .image import grey_rows

        source = grey_rows(source, MAX_ASSET_SIDE)
    width, height, levels = levels_of(source, MAX_ASSET_SIDE)
    return Asset(hashlib.sha256(levels).digest(), width, height, levels)


def upload(ask: Ask, client: str, asset: Asset) -> None:
    """Send the parts that the daemon does not have. Raises RefusedError where it has no room, HapticdError."""
    size = len(asset.levels)
    body: dict[str, object] = {"client": client, "asset": asset.digest, "size": size}
    have = int(ask(body)["have"])
    for _ in range(2 * (size // MAX_PART_BYTES + 1)):  # a restart in between begins from the first byte
        if have >= size:
            return
        part = asset.levels[have : have + MAX_PART_BYTES]
        have = int(ask({**body, "offset": have, "part": part})["have"])
    if have < size:
        raise HapticdError("asset: the daemon does not keep its parts: try again.")


class AssetKeeper:
    """A thread that asks now and then whether the daemon has the assets in use, from the first of them to `stop`."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], endpoint: Endpoint, client: str) -> None:
        self._context = context
        self._endpoint = endpoint
        self._client = client
        self._assets: Sequence[Asset] = ()
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None

    def keep(self, assets: Sequence[Asset]) -> None:
        """Keep these, and no others."""
        self._assets = assets
        if assets and self._thread is None:
            self._thread = threading.Thread(target=self._run, name=KEEPER, daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Stop the thread."""
        self._stopped.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        control = Control(self._context, self._endpoint)

        def ask(body: dict[str, object]) -> dict[str, Any]:
            if self._stopped.is_set():
                raise HapticdError("The client is closed.")
            return control.request("asset", body, timeout_s=ANSWER_S)

        while not self._stopped.wait(LOOK_S):
            for asset in self._assets:
                with contextlib.suppress(HapticdError):  # next time
                    upload(ask, self._client, asset)
        control.close()
