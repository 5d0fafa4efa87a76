"""Client library of hapticd: set the friction of each finger on the plate.

Start with `Client`. Its messages are defined in clients/PROTOCOL.md; it shares no code with the daemon.
"""

from .client import Client
from .errors import DaemonGoneError, HapticdError, RefusedError
from .messages import FingerState, Marker, PlateState
from .surface import Circle, Path, Polygon, Rectangle
from .targets import Asset, Gradient, Grating, Map, Noise

__all__ = [
    "Asset",
    "Circle",
    "Client",
    "DaemonGoneError",
    "FingerState",
    "Gradient",
    "Grating",
    "HapticdError",
    "Map",
    "Marker",
    "Noise",
    "Path",
    "PlateState",
    "Polygon",
    "Rectangle",
    "RefusedError",
]
