"""Errors of this library. Every message is one sentence."""

from __future__ import annotations


class HapticdError(Exception):
    """Base class of all errors of this library."""


class RefusedError(HapticdError, ValueError):
    """The daemon or this library refused a request; the message is the reason."""


class DaemonGoneError(HapticdError, ConnectionError):
    """No daemon answers."""
