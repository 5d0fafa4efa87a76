"""Files that were made to take all memory or all time: one sentence, or content, in at most 300 MB.

Each is read in a process of its own, whose peak is the kernel's. Time is bounded by what is counted before the work:
scans, samples, lines, members.
"""

from __future__ import annotations

import io
import json
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

pytestmark = pytest.mark.long  # a process for each file: a fifth of all other tests' processor time
MOST_MB = 300
MB = 1_000_000
CHILD = """
import contextlib, json, sys, time
from pathlib import Path

begun_s = time.process_time()
printed, outcome = "", None
if sys.argv[1] == "content":
    from hapticd_client import HapticdError, content
    begun_s = time.process_time()
    try:
        outcome = content.load(sys.argv[2]).title
    except HapticdError as error:
        printed = f"{error}\\n"
else:
    from hapticd.__main__ import main
    import io
    begun_s, stream = time.process_time(), io.StringIO()
    with contextlib.redirect_stderr(stream), contextlib.redirect_stdout(io.StringIO()):
        outcome = main(sys.argv[1:])
    printed = stream.getvalue()
taken_s = time.process_time() - begun_s
status = Path("/proc/self/status").read_text()
peak_mb = int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e6
print(json.dumps({"peak_mb": peak_mb, "taken_s": taken_s, "outcome": outcome, "printed": printed}))
"""


def sparse(path: Path, head: bytes, size: int) -> None:
    """A file of `head` and zeros."""
    with path.open("wb") as file:
        file.write(head)
        file.truncate(size)


def sound(rate_hz: int, data_bytes: int, channels: int = 1, before: bytes = b"") -> bytes:
    """The head of a WAV file, up to its samples."""
    form = struct.pack("<4sIHHIIHH", b"fmt ", 16, 1, channels, rate_hz, rate_hz * 2 & 0xFFFFFFFF, 2 * channels, 16)
    body = b"WAVE" + form + before + struct.pack("<4sI", b"data", data_bytes)
    return struct.pack("<4sI", b"RIFF", min(len(body) + data_bytes, 2**32 - 1)) + body


def jpeg_of_scans(path: Path, scans: int) -> None:
    """A progressive JPEG whose last scan is there again and again."""
    whole = io.BytesIO()
    Image.linear_gradient("L").resize((4000, 4000)).convert("RGB").save(whole, "JPEG", progressive=True, quality=30)
    data = whole.getvalue()[:-2]
    last = data[data.rindex(b"\xff\xda") :]
    path.write_bytes(data + last * (scans - data.count(b"\xff\xda")) + b"\xff\xd9")


def png(path: Path, mode: str, side: int) -> None:
    Image.new(mode, (side, side)).save(path)


def claims_pixels(path: Path, side: int) -> None:
    """A small JPEG that claims to be large."""
    whole = io.BytesIO()
    Image.new("L", (16, 16)).save(whole, "JPEG")
    data = bytearray(whole.getvalue())
    at = data.index(b"\xff\xc0") + 5
    data[at : at + 4] = struct.pack(">HH", side, side)
    path.write_bytes(data)


