"""Content from files that people have: pictures, sounds, and haptic patterns of telephones and of MPEG.

    from hapticd_client import Client, content

    with Client() as plate:
        content.load("click.ahap").play(plate)

Every finger on the plate feels it. Each kind of thing that is left out, or felt in another way, is a DroppedWarning;
clients/python/CONTENT.md lists them.
"""

from __future__ import annotations

import io
import os
from importlib.util import find_spec
from pathlib import Path
from tokenize import TokenError
from typing import Any

from hapticd_contract.contents import MAX_ASSET_SIDE

from ..errors import RefusedError, missing_library
from ..regular_file import read_bounded
from .dropped import DroppedWarning
from .pixels import layer_of
from .score import Layer, Score, Timed
from .track import Track

__all__ = ["SUFFIXES", "DroppedWarning", "Layer", "Score", "Timed", "load", "picture"]

PICTURES = (".png", ".jpg", ".jpeg")
SUFFIXES = (*PICTURES, ".npy", ".wav", ".ahap", ".hjif")
DEFAULT_UM = 1.5
MAX_ARRAY_BYTES = MAX_ASSET_SIDE**2 + (1 << 16)  # with its head


def load(
    path: str | os.PathLike[str],
    *,
    high_um: float = DEFAULT_UM,
    is_friction: bool = False,
    width_mm: float | None = None,
) -> Score:
    """Return the content of a file, by its suffix. Raises RefusedError with one sentence, HapticdError without a
    library that it needs.

    `is_friction` and `width_mm` are for pictures and arrays: white is slippery, black is bare glass.
    """
    suffix, name = Path(path).suffix.lower(), Path(path).name
    if suffix not in SUFFIXES:
        raise RefusedError(f"{os.fspath(path)}: must end in one of {', '.join(SUFFIXES)}.")
    if suffix in (*PICTURES, ".npy"):
        source = _array(path) if suffix == ".npy" else path
        return picture(source, high_um=None if is_friction else high_um, width_mm=width_mm, title=name)
    if is_friction or width_mm is not None:
        raise RefusedError(f"{os.fspath(path)}: a width and friction are for pictures.")
    layers: list[Layer] = []
    if suffix == ".hjif":
        from . import hjif

        track, layers = hjif.read(path, high_um)
    elif suffix == ".ahap":
        from . import ahap

        track = ahap.track_of(path)
    else:
        _require_numpy("Sounds")
        from . import sound

        track = sound.track_of(path)
    return _score(name, track, layers, high_um)


def picture(source: Any, *, title: str = "picture", **arguments: Any) -> Score:
    """Return a picture file or an array of levels as content; arguments as of `layer_of`."""
    layer = layer_of(source, **arguments)
    return Score(f"{title}: a map of {len(layer.levels[0])} x {len(layer.levels)}", (layer,))


def _score(name: str, track: Track, layers: list[Layer], high_um: float) -> Score:
    effects = tuple(track.effects(high_um, name))
    if not effects and not layers:
        raise RefusedError(f"{name}: has nothing that a plate can play.")
    what = [f"{len(layers)} layers"] * bool(layers) + [f"{track.length_s:.2f} s of effects"] * bool(effects)
    return Score(f"{name}: {' and '.join(what)}", tuple(layers), effects, track.length_s)


def _require_numpy(what: str) -> None:
    if find_spec("numpy") is None:
        raise missing_library(f"{what} need NumPy", "content")


def _array(path: str | os.PathLike[str]) -> Any:
    _require_numpy("Arrays")
    import numpy as np

    try:
        file = io.BytesIO(read_bounded(path, MAX_ARRAY_BYTES))
        if np.lib.format.read_magic(file) != (1, 0):
            raise ValueError("an array of plain numbers has this version")
        shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(file)
        if dtype.hasobject:
            raise ValueError("numbers only")
        array = np.frombuffer(file.read(), dtype).reshape(shape, order="F" if is_fortran else "C")
    except OSError as error:
        raise RefusedError(f"{os.fspath(path)}: cannot be read ({error.strerror or 'no array'}).") from None
    except (ValueError, EOFError, SyntaxError, TokenError, TypeError, ArithmeticError, MemoryError, RecursionError):
        raise RefusedError(f"{os.fspath(path)}: is not an array that NumPy can read.") from None
    if array.ndim != 2 or array.dtype != np.uint8 or 0 in array.shape:
        raise RefusedError(f"{os.fspath(path)}: must be a two-dimensional array of uint8, 0 .. 255.")
    if max(array.shape) > MAX_ASSET_SIDE:
        raise RefusedError(f"{os.fspath(path)}: must have at most {MAX_ASSET_SIDE} x {MAX_ASSET_SIDE} levels.")
    return array
