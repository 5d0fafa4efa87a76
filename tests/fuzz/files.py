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
from hapticd.formats.mode_map import MAX_BYTES, MAX_LINES, encode_grid
from hapticd.formats.toml_file import MAX_BYTES as MAX_TOML_BYTES
from hapticd.io.devices.replay import read_recording, write_recording
from hapticd.io.devices.trackpad_source import REPORT_BYTES
from hapticd.values import RawReport
from hapticd.wire.trackpad import DEFAULT_PAD, to_fields

LONGEST_SENTENCE = 6000  # one that quotes a file's name, of 4096 characters
NPZ_NAMES = ("x_mm", "y_mm", "shapes")


def in_file(name: str, read: Callable[[Path], None], error_type: type[HapticdError], data: bytes) -> None:
    """`data` as a file to `read`, which may raise `error_type` and nothing else."""
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


def written(write: Callable[[Path], None]) -> bytes:
    """What `write` puts into a file."""
    with tempfile.TemporaryDirectory(prefix="hapticd-fuzz-") as folder:
        path = Path(folder, "written")
        write(path)
        return path.read_bytes()


# --- configuration ----------------------------------------------------------------------------------------------


def read_config(path: Path) -> None:
    """What is taken is printed by `run --print-config`, and that text is taken for the same."""
    settings = config.load(path)
    again = path.with_name("rendered.toml")
    again.write_text(config.render(settings), encoding="utf-8")
    assert config.load(again) == settings


def config_seeds() -> dict[str, bytes]:
    lines = config.render(Config()).encode()
    texts = {
        "empty": "",
        "rig": '[trackpad]\nsource = "replay"\nreplay_file = "none"\n[device]\nport = "/dev/ttyACM0"\nbaud = 115200\n',
        "curve": "[plate]\nfriction_curve = [0, 0.5, 2.5]\nsize_mm = [100, 1e2]\n[limits]\nw_limit_um=[4,3.5,2]\n",
        "typo": "[solver]\npolcy = 'keep_zero'\n",
        "wide number": "[sim]\nseed = 0x" + "f" * 40 + "\n[device]\nbaud = 1e999\n",
        "wide list": "[limits]\nw_limit_um = [1" + "0" * 400 + "]\n",
        "no number": "[log]\nlevel = [nan, inf, -inf, true]\n[solver]\neffort = nan\n",
        "long path": "[plate]\nmodes_file = '" + "x" * 300 + "'\n",
        "nul": '[plate]\nmodes_file = "a\\u0000b"\n',
        "inline": "log = {level = 'debug'}\nsim.seed = 2\n",
        "date": "[sim]\nseed = 2024-01-01T00:00:00Z\n",
    }
    return {name: text.encode() for name, text in texts.items()} | {"default": lines[: lines.find(b"[limits]")]}


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


# --- calibration ------------------------------------------------------------------------------------------------


def read_calibration(path: Path) -> None:
    found = calibration.load(path, 2).modes
    assert len({one.mode for one in found}) == len(found) <= 2
    for one in found:
        detuning_rad_s = one.model(29205.0).detuning_rad_s
        assert abs(detuning_rad_s) < 1e7
        assert 1 <= one.q_factor <= 1e5


def calibration_seeds() -> dict[str, bytes]:
    modes = [ModeCalibration(mode, 29195.0 + 20 * mode, 500.0, 5.3, -0.5) for mode in (0, 1)]
    sound = written(lambda path: calibration.save(path, BoardCalibration(tuple(modes))))
    one = sound[sound.find(b"[[mode]]") : sound.rfind(b"[[mode]]")]
    return {
        "two": sound,
        "twice": one + one,
        "beyond": one.replace(b"mode = 0", b"mode = 0x" + b"f" * 5000),
        "huge": one.replace(b"500.00", b"5" * 400),
        "text": one.replace(b"29195.000", b"'high'"),
        "table": b"[mode]\nmode = 0\n",
        "list": b"mode = [1, [], {}]\n",
        "odd key": one + b'"\\u001b[31m" = 1\n',
    }


# --- recordings -------------------------------------------------------------------------------------------------


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


def recording_seeds() -> dict[str, bytes]:
    reports = [RawReport(11_000_000 * n, bytes((2, n, 0))) for n in range(4)]
    sound = written(lambda path: write_recording(path, DEFAULT_PAD, reports))
    return {
        "sound": sound,
        "backwards": sound + b'{"t_ns": -1, "report": "02"}\n',
        "digits": b'{"model": "mt1"}\n{"t_ns": ' + b"1" * 5000 + b', "report": ""}\n',
        "deep": b'{"model": ' + b"[" * 2000 + b"\n",
        "spaces": sound.replace(b'"02', b'"0 2'),
        "not a number": b'{"model": "mt1"}\n{"t_ns": NaN, "report": 1e999}\n',
        "not text": b'{"model": ["mt1"]}\n',
        "surrogate": b'{"model": "\\ud800"}\n',
        "libinput": b"# libinput record\n- node: a\n"
        b"    absinfo:\n      53: [0, 99, 0, 0, 1]\n      54: [0, 99, 0, 0, 1]\n"
        b"  events:\n    - [  0,  8000,   3,  57,    7] # EV_ABS\n    - [  0,  8000,   0,   0,    0] # --\n- node: b\n",
        "evemu": b"# EVEMU 1.3\nN: a\nA: 35 0 99 0 0 1\nA: 36 0 99 0 0\n"
        b"E: 0.008000 0003 0035 7\t#\nE: 0.009000 0000 0000 0\n",
    }


