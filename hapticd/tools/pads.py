"""The touch device that a configuration names: its source, and the choice of one on the command line.

Each source loads its modules where it is the one: a service carries no other.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Final

from ..config.sections import TrackpadConfig
from ..errors import CalibrationError
from ..io.devices.hid_trackpad import HidTrackpad
from ..io.devices.trackpad_source import TrackpadSource
from ..wire.trackpad import PADS
from ..wire.trackpad.tuio import surface


def _evdev(config: TrackpadConfig) -> TrackpadSource:
    from ..io.devices.evdev_trackpad import EvdevTrackpad

    return EvdevTrackpad(config.device, config.size_mm)


def _tuio(config: TrackpadConfig) -> TrackpadSource:
    from ..io.devices.tuio_trackpad import TuioTrackpad

    return TuioTrackpad(config.tuio_address, surface(*config.size_mm), config.tuio_sender)


SOURCES: Final[dict[str, Callable[[TrackpadConfig], TrackpadSource]]] = {
    "hid": lambda config: HidTrackpad(config.model),
    "evdev": _evdev,
    "tuio": _tuio,
}
LIE_ANYHOW: Final = frozenset(SOURCES) - {"hid"}  # rotated, mirrored, or of a size that they do not know


def connected(config: TrackpadConfig) -> TrackpadSource:
    """Return the source of a configuration whose `source` is one of SOURCES. Raises TrackpadError."""
    return SOURCES[config.source](config)


def add_choice(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that name a device; `chosen` reads them."""
    parser.add_argument("--source", choices=tuple(SOURCES), default="hid", help="of touches (default hid)")
    parser.add_argument("--model", default="auto", help="of the trackpad on hid (default: the connected one)")
    parser.add_argument("--device", default="", help="path or name of the device on evdev (default: the first one)")
    parser.add_argument("--address", default="127.0.0.1:3333", help="that is bound for tuio (default 127.0.0.1:3333)")
    parser.add_argument("--sender", default="", help="address that tuio must come from (default: this computer)")
    parser.add_argument(
        "--pad-size",
        default="",
        metavar="WxH",
        help="of the device's range of positions, in mm (default: its own word)",
    )


def chosen(options: argparse.Namespace) -> TrackpadConfig:
    """Return the device that the arguments name. Raises CalibrationError."""
    if options.model not in ("auto", *PADS):
        raise CalibrationError(f"--model: there is no {options.model!r}: give auto or one of {', '.join(PADS)}.")
    size_mm = _size_mm(options.pad_size)
    if options.source == "tuio" and not size_mm:
        raise CalibrationError("--source tuio: a tracker gives shares of its surface: give its size with --pad-size.")
    return TrackpadConfig(
        source=options.source,
        model=options.model,
        device=options.device,
        size_mm=size_mm,
        tuio_address=options.address,
        tuio_sender=options.sender,
    )


def settings(config: TrackpadConfig, model: str) -> dict[str, object]:
    """Return the settings of the trackpad section that name this device, of which `model` was connected."""
    if config.source == "hid":
        return {"source": config.source, "model": model}
    named: dict[str, object] = {"source": config.source}
    if config.device:
        named["device"] = config.device
    if config.source == "tuio":
        named["tuio_address"] = config.tuio_address
    if config.tuio_sender:
        named["tuio_sender"] = config.tuio_sender
    if config.size_mm:
        named["size_mm"] = list(config.size_mm)
    return named


def _size_mm(text: str) -> tuple[float, ...]:
    if not text:
        return ()
    try:
        width_mm, height_mm = (float(side) for side in text.lower().split("x"))
    except ValueError:
        raise CalibrationError(f"--pad-size is {text!r}: write width and height in mm, such as 344x194.") from None
    if not (1.0 <= width_mm <= 5000.0 and 1.0 <= height_mm <= 5000.0):
        raise CalibrationError(f"--pad-size is {text!r}: each side is 1 mm to 5000 mm.")
    return width_mm, height_mm
