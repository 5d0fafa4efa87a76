"""Client library of hapticd: set the friction of each finger on the plate.

Start with `Client`. Its messages are defined in clients/PROTOCOL.md; it shares no code with the daemon.
"""

from .client import Client
from .errors import DaemonGoneError, HapticdError, RefusedError
from .messages import FingerState, Marker, PlateState
from .surface import Circle, Polygon, Rectangle
from .targets import Grating, Map

__all__ = [
    "Circle",
    "Client",
    "DaemonGoneError",
    "FingerState",
    "Grating",
    "HapticdError",
    "Map",
    "Marker",
    "PlateState",
    "Polygon",
    "Rectangle",
    "RefusedError",
]