def recording_extremes() -> dict[str, bytes]:
    head = b'{"model": "mt1"}\n'
    return {
        "brackets": head + b"[" * 200_000,
        "digits": head + b'{"t_ns": ' + b"9" * 200_000,
        "events": b"N: a\nA: 35 0 99 0 0 1\nA: 36 0 99 0 0 1\n" + b"E: 0.000000 0 0 0\n" * 5000,
        "many": head + b'{"t_ns": 1, "report": "28000000"}\n' * 5000,
    }


# --- maps of the mode shapes ------------------------------------------------------------------------------------


def check_npz(data: bytes) -> None:
    """An archive holds checksums that no fuzzer guesses: behind a first byte of 1 come the three arrays without it."""
    in_file("plate.npz", read_map, ModesError, packed_arrays(data[1:]) if data[:1] == b"\1" else data[1:])


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


def small_grid(gap: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    axis_mm = np.linspace(-9.0, 9.0, 4)
    shapes = np.add.outer([1.0, 2.0], np.multiply.outer(axis_mm, axis_mm))
    if gap:
        shapes[:, 1, 2] = np.nan
    return axis_mm, axis_mm, shapes


def csv_seeds() -> dict[str, bytes]:
    sound, lines = encode_grid(small_grid(gap=False), ".csv"), b"x_mm,y_mm,phi_1\n"
    return {
        "sound": sound,
        "gap": encode_grid(small_grid(gap=True), ".csv"),
        "laboratory": b"\xef\xbb\xbf# scanned\r\n\r\n" + sound.replace(b",", b" , "),
        "twice": sound + sound.splitlines()[-1],
        "far": lines + b"-1e308,0,1\n1e308,0,1\n",
        "words": lines + b"here,there,much\n",
        "no place": lines + b"nan,0,1\n",
        "scattered": lines + b"1,2,3\n2,1,3\n7,8,3\n9,11,3\n",
        "huge": sound.replace(b"82.0", b"1e300"),
        "latin": b"x_mm,y_mm,phi_1\xb5\n",
    }


def csv_extremes() -> dict[str, bytes]:
    head = b"x_mm,y_mm,phi_1\n"
    ladder = b"".join(b"%d,%d,1\n" % (x, y) for y in range(4) for x in range(2 * MAX_LINES))
    return {
        "long line": head + ladder,
        "points": head + b"1,1,1\n" * 3000,
        "columns": b"x_mm,y_mm," + b",".join(b"phi_%d" % k for k in range(1, 5000)) + b"\n" + b"1," * 5000,
        "digits": head + b"1" * 100_000 + b",0,0\n",
    }


def npz_seeds() -> dict[str, bytes]:
    arrays = [as_npy(array) for array in small_grid(gap=False)]
    with_longs = [as_npy(np.array(["-1e4000", "1e4000", "2", "3"]).astype(np.longdouble)), *arrays[1:]]
    no_number = np.frombuffer((b"\x11\x22\x33\x44\x55\x66\x77\x08\xff\x7f" + bytes(6)) * 4, np.longdouble)
    return {
        "no number": b"\1" + as_npy(no_number) + b"".join(arrays[1:]),
        "archive": b"\0" + encode_grid(small_grid(gap=True), ".npz"),
        "arrays": b"\1" + b"".join(arrays),
        "gap": b"\1" + b"".join(map(as_npy, small_grid(gap=True))),
        "two": b"\1" + b"".join(arrays[:2]),
        "whole numbers": b"\1" + b"".join([as_npy(np.arange(4, dtype=">u2"))] * 2) + arrays[2],
        "texts": b"\1" + as_npy(np.array(["a", "b"])) + b"".join(arrays[1:]),
        "long doubles": b"\1" + b"".join(with_longs),
        "columns first": b"\1" + b"".join(arrays[:2]) + as_npy(np.asfortranarray(small_grid(gap=False)[2])),
        "claims": b"\1" + b"".join(arrays).replace(b"(2, 4, 4)", b"(" + b"9" * 7 + b",)"),
        "objects": b"\1" + b"".join(arrays).replace(b"'<f8'", b"'|O' "),
    }


def as_npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def npz_extremes() -> dict[str, bytes]:
    """A bomb: a little more than may be unpacked, of zeros."""
    zeros = [bytes(4 * MAX_BYTES)] * len(NPZ_NAMES)
    return {
        "bomb": b"\0" + archived(zeros, zipfile.ZIP_DEFLATED),
        "bzip2": b"\0" + archived(zeros, zipfile.ZIP_BZIP2),
    }


TARGETS = (
    Target(
        name="config",
        check=partial(in_file, "hapticd.toml", read_config, ConfigError),
        seeds=config_seeds,
        fixed=Cost(60_000, 2_000_000),
        per_byte=Cost(150, 2500),
        extremes=toml_extremes,
    ),
    Target(
        name="calibration",
        check=partial(in_file, "calibration.toml", read_calibration, ConfigError),
        seeds=calibration_seeds,
        fixed=Cost(5000, 1_000_000),
        per_byte=Cost(150, 2500),
        extremes=toml_extremes,
    ),
    Target(
        name="recording",
        check=partial(in_file, "recording.jsonl", read_reports, TrackpadError),
        seeds=recording_seeds,
        fixed=Cost(10_000, 300_000),
        per_byte=Cost(20, 100),
        extremes=recording_extremes,
    ),
    Target(
        name="modes-csv",
        check=partial(in_file, "plate.csv", read_map, ModesError),
        seeds=csv_seeds,
        fixed=Cost(50_000, 1.1 * MAX_BYTES),  # a reader's buffer
        per_byte=Cost(60, 2000),
        extremes=csv_extremes,
    ),
    Target(
        name="modes-npz",
        check=check_npz,
        seeds=npz_seeds,
        fixed=Cost(60_000, 3.2 * MAX_BYTES),
        per_byte=Cost(60, 2000),
        extremes=npz_extremes,
    ),
)
