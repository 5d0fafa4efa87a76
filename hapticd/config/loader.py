"""Loader of the configuration: TOML in, frozen values out, validated as a whole before any device is opened.

The default configuration runs the simulated plate.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from ipaddress import ip_address
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

from ..errors import ConfigError
from ..formats.toml_file import read_table
from .keys import bounds_text, checked, nearest, toml
from .sections import (
    MOST_MODES,
    PAD_NAMES,
    SCENARIO_NAMES,
    SIMULATED,
    TUIO_ADDRESS,
    ClientConfig,
    Config,
    LimitsConfig,
    TrackpadConfig,
    UncertaintyConfig,
)

MAX_PORT = 65535
FINGER_FILES = (".csv", ".mcap")
MIN_DETERMINANT = 0.1  # of trackpad.matrix: scales of 0.5, the least allowed, have 0.25


def load(path: Path) -> Config:
    """Load the TOML file at `path`; omitted keys keep their defaults. Raises ConfigError."""
    table = read_table(path, "check the path given to --config")
    return from_table(table, where=str(path), folder=path.parent)


def from_table(table: Mapping[str, Any], *, where: str, folder: Path | None) -> Config:
    """Validate a parsed table. `where` names it in errors; relative file names are resolved against `folder`.

    Without a folder the named files are not checked: they may be another machine's.
    """
    by_name = {section.name: section for section in fields(Config)}
    sections: dict[str, Any] = {}
    for name, value in table.items():
        if name not in by_name:
            raise ConfigError(f"{where}: unknown section [{name}]{nearest(name, by_name)}")
        if not isinstance(value, dict):
            raise ConfigError(f"{where}: {name} is a section: write [{name}] and its keys below.")
        section_type = cast(type, by_name[name].default_factory)
        sections[name] = _section(section_type, value, f"{where}: {name}")
    config = Config(**sections)
    _check_together(config, where)
    if folder is None:
        return config
    return _with_files(config, where, folder)


def known_keys(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a parsed table without sections and keys that this hapticd does not have."""
    sections = {one.name: cast(type, one.default_factory) for one in fields(Config)}
    names = {name: {entry.name for entry in fields(section)} for name, section in sections.items()}
    return {
        name: {key: value for key, value in section.items() if key in names[name]}
        for name, section in table.items()
        if name in names and isinstance(section, dict)
    }


def simulated(config: Config) -> Config:
    """Return this configuration for the simulated plate: its mode map, the firmware's models, the pad centred."""
    return replace(
        config,
        plate=replace(config.plate, modes_file=""),
        trackpad=replace(
            config.trackpad, source=SIMULATED, device="", offset_mm=(0.0, 0.0), matrix=TrackpadConfig().matrix
        ),
        device=replace(config.device, port=SIMULATED, calibration_file=""),
    )


def on_plate(config: Config, size_mm: tuple[float, ...], reach_um: tuple[float, ...]) -> Config:
    """Return this configuration for a simulated plate of `size_mm` whose amplifiers reach `reach_um` in each mode.

    Limits other than the default ones stay.
    """
    config = replace(config, plate=replace(config.plate, size_mm=size_mm))
    if config.limits.w_limit_um != LimitsConfig().w_limit_um:
        return config
    return replace(config, limits=replace(config.limits, w_limit_um=reach_um))


def with_uncertainty(config: Config, uncertainty: UncertaintyConfig) -> Config:
    """Return this configuration for a simulated plate of which so much is unknown; one other than the default stays."""
    return replace(config, uncertainty=uncertainty) if config.uncertainty == UncertaintyConfig() else config


def render(config: Config) -> str:
    """Format the active configuration as TOML with the meaning and bounds of each key."""
    lines = []
    for section in fields(Config):
        value = getattr(config, section.name)
        lines.append(f"[{section.name}]  # {(value.__doc__ or '').rstrip('.')}")
        for entry in fields(value):
            bounds = bounds_text(entry)
            comment = entry.metadata["doc"] + (f" ({bounds})" if bounds else "")
            lines.append(f"{entry.name} = {toml(getattr(value, entry.name))}  # {comment}")
        lines.append("")
    return "\n".join(lines)


def _section(section_type: type, table: Mapping[str, Any], where: str) -> Any:
    by_name = {entry.name: entry for entry in fields(section_type)}
    values = {}
    for name, value in table.items():
        if name not in by_name:
            raise ConfigError(f"{where}.{name}: unknown key{nearest(name, by_name)}")
        values[name] = checked(by_name[name], value, f"{where}.{name}")
    return section_type(**values)


