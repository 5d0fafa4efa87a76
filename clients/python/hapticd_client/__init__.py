"""Client library of hapticd: set the friction of each finger on the plate.

Start with `Client`. Its messages are defined in clients/PROTOCOL.md; what is in them
is `hapticd_contract`, which the daemon has too.
"""

from hapticd_contract import contents
from hapticd_contract.contents import *  # noqa: F403 -- a texture is named there, once
from hapticd_contract.effects import (
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
from hapticd_contract.states import FingerState, Marker, PlateEvent, PlateState
from hapticd_contract.surfaces import Circle, Polygon, Rectangle

from .client import Client
from .errors import DaemonGoneError, HapticdError, RefusedError
from .targets import Asset, Map

__all__ = [
    "Asset",
    "At",
    "Circle",
    "Client",
    "DaemonGoneError",
    "Envelope",
    "FingerState",
    "HapticdError",
    "Map",
    "Marker",
    "Modulation",
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
__all__ += contents.__all__
