"""Give every finger on a plate served by hapticd its own friction.

`Client` is where to begin. The messages it exchanges are described in clients/PROTOCOL.md; it shares no code with
the daemon.
"""

from .client import Client
from .errors import DaemonGoneError, HapticdError, RefusedError
from .messages import FingerState, Marker, PlateState
from .targets import Grating, Map

__all__ = [
    "Client",
    "DaemonGoneError",
    "FingerState",
    "Grating",
    "HapticdError",
    "Map",
    "Marker",
    "PlateState",
    "RefusedError",
]
