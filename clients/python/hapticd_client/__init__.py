"""Client library of hapticd: set the friction of each finger on the plate.

Start with `Client`. Its messages are defined in clients/PROTOCOL.md; it shares no code with the daemon.
"""

from .client import Client
from .effects import (
    At,
    Envelope,
    Modulation,
    Now,
    OnCrossing,
    OnEntering,
    OnLanding,
    OnLeaving,
    OnLifting,
    OnPressure,
    Pulse,
)
from .errors import DaemonGoneError, HapticdError, RefusedError
from .messages import FingerState, Marker, PlateEvent, PlateState
from .surface import Circle, Polygon, Rectangle
from .targets import Asset, Gradient, Grating, Map, Noise

__all__ = [
    "Asset",
    "At",
    "Circle",
    "Client",
    "DaemonGoneError",
    "Envelope",
    "FingerState",
    "Gradient",
    "Grating",
    "HapticdError",
    "Map",
    "Marker",
    "Modulation",
    "Noise",
    "Now",
    "OnCrossing",
    "OnEntering",
    "OnLanding",
    "OnLeaving",
    "OnLifting",
    "OnPressure",
    "PlateEvent",
    "PlateState",
    "Polygon",
    "Pulse",
    "Rectangle",
    "RefusedError",
]
