"""The touch device that a configuration names.

Each source loads its modules where it is the one: a service carries no other.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Final

from ..config.loader import load
from ..config.sections import TUIO_ADDRESS, TrackpadConfig
from ..io.devices.hid_trackpad import HidTrackpad
from ..io.devices.trackpad_source import TrackpadSource
from ..wire.trackpad.tuio import surface


def _evdev(config: TrackpadConfig) -> TrackpadSource:
    from ..io.devices.evdev_trackpad import EvdevTrackpad

    return EvdevTrackpad(config.device, config.size_mm)


def _tuio(config: TrackpadConfig) -> TrackpadSource:
    from ..io.devices.tuio_trackpad import TuioTrackpad

    return TuioTrackpad(config.device or TUIO_ADDRESS, surface(*config.size_mm), config.tuio_sender)


SOURCES: Final[dict[str, Callable[[TrackpadConfig], TrackpadSource]]] = {
    "hid": lambda config: HidTrackpad(config.device or "auto"),
    "evdev": _evdev,
    "tuio": _tuio,
}
LIE_ANYHOW: Final = frozenset(SOURCES) - {"hid"}  # rotated, mirrored, or of a size that they do not know


def connected(config: TrackpadConfig) -> TrackpadSource:
    """Return the source of a configuration whose `source` is one of SOURCES. Raises TrackpadError."""
    return SOURCES[config.source](config)


def chosen(options: argparse.Namespace) -> TrackpadConfig:
    """Return the device of the configuration that `--config` names, else an Apple trackpad. Raises ConfigError."""
    named = TrackpadConfig() if options.config is None else load(options.config).trackpad
    return named if named.source in SOURCES else TrackpadConfig(source="hid")


def settings(config: TrackpadConfig, model: str) -> dict[str, object]:
    """Return the settings of the trackpad section that name this device, of which `model` was connected."""
    if config.source == "hid":
        return {"source": config.source, "device": model}
    named: dict[str, object] = {"source": config.source}
    if config.device:
        named["device"] = config.device
    if config.tuio_sender:
        named["tuio_sender"] = config.tuio_sender
    if config.size_mm:
        named["size_mm"] = list(config.size_mm)
    return named
