"""Conversion of pictures to grey levels within the size of a map."""

from __future__ import annotations

import io
import math
import os
import warnings
from typing import Any

from .errors import RefusedError, missing_library
from .regular_file import read_bounded

FORMATS = ("PNG", "JPEG")  # others of Pillow start programs, such as Ghostscript
MAX_BYTES = 50_000_000
MAX_PIXELS = 16_000_000  # some 150 MB while it is converted
MAX_JPEG_PIXELS = 64_000_000  # of a JPEG that is decoded at a fraction of its size
MAX_SCANS = 50  # of a JPEG, each of which goes over all of it: programs write ten
_SCAN = b"\xff\xda"
_MODES = ("1", "L", "LA", "P", "RGB", "RGBA", "CMYK")  # of 8 bits at most, which Pillow converts without loss


def grey_rows(path: str | os.PathLike[str], max_side: int, *, is_square: bool = True) -> list[bytes]:
    """Return a PNG or JPEG, or its middle square, as rows of grey levels from the top, at most `max_side` x `max_side`.

    Raises HapticdError without Pillow, RefusedError for a file that is no such picture.
    """
    try:
        from PIL import Image, ImageOps, UnidentifiedImageError
    except ImportError:
        raise missing_library("Pictures need Pillow", "image") from None
    try:
        data = read_bounded(path, MAX_BYTES)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # of more pixels than are taken here
            with Image.open(io.BytesIO(data), formats=FORMATS) as picture:
                _check_size(picture, data, max_side, os.fspath(path))
                grey = ImageOps.exif_transpose(grey_of(picture, os.fspath(path)))
    except RefusedError:
        raise
    except (UnidentifiedImageError, MemoryError, Image.DecompressionBombError, SyntaxError, ValueError):
        raise RefusedError(f"{os.fspath(path)}: is not a PNG or JPEG that Pillow can read.") from None
    except OSError as error:
        raise RefusedError(f"{os.fspath(path)}: cannot be read ({error.strerror or error}).") from None
    if is_square:
        side = min(max_side, *grey.size)
        grey = ImageOps.fit(grey, (side, side))
    else:
        grey.thumbnail((max_side, max_side))
    width, levels = grey.size[0], grey.tobytes()
    return [levels[start : start + width] for start in range(0, len(levels), width)]


def _check_size(picture: Any, data: bytes, max_side: int, path: str) -> None:
    """Have a JPEG decoded at a fraction of its size, and raise RefusedError for what takes too long or too much."""
    width, height = picture.size
    most = MAX_PIXELS
    if picture.format != "PNG":
        scans = data.count(_SCAN)
        if scans > MAX_SCANS:
            raise RefusedError(f"{path}: has {scans} scans, at most {MAX_SCANS} can be read: save it as a usual JPEG.")
        if not picture.info.get("progressive"):  # a progressive one is in memory as a whole
            picture.draft(None, (2 * max_side, 2 * max_side))
            most = MAX_JPEG_PIXELS
    if width * height > most or math.prod(picture.size) > MAX_PIXELS:
        raise RefusedError(f"{path}: has {width} x {height} pixels, at most {most} can be read: reduce it.")


def grey_of(picture: Any, path: str) -> Any:
    """Return a picture's levels of grey, 0 .. 255, on black where it is transparent; without a copy in colour, which
    takes four times as much. Raises RefusedError for a mode of another range."""
    from PIL import ImageChops

    transparent = picture.info.get("transparency")
    if picture.mode.startswith("I;16"):  # which Pillow would clip at 255
        table = [0 if level == transparent else round(level / 257) for level in range(1 << 16)]
        return picture.convert("I").point(table, "L")
    if picture.mode not in _MODES:
        raise RefusedError(
            f"{path}: has pixels of Pillow's mode {picture.mode}: save it with 8 or 16 bits per channel."
        )
    # Pillow scales the levels to 8 bits, and leaves the transparent one as it is in the file.
    rawmode = picture.tile[0][3] if getattr(picture, "tile", ()) else ""
    if isinstance(transparent, int):
        picture.info["transparency"] = transparent * {"L;2": 85, "L;4": 17}.get(rawmode, 1)
    elif isinstance(transparent, tuple) and rawmode == "RGB;16B":
        picture.info["transparency"] = tuple(level >> 8 for level in transparent)
    if not picture.has_transparency_data:
        return picture.convert("L")
    levels = picture.convert("LA") if picture.mode in ("L", "1") else picture.convert("RGBA")
    return ImageChops.multiply(levels.convert("L"), levels.getchannel("A"))
