"""Files that a person writes: configuration, calibration, recordings and maps of the mode shapes.

Each is read from a real file, as the programs do; what is refused is refused in one printable sentence.
"""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from fuzz.target import Cost, Target
from hapticd.board_values import BoardCalibration, ModeCalibration
from hapticd.config import loader as config
from hapticd.config.sections import Config
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.errors import ConfigError, HapticdError, ModesError, TrackpadError
from hapticd.files import calibration
from hapticd.formats.mode_map import MAX_BYTES, MAX_LINES
from hapticd.formats.toml_file import MAX_BYTES as MAX_TOML_BYTES
from hapticd.io.devices.replay import read_recording, write_recording
from hapticd.io.devices.trackpad_source import REPORT_BYTES
from hapticd.values import RawReport
from hapticd.wire.trackpad import DEFAULT_PAD, to_fields

LONGEST_SENTENCE = 6000  # one that quotes a file's name, of 4096 characters
NPZ_NAMES = ("x_mm", "y_mm", "shapes")


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


def written(write: Callable[[Path], None]) -> bytes:
    """What `write` puts into a file."""
    with tempfile.TemporaryDirectory(prefix="hapticd-fuzz-") as folder:
        path = Path(folder, "written")
        write(path)
        return path.read_bytes()


# --- configuration ---


def read_config(path: Path) -> None:
    """What is taken is printed by `run --print-config`, and that text is taken for the same."""
    settings = config.load(path)
    again = path.with_name("rendered.toml")
    again.write_text(config.render(settings), encoding="utf-8")
    assert config.load(again) == settings