def npz(path: Path, member: bytes, names: tuple[str, ...] = ("x_mm", "y_mm", "shapes")) -> None:
    """An archive whose arrays are `member` three hundred times."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in names:
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                for _ in range(300):
                    file.write(member)


def crowded_zip(path: Path) -> None:
    entry = struct.pack("<4s6H3L5H2L", b"PK\x01\x02", 20, 20, *[0] * 4, 0, 0, 0, 1, *[0] * 4, 0, 0) + b"a"
    count = 340_000
    listed = entry * count
    end = struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, count & 0xFFFF, count & 0xFFFF, len(listed), 0, 0)
    path.write_bytes(listed + end)


def headed(path: Path, header: bytes) -> None:
    """A recording with this message for a header."""
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, chunk_size=1 << 30)
        writer.start()
        writer.add_message(writer.register_channel("/header", "msgpack", 0), 1, header, 1)
        writer.finish()


def lists(count: int) -> bytes:
    """MessagePack of a list of empty lists."""
    return b"\xdd" + struct.pack(">I", count) + b"\x90" * count


NESTED = b"[" * 900 + b"]" * 900 + b","
CLIENT: dict[str, tuple[str, Callable[[Path], object]]] = {
    "PostScript": ("a.png", lambda path: path.write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n")),
    "ten minutes of sound": ("a.wav", lambda path: sparse(path, sound(48000, 57_600_000) + b"\1\2" * 9, 57_600_044)),
    "five minutes of two channels": (
        "a.wav",
        lambda path: sparse(path, sound(48000, 57_600_000, 2) + b"\1\2" * 9, 58 * MB),
    ),
    "a sound of many chunks": ("a.wav", lambda path: sparse(path, sound(8000, 4, before=bytes(8)), 200 * MB)),
    "4000 scans": ("a.jpg", lambda path: jpeg_of_scans(path, 4000)),
    "as many scans as are taken": ("a.jpg", lambda path: jpeg_of_scans(path, 50)),
    "4 gigapixels": ("a.jpg", lambda path: claims_pixels(path, 65_000)),
    "transparent": ("a.png", lambda path: png(path, "RGBA", 4000)),
    "palette": ("a.png", lambda path: Image.new("P", (4000, 4000)).save(path, transparency=0)),
    "sixteen bits, transparent": (
        "a.png",
        lambda path: Image.new("I;16", (4000, 4000)).save(path, transparency=0),
    ),
    "a bomb of pixels": ("a.png", lambda path: png(path, "1", 16_000)),
    "lists in lists": ("a.ahap", lambda path: path.write_bytes(b'{"Pattern": [' + NESTED * 2200 + b"1]}")),
    "a list of objects": ("a.hjif", lambda path: path.write_bytes(b'{"perceptions": [' + b"{}," * 1_300_000 + b"{}]}")),
    "texts and a comma": ("a.ahap", lambda path: path.write_bytes(b"[" + b'"",' * 1_300_000 + b"]")),
    "quotes without end": ("a.ahap", lambda path: path.write_bytes(b'["",' + b'\\"' * 1_900_000)),
    "comments without end": ("a.hjif", lambda path: path.write_bytes(b"[//\n" + b", " * 1_000_000 + b"/*" * 900_000)),
    "a huge array": (
        "a.npy",
        lambda path: path.write_bytes(
            b"\x93NUMPY\x01\x00\x76\x00"
            + b"{'descr': '|u1', 'fortran_order': False, 'shape': (30000, 30000), }".ljust(117)
            + b"\n"
        ),
    ),
    "an array without end": ("a.npy", lambda path: sparse(path, b"\x93NUMPY\x01\x00", 400 * MB)),
}
MAP = ("plate", "map", "--finger=1,2", "--modes")
FOLDER = "."  # of the file, in place of its name
FINGERS = "t_s,finger,x_mm,y_mm,target_um\n"
SERVICE: dict[str, tuple[tuple[str, ...], str, Callable[[Path], object]]] = {
    "a bomb of arrays": (MAP, "a.npz", lambda path: npz(path, bytes(1 << 20))),
    "an archive of 340 000 members": (MAP, "a.npz", crowded_zip),
    "a map of empty lines": (MAP, "a.csv", lambda path: path.write_bytes(b"\n" * 16_000_000)),
    "a map of wide text": (MAP, "a.csv", lambda path: path.write_text("😀\n" * 3_300_000)),
    "a map of many columns": (
        MAP,
        "a.csv",
        lambda path: path.write_text(
            "x_mm,y_mm," + ",".join(f"phi_{k}" for k in range(1, 1500)) + "\n" + ("0,0" + ",1" * 1499 + "\n") * 5300
        ),
    ),
    "readings of empty lines": (
        ("calibrate", "friction", "--out", "plate", "--readings"),
        "a.csv",
        lambda path: path.write_bytes(b"\n" * 60 * MB),
    ),
    "one line of readings": (
        ("calibrate", "friction", "--out", "plate", "--readings"),
        "a.csv",
        lambda path: sparse(path, b"1", 400 * MB),
    ),
    "fingers of a long file": (
        ("simulate", "--seconds", "0.1"),
        "a.csv",
        lambda path: path.write_text(FINGERS + "".join(f"{n}e-4,1,,,\n" for n in range(1_000_000))),
    ),
    "a world of lists": (
        ("simulate", "strokes", "--world"),
        "a.json",
        lambda path: path.write_bytes(b"[" + NESTED * 550 + b"1]"),
    ),
    "a plate of keys": (
        ("simulate", "strokes", "--plate"),
        "a.toml",
        lambda path: path.write_bytes(b"".join(b"a%d={}\n" % n for n in range(7000))),
    ),
    "a configuration of lists": (
        ("run", "--check", "--config"),
        "a.toml",
        lambda path: path.write_bytes(b"a=[" + b"[]," * 21_000 + b"]"),
    ),
    "a key without end": (("service", "keys", "allow", "./"), "a.key", lambda path: sparse(path, b"#", 400 * MB)),
    "a header of lists": (("replay",), "a.mcap", lambda path: headed(path, lists(4_000_000))),
    "a header of maps": (
        ("replay",),
        "a.mcap",
        lambda path: headed(path, b"\xdd" + struct.pack(">I", 4_000_000) + b"\x80" * 4_000_000),
    ),
    "a recording of zeros": (("replay",), "a.mcap", lambda path: sparse(path, b"\x89MCAP0\r\n", 400 * MB)),
    "a recording of chunks": (("replay",), "a.mcap", lambda path: path.write_bytes(b"\6\0\0\0\0\0\0\0\0" * 5 * MB)),
}


def read_in_a_process(*arguments: str) -> dict[str, object]:
    """What it printed and returned, and the peak of its memory."""
    ended = subprocess.run(
        [sys.executable, "-c", CHILD, *arguments], capture_output=True, text=True, timeout=100, check=False
    )
    assert ended.returncode == 0, ended.stderr
    found: dict[str, object] = json.loads(ended.stdout.splitlines()[-1])
    print(f"{found['peak_mb']:.0f} MB, {found['taken_s']:.2f} s: {found['outcome']} {found['printed']}")
    return found


@pytest.mark.parametrize("case", CLIENT)
def test_hostile_content_takes_little_memory_and_at_most_one_sentence(case: str, tmp_path: Path) -> None:
    name, make = CLIENT[case]
    make(tmp_path / name)
    found = read_in_a_process("content", str(tmp_path / name))
    assert found["peak_mb"] < MOST_MB
    if found["outcome"] is None:
        assert str(found["printed"]).count("\n") == 1
        assert name in str(found["printed"])


@pytest.mark.parametrize("case", SERVICE)
def test_a_hostile_file_of_a_command_takes_little_memory_and_is_one_sentence(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command, name, make = SERVICE[case]
    monkeypatch.chdir(tmp_path)
    make(tmp_path / name)
    found = read_in_a_process(*command, *([] if command[-1] == FOLDER else [name]))
    assert found["peak_mb"] < MOST_MB
    assert found["outcome"] != 0
    assert str(found["printed"]).count("\n") == 1
    assert name in str(found["printed"])
