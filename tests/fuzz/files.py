"""Files that a person writes: configuration and recordings of a trackpad. (Maps of the mode shapes, calibrations, the
daemon's own recordings, frames of the board, and what strains a reader most have tests of their own.)

Each is read from a real file, as the programs do; what is refused is refused in one printable sentence.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from fuzz.target import CORPORA, Cost, Target
from hapticd.config import loader as config
from hapticd.config.sections import Config
from hapticd.errors import ConfigError, HapticdError, TrackpadError
from hapticd.io.devices.replay import read_recording
from hapticd.wire.trackpad import evdev

LONGEST_SENTENCE = 6000  # one that quotes a file's name, of 4096 characters


def in_file(name: str, read: Callable[[Path], None], error_type: type[HapticdError], data: bytes) -> bool:
    """`data` as a file to `read`, which may raise `error_type` and nothing else. Returns whether it is read."""
    with tempfile.TemporaryDirectory(prefix="hapticd-fuzz-") as folder:
        path = Path(folder, name)
        path.write_bytes(data)
        try:
            read(path)
        except error_type as error:
            sentence = str(error)
            assert sentence.isprintable(), sentence
            assert sentence.endswith((".", "?")), sentence
            assert len(sentence) <= LONGEST_SENTENCE
            return False
        return True


def read_config(path: Path) -> None:
    """What is taken is printed by `run --print-config`, and that text is taken for the same."""
    settings = config.load(path)
    again = path.with_name("rendered.toml")
    again.write_text(config.render(settings), encoding="utf-8")
    assert config.load(again) == settings


def read_reports(path: Path) -> None:
    """What is taken is in order, and no longer than a device's reports."""
    _, reports = read_recording(path)
    stamps = [report.t_host_ns for report in reports]
    assert stamps == sorted(stamps)
    assert all(len(report.data) <= evdev.MAX_EVENTS * evdev.EVENT.size for report in reports)


TARGETS = (
    Target(
        "config",
        partial(in_file, "hapticd.toml", read_config, ConfigError),
        Cost(60_000, 2_000_000),
        Cost(150, 2500),
        lambda: {"default": config.render(Config()).encode()},
    ),
    Target(
        "recording",
        partial(in_file, "recording.txt", read_reports, TrackpadError),
        Cost(10_000, 300_000),
        Cost(20, 100),
        lambda: {"evemu": (CORPORA / "touchscreen-evemu-2.7.txt").read_bytes()},
    ),
)
