"""What the library sends and what the daemon takes: each side's bounds as a yes or no."""

from __future__ import annotations

from collections.abc import Callable

import msgpack

from hapticd.errors import RequestError
from hapticd.wire import client as wire
from hapticd_client import RefusedError


def offered(make: Callable[[], object]) -> bool:
    """Whether the library sends what `make` gives."""
    try:
        make()
    except RefusedError:
        return False
    return True


def understood(**fields: object) -> bool:
    """Whether the daemon takes a message with these fields."""
    try:
        wire.decode_targets(msgpack.packb({"v": 1, "client": "c", **fields}))
    except RequestError:
        return False
    return True