def toml_extremes() -> dict[str, bytes]:
    return {
        "digits": b"a = " + b"9" * (MAX_TOML_BYTES - 4),
        "hexadecimal": b"mode = 0x" + b"f" * (MAX_TOML_BYTES - 9),
        "parts": b"a" + b".a" * (MAX_TOML_BYTES // 2 - 4) + b"=1",
        "some parts": (b"a" + b".a" * 15 + b"=1\n") * 1900,
        "headers": b"[" + b"a." * 15 + b"a]\n" + b"".join(b"[%d]\n" % n for n in range(9000)),
        "brackets": b"a = " + b"[" * (MAX_TOML_BYTES - 4),
        "braces": b"a = " + b"{a=" * (MAX_TOML_BYTES // 3 - 4),
        "lists": b"w = [" + b"1," * (MAX_TOML_BYTES // 2 - 4) + b"]",
        "text": b'a = "' + b"\\t" * (MAX_TOML_BYTES // 2 - 4) + b'"',
        "too long": b"#" * (MAX_TOML_BYTES + 1),
    }


# --- calibration ---


def calibration_seed() -> dict[str, bytes]:
    modes = [ModeCalibration(mode, 29195.0 + 20 * mode, 500.0, 5.3, -0.5) for mode in (0, 1)]
    return {"two": written(lambda path: calibration.save(path, BoardCalibration(tuple(modes))))}


def read_calibration(path: Path) -> None:
    found = calibration.load(path, 2).modes
    assert len({one.mode for one in found}) == len(found) <= 2
    for one in found:
        detuning_rad_s = one.model(29205.0).detuning_rad_s
        assert abs(detuning_rad_s) < 1e7
        assert 1 <= one.q_factor <= 1e5


# --- recordings ---


def read_reports(path: Path) -> None:
    """What is taken can be written, and is then read for the same."""
    pad, reports = read_recording(path)
    stamps = [report.t_host_ns for report in reports]
    assert stamps == sorted(stamps)
    assert all(len(report.data) <= REPORT_BYTES for report in reports)
    again = path.with_name("again.jsonl")
    write_recording(again, pad, reports)
    pad_again, reports_again = read_recording(again)
    assert (to_fields(pad_again), reports_again) == (to_fields(pad), reports)


def recording_seed() -> dict[str, bytes]:
    reports = [RawReport(11_000_000 * n, bytes((2, n, 0))) for n in range(4)]
    return {"sound": written(lambda path: write_recording(path, DEFAULT_PAD, reports))}


def recording_extremes() -> dict[str, bytes]:
    head = b'{"model": "mt1"}\n'
    return {
        "brackets": head + b"[" * 200_000,
        "digits": head + b'{"t_ns": ' + b"9" * 200_000,
        "events": b"N: a\nA: 35 0 99 0 0 1\nA: 36 0 99 0 0 1\n" + b"E: 0.000000 0 0 0\n" * 5000,
        "many": head + b'{"t_ns": 1, "report": "28000000"}\n' * 5000,
    }


# --- maps of the mode shapes ---


def check_npz(data: bytes) -> bool:
    """An archive holds checksums that no fuzzer guesses: behind a first byte of 1 come the three arrays without it."""
    return in_file("plate.npz", read_map, ModesError, packed_arrays(data[1:]) if data[:1] == b"\1" else data[1:])


def packed_arrays(data: bytes) -> bytes:
    """An archive of the parts between the words `\\x93NUMPY`."""
    return archived([b"\x93NUMPY" + part for part in data.split(b"\x93NUMPY")[1:]])


def archived(parts: Sequence[bytes], compression: int = zipfile.ZIP_STORED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, part in zip(NPZ_NAMES, parts, strict=False):
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), part, compression)
    return buffer.getvalue()


def read_map(path: Path) -> None:
    modes = ModeShapes.load(path)
    assert np.isfinite(modes.shapes).all()
    at_edge = modes.at(float(modes.x_mm[0]), float(modes.y_mm[-1]))
    assert len(at_edge) == modes.M
    assert np.isfinite(at_edge).all()
    assert np.isfinite(modes.evaluate(np.array([[0.0, 0.0], [1e9, -1e9]]))).all()


def csv_extremes() -> dict[str, bytes]:
    head = b"x_mm,y_mm,phi_1\n"
    ladder = b"".join(b"%d,%d,1\n" % (x, y) for y in range(4) for x in range(2 * MAX_LINES))
    return {
        "long line": head + ladder,
        "points": head + b"1,1,1\n" * 3000,
        "columns": b"x_mm,y_mm," + b",".join(b"phi_%d" % k for k in range(1, 5000)) + b"\n" + b"1," * 5000,
        "digits": head + b"1" * 100_000 + b",0,0\n",
    }


def npz_extremes() -> dict[str, bytes]:
    """A bomb: a little more than may be unpacked, of zeros."""
    zeros = [bytes(4 * MAX_BYTES)] * len(NPZ_NAMES)
    return {
        "bomb": b"\0" + archived(zeros, zipfile.ZIP_DEFLATED),
        "bzip2": b"\0" + archived(zeros, zipfile.ZIP_BZIP2),
    }


TARGETS = (
    Target(
        "config",
        partial(in_file, "hapticd.toml", read_config, ConfigError),
        Cost(60_000, 2_000_000),
        Cost(150, 2500),
        lambda: {"default": config.render(Config()).encode()},
        toml_extremes,
    ),
    Target(
        "calibration",
        partial(in_file, "calibration.toml", read_calibration, ConfigError),
        Cost(5000, 1_000_000),
        Cost(150, 2500),
        calibration_seed,
        toml_extremes,
    ),
    Target(
        "recording",
        partial(in_file, "recording.jsonl", read_reports, TrackpadError),
        Cost(10_000, 300_000),
        Cost(20, 100),
        recording_seed,
        recording_extremes,
    ),
    Target(
        "modes-csv",
        partial(in_file, "plate.csv", read_map, ModesError),
        Cost(50_000, 1.1 * MAX_BYTES),  # a reader's buffer
        Cost(60, 2000),
        extremes=csv_extremes,
    ),
    Target("modes-npz", check_npz, Cost(60_000, 3.2 * MAX_BYTES), Cost(60, 2000), extremes=npz_extremes),
)
