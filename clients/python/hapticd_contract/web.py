"""Messages of a WebSocket of `hapticd gateway` in addition to those of the sockets `targets` and `control`."""

from __future__ import annotations

from typing import Literal

from .base import Contract


class Follow(Contract, frozen=True, kw_only=True):
    """Which states of the plate to send on this WebSocket from now on; without it none are sent."""

    v: Literal[1]
    states: Literal["newest", "every", "none"]
    """`newest`: a slow reader skips states, and their events; `every`: the newest 256 wait for it"""