def _check_together(config: Config, where: str) -> None:
    """Check constraints between keys. Raises ConfigError."""
    weights = config.prediction.pad_weights
    for name, value, length in (
        ("plate.size_mm", config.plate.size_mm, 2),
        ("trackpad.offset_mm", config.trackpad.offset_mm, 2),
        ("trackpad.matrix", config.trackpad.matrix, 4),
        ("trackpad.size_mm", config.trackpad.size_mm, 2 if config.trackpad.size_mm else 0),
        ("prediction.pad_weights", weights, 10 if weights else 0),
    ):
        if len(value) != length:
            raise ConfigError(f"{where}: {name}: needs {length} numbers, not {len(value)}.")
    _check_trackpad(config.trackpad, where)
    if not 1 <= len(config.limits.w_limit_um) <= MOST_MODES:
        raise ConfigError(f"{where}: limits.w_limit_um: needs one number per mode (1 .. {MOST_MODES}).")
    curve = config.plate.friction_curve
    if curve and (len(curve) < 2 or curve[0] != 0.0 or any(a >= b for a, b in pairwise(curve))):
        raise ConfigError(f"{where}: plate.friction_curve: needs two or more rising numbers, starting at 0.")
    fingers = config.sim.fingers_file
    if fingers and not fingers.endswith(FINGER_FILES):
        names = ", ".join(SCENARIO_NAMES)
        raise ConfigError(f"{where}: sim.scenario: {fingers!r} is not one of {names}, nor a CSV or recording.")
    if config.client.tcp:
        _check_tcp(config.client, where)
    if config.trackpad.source == SIMULATED and config.device.port != SIMULATED:
        raise ConfigError(
            f'{where}: trackpad.source: simulated fingers must not drive a real board: set it to "hid", "evdev" '
            f'or "tuio", or device.port to "{SIMULATED}".'
        )
    if config.device.port != SIMULATED and not config.plate.modes_file:
        raise ConfigError(f"{where}: plate.modes_file: a real plate needs its measured mode map (NPZ or CSV).")


def _check_trackpad(trackpad: TrackpadConfig, where: str) -> None:
    """Require an invertible matrix, and what the source needs."""
    xx, xy, yx, yy = trackpad.matrix
    if not abs(xx * yy - xy * yx) >= MIN_DETERMINANT:
        raise ConfigError(f"{where}: trackpad.matrix: is nearly singular: measure it again.")
    if trackpad.source == "hid" and trackpad.device not in ("", *PAD_NAMES):
        raise ConfigError(f"{where}: trackpad.device: {trackpad.device!r} is not one of {', '.join(PAD_NAMES)}.")
    if trackpad.source == "replay" and not trackpad.device:
        raise ConfigError(f'{where}: trackpad.device: source = "replay" needs a recording.')
    if trackpad.source == "tuio":
        _check_tuio(trackpad, where)


def _check_tuio(trackpad: TrackpadConfig, where: str) -> None:
    """Require an address with a port, and the size of the surface."""
    if trackpad.device:
        _check_port(trackpad.device, where, "trackpad.device: must be an address and a port", TUIO_ADDRESS)
    if trackpad.tuio_sender:
        try:
            ip_address(trackpad.tuio_sender)
        except ValueError:
            raise ConfigError(
                f"{where}: trackpad.tuio_sender: must be the tracker's address in numbers, such as "
                f'"192.168.7.20", without a port, not {trackpad.tuio_sender!r}.'
            ) from None
    if not trackpad.size_mm:
        raise ConfigError(f"{where}: trackpad.size_mm: TUIO gives shares of the surface: set its width and height.")


def _check_tcp(client: ClientConfig, where: str) -> None:
    """Require an address, three ports and keys."""
    what = "client.tcp: must be an address and the first of three ports"
    _check_port(client.tcp, where, what, "192.168.7.1:7410", ports=3)
    if not client.keys_dir:
        raise ConfigError(
            f"{where}: client.tcp: needs keys: make them with `hapticd service keys make` and set client.keys_dir "
            "to their directory."
        )


def _check_port(text: str, where: str, what: str, example: str, ports: int = 1) -> None:
    host, _, port = text.rpartition(":")
    if not (host and port.isascii() and port.isdigit() and 1 <= int(port) <= MAX_PORT + 1 - ports):
        raise ConfigError(f'{where}: {what}, such as "{example}", not {text!r}.')


def _with_files(config: Config, where: str, folder: Path) -> Config:
    """Return the configuration with absolute file names; raises ConfigError for a missing file."""
    for section, key in _file_keys(config):
        name = getattr(getattr(config, section), key)
        if not name:
            continue
        path = Path(os.path.realpath(folder / name))  # `resolve` raises for a loop of symbolic links
        if not _is_file(path):
            raise ConfigError(f"{where}: {section}.{key}: there is no file {path}.")
        config = replace(config, **{section: replace(getattr(config, section), **{key: str(path)})})
    for section, key in (("client", "keys_dir"), ("record", "file")):
        name = getattr(getattr(config, section), key)
        if name:
            resolved = {key: os.path.realpath(folder / name)}
            config = replace(config, **{section: replace(getattr(config, section), **resolved)})
    return config


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # no file system accepts the name
        return False


def _file_keys(config: Config) -> Iterator[tuple[str, str]]:
    if config.trackpad.source == "replay":
        yield "trackpad", "device"
    if config.sim.fingers_file:
        yield "sim", "scenario"
    for section in fields(Config):
        for entry in fields(cast(type, section.default_factory)):
            if entry.name.endswith("_file"):
                yield section.name, entry.name
