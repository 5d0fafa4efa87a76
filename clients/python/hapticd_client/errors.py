"""What can go wrong. Every message is one sentence."""

from __future__ import annotations


class HapticdError(Exception):
    """Root of all errors of this library."""


class RefusedError(HapticdError, ValueError):
    """The daemon refused a request, or this library knows that it would; the message is the reason."""


class DaemonGoneError(HapticdError, ConnectionError):
    """No daemon answers."""
