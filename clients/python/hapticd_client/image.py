"""Conversion of pictures to grey levels within the size of a map."""

from __future__ import annotations

import math
import os

from .errors import HapticdError, RefusedError

MAX_PIXELS = 16_000_000  # some 250 MB while it is converted


def grey_rows(path: str | os.PathLike[str], max_side: int, *, is_square: bool = True) -> list[bytes]:
    """Return a picture, or its middle square, as rows of grey levels from the top, at most `max_side` x `max_side`.

    Raises HapticdError without Pillow, RefusedError for a file that is no picture.
    """
    try:
        from PIL import Image, ImageOps, UnidentifiedImageError
    except ImportError:
        raise HapticdError('Pictures need Pillow: run `pip install "clients/python[image]"`.') from None
    try:
        with Image.open(path) as picture:
            picture.draft(None, (2 * max_side, 2 * max_side))  # a JPEG is decoded at a fraction of its size
            if math.prod(picture.size) > MAX_PIXELS:
                width, height = picture.size
                raise RefusedError(
                    f"{os.fspath(path)}: has {width} x {height} pixels, at most {MAX_PIXELS} can be read: reduce it."
                )
            upright = ImageOps.exif_transpose(picture).convert("RGBA")
    except RefusedError:
        raise
    except (UnidentifiedImageError, MemoryError, Image.DecompressionBombError, SyntaxError, ValueError):
        raise RefusedError(f"{os.fspath(path)}: is not a picture that Pillow can read.") from None
    except OSError as error:
        raise RefusedError(f"{os.fspath(path)}: cannot be read ({error.strerror or error}).") from None
    on_black = Image.alpha_composite(Image.new("RGBA", upright.size, "black"), upright).convert("L")
    if is_square:
        side = min(max_side, *on_black.size)
        grey = ImageOps.fit(on_black, (side, side))
    else:
        grey = on_black
        grey.thumbnail((max_side, max_side))
    width, levels = grey.size[0], grey.tobytes()
    return [levels[start : start + width] for start in range(0, len(levels), width)]
