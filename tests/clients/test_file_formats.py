"""Pictures, sounds and JSON as other programs write them: the right value, or the true reason in one sentence."""

from __future__ import annotations

import json
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from hapticd_client import Map, RefusedError, content
from hapticd_client.asset import asset_of
from hapticd_client.content.document import Document
from hapticd_client.image import grey_of

# --- pictures ---------------------------------------------------------------------------------------------------

GREY, RGB, PALETTE, GREY_ALPHA, RGB_ALPHA = 0, 2, 3, 4, 6  # colour types of PNG


def png(bits: int, colour: int, width: int, row: bytes, transparent: bytes = b"", palette: bytes = b"") -> bytes:
    """A PNG of one row."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    parts = [(b"IHDR", struct.pack(">IIBBBBB", width, 1, bits, colour, 0, 0, 0)), (b"PLTE", palette)]
    parts += [(b"tRNS", transparent), (b"IDAT", zlib.compress(b"\0" + row)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts if part[1] or part[0] == b"IEND")


def words(*values: int) -> bytes:
    return struct.pack(f">{len(values)}H", *values)


WHITE = 65535
PNGS = {
    "16 bits of grey": (png(16, GREY, 4, words(0, 257, 25700, WHITE)), [0, 1, 100, 255]),
    "16 bits, rounded": (png(16, GREY, 4, words(128, 129, 32768, WHITE - 129)), [0, 1, 128, 254]),
    "16 bits, one transparent": (png(16, GREY, 3, words(25700, 25701, WHITE), words(WHITE)), [100, 100, 0]),
    "16 bits of colour": (png(16, RGB, 2, words(*[25700] * 3, *[WHITE] * 3)), [100, 255]),
    "16 bits of colour, one transparent": (
        png(16, RGB, 2, words(*[25700] * 3, *[51200] * 3), words(*[51200] * 3)),
        [100, 0],
    ),
    "16 bits and alpha": (png(16, GREY_ALPHA, 2, words(25700, WHITE, WHITE, 25700)), [100, 100]),
    "16 bits of colour and alpha": (png(16, RGB_ALPHA, 2, words(*[25700] * 3, WHITE, *[WHITE] * 3, 0)), [100, 0]),
    "8 bits, one transparent": (png(8, GREY, 3, bytes([0, 100, 255]), words(100)), [0, 0, 255]),
    "4 bits, one transparent": (png(4, GREY, 2, b"\x5f", words(15)), [85, 0]),
    "2 bits, one transparent": (png(2, GREY, 4, b"\x1b", words(2)), [0, 85, 0, 255]),
    "1 bit, one transparent": (png(1, GREY, 2, b"\x40", words(1)), [0, 0]),
    "a palette of alphas": (png(8, PALETTE, 2, b"\0\1", b"\x80\xff", b"\xff\xff\xff\x64\x64\x64"), [128, 100]),
}


@pytest.mark.parametrize("name", PNGS)
def test_a_png_of_any_depth_has_its_levels_wherever_it_is_read(name: str, tmp_path: Path) -> None:
    data, levels = PNGS[name]
    path = tmp_path / "a.png"
    path.write_bytes(data)
    (layer,) = content.load(path, width_mm=10.0).layers
    assert list(layer.levels[0]) == levels
    middle = levels[len(levels) // 2 - 1 : len(levels) // 2 + 1]  # each has the middle square, of one pixel
    for found in (asset_of(path).levels, Map.from_image(path, high_um=1.0).message.levels):
        assert min(middle) - 1 <= found[0] <= max(middle) + 1


PIXELS: dict[str, tuple[int | tuple[int, ...], int]] = {
    "1": (255, 255),
    "L": (100, 100),
    "LA": ((100, 51), 20),
    "P": (100, 100),
    "RGB": ((100, 100, 100), 100),
    "RGBA": ((100, 100, 100, 51), 20),
    "CMYK": ((0, 0, 0, 155), 100),
    **dict.fromkeys(("I;16", "I;16B", "I;16L", "I;16N"), (25700, 100)),
}


@pytest.mark.parametrize("mode", Image.MODES)
def test_each_mode_of_pillow_has_its_grey_level_or_is_refused_by_name(mode: str) -> None:
    pixel, level = PIXELS.get(mode, (None, None))
    picture = Image.new(mode, (1, 1), pixel or 0)
    if mode == "P":
        picture.putpalette([grey for grey in range(256) for _ in range(3)])
    if level is None:
        with pytest.raises(RefusedError, match=rf"a\.png: .*\b{mode}\b.*8 or 16 bits"):
            grey_of(picture, "a.png")
    else:
        assert list(grey_of(picture, "a.png").tobytes()) == [level]


# --- sounds -----------------------------------------------------------------------------------------------------

RATE_HZ = 8000
SAMPLES = np.round(20000 * np.sin(2 * np.pi * 100 * np.arange(RATE_HZ) / RATE_HZ)).astype("<i2")
PCM16, PCM24 = SAMPLES.tobytes(), (SAMPLES.astype("<i4") << 8).view(np.uint8).reshape(-1, 4)[:, :3].tobytes()
LIST = b"LIST" + struct.pack("<I", 8) + b"INFO\x7f\x7f\x7f\x7f"
GUID = b"\x00\x00\x00\x00\x10\x00\x80\x00\x00\xaa\x00\x38\x9b\x71"  # of a subformat, after its number


def form(tag: int = 1, bits: int = 16, *, channels: int = 1, extension: bytes = b"", frame_bytes: int = 0) -> bytes:
    frame_bytes = frame_bytes or channels * bits // 8
    plain = struct.pack("<HHIIHH", tag, channels, RATE_HZ, RATE_HZ * frame_bytes, frame_bytes, bits) + extension
    return b"fmt " + struct.pack("<I", len(plain)) + plain


def extensible(tag: int, bits: int, valid_bits: int) -> bytes:
    return form(0xFFFE, bits, extension=struct.pack("<HHIH", 22, valid_bits, 4, tag) + GUID)


def riff(
    *chunks: bytes, data: bytes = PCM16, data_bytes: int | None = None, riff_bytes: int | None = None, **more: bytes
) -> bytes:
    """A WAV file; its sizes are true where none are given."""
    head = b"WAVE" + b"".join(chunks or (form(),)) + b"data"
    body = head + struct.pack("<I", len(data) if data_bytes is None else data_bytes) + data + more.get("after", b"")
    return more.get("magic", b"RIFF") + struct.pack("<I", len(body) if riff_bytes is None else riff_bytes) + body


def ds64(data_bytes: int) -> bytes:
    return b"ds64" + struct.pack("<IQQQI", 28, 1 << 40, data_bytes, len(SAMPLES), 0)


UNKNOWN = (0, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
LONG = 0xFFFFFFFF
SOUNDS = {
    "extensible, 16 bits": riff(extensible(1, 16, 16)),
    "extensible, 24 bits": riff(extensible(1, 24, 24), data=PCM24),
    "extensible, 20 of 24 bits": riff(extensible(1, 24, 20), data=PCM24),
    "24 bits": riff(form(bits=24), data=PCM24),
    "chunks around": riff(LIST, form(), LIST, after=LIST),
    **{f"streamed, {size:#x}": riff(data_bytes=size, riff_bytes=size) for size in UNKNOWN},
    **{f"streamed, only data, {size:#x}": riff(data_bytes=size) for size in UNKNOWN[1:]},
    "streamed, as Python writes it": riff(data_bytes=0, riff_bytes=36),
    "size of RIFF 0": riff(riff_bytes=0, after=LIST),
    "RF64": riff(ds64(len(PCM16)), form(), data_bytes=LONG, riff_bytes=LONG, magic=b"RF64", after=LIST),
    "BW64": riff(ds64(len(PCM16)), form(), data_bytes=LONG, riff_bytes=LONG, magic=b"BW64", after=LIST),
    "RF64 without sizes": riff(data_bytes=LONG, riff_bytes=LONG, magic=b"RF64"),
    "RF64 beyond its end": riff(ds64((1 << 64) - 1), form(), data_bytes=LONG, riff_bytes=LONG, magic=b"RF64"),
}


def loaded(path: Path, data: bytes) -> content.Score:
    path.write_bytes(data)
    return content.load(path)


@pytest.mark.parametrize("name", SOUNDS)
def test_a_sound_is_felt_the_same_whatever_program_wrote_its_head(name: str, tmp_path: Path) -> None:
    assert loaded(tmp_path / "a.wav", SOUNDS[name]) == loaded(tmp_path / "a.wav", riff())


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (riff(form(3, 32)), "a.wav: has samples of floating point: save it as 16 bit."),
        (riff(form(85, 16)), "a.wav: has samples of MP3: save"),
        (riff(form(bits=64)), "a.wav: has samples of 64 bits in frames of 8 bytes"),
        (riff(form(channels=0, frame_bytes=2)), "a.wav: has 0 channels"),
        (riff(LIST), "a.wav: has no format (chunk 'fmt ') before its samples"),
        (riff(b"fmt \x04\0\0\0\1\0\1\0"), "a.wav: has no format"),
        (riff()[:36], "a.wav: has no samples (chunk 'data')"),
        (riff(data=b"", after=LIST), "a.wav: has no sound."),
        (b"OggS" + riff(), "a.wav: is not a WAV file: it begins with b'OggS"),
        (b"RIFF\0\0\0\0AVI ", "a.wav: is not a WAV file: it begins with b'RIFF\\x00\\x00\\x00\\x00AVI '."),
    ],
)
def test_a_sound_that_cannot_be_read_is_refused_with_the_cause(data: bytes, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(RefusedError, match="^.*" + re.escape(sentence)):
        loaded(tmp_path / "a.wav", data)


# --- JSON -------------------------------------------------------------------------------------------------------

TEXT = '{"Pattern": [{"Event": {"Time": 0.5, "EventType": "HapticTransient"}}], "é": "//,] /* \\",}"}'
LENIENT = {
    "trailing commas": TEXT.replace("}}]", ",\n},} ,\t]"),
    "line comments": "// Pattern, [\n" + TEXT.replace('[{"', '[ // "one\n{"'),
    "block comments": TEXT.replace('[{"', '[/*\n"two */{"') + "/**/",
    "a comment after a comma": TEXT.replace("}}]", "}}, // the last\n /* , */ ]"),
}


@pytest.mark.parametrize("suffix", ["ahap", "hjif"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("name", [None, *LENIENT])
def test_json_with_commas_comments_and_any_encoding_is_what_it_is_without(
    name: str | None, encoding: str, suffix: str, tmp_path: Path
) -> None:
    path = tmp_path / f"a.{suffix}"
    path.write_bytes((LENIENT[name] if name else TEXT).encode(encoding))
    document = Document.read(path)
    assert [one.object("Event").number("Time") for one in document.objects("Pattern")] == [0.5]
    assert document.text("é") == json.loads(TEXT)["é"]


@pytest.mark.parametrize(
    ("data", "place", "reason"),
    [
        (b'{"a": 1,\n "b": }', "line 2, column 7", "Expecting value"),
        (b'// one\n{"a": [1, 2,], /* two\n*/ "b" 3}', "line 3, column 8", "':'"),
        (b'{,"a": 1}', "line 1, column 2", "property name"),
        (b"{} /* open", "line 1, column 4", "Extra data"),
        (b"{} /*/ ", "line 1, column 4", "Extra data"),
        (b"{'a': 1}", "line 1, column 2", "double quotes"),
        (b'{"a": 1,\n "b": "open}', "line 2, column 7", "Unterminated string"),
        (b'{"a": 1\n "b": 0x10}', "line 2, column 2", "','"),
        ('{"a": 1,\n,}'.encode("utf-16"), "line 2, column 1", "property name"),
        (b'{"a": "\xe9"}', "byte 8", "UTF-8"),
        (b"[" * 100_000, "", "nested"),
        (b"[1" + b"0" * 5000 + b"]", "", "digits"),
    ],
)
def test_what_is_not_json_is_refused_with_place_and_reason(
    data: bytes, place: str, reason: str, tmp_path: Path
) -> None:
    (tmp_path / "a.hjif").write_bytes(data)
    with pytest.raises(RefusedError) as refused:
        content.load(tmp_path / "a.hjif")
    assert f"a.hjif: is not JSON ({place}" in str(refused.value)
    assert reason in str(refused.value)
