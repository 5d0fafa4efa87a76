"""Maps from arrays and pictures: what is felt where, and what is no map."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from hapticd_client import Map, RefusedError

CLIENT = Path(__file__).parents[2] / "clients" / "python"


def levels(image: Map) -> np.ndarray[Any, np.dtype[np.uint8]]:
    sent = image.message
    return np.frombuffer(sent.levels, dtype=np.uint8).reshape(sent.height, sent.width)


# --- arrays -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rows_um", "sentence"),
    [
        ([[math.nan]], "out of bounds"),
        ([[math.inf]], "out of bounds"),
        ([[-0.1]], "out of bounds"),
        ([[1.0, 1000.1]], "out of bounds"),
        ([[]], "no pixels"),
        (np.ones((129, 2)), "map: "),
        ([[1.0], [1.0, 2.0]], "map: "),
    ],
)
def test_an_array_that_is_no_map_is_refused(rows_um: Any, sentence: str) -> None:
    with pytest.raises(RefusedError, match=sentence):
        _ = Map.from_um(rows_um).message


def test_the_library_does_not_load_numpy_or_pillow() -> None:
    code = "import sys, hapticd_client; hapticd_client.Map.from_um([[1.0]]); print({'numpy', 'PIL'} & {*sys.modules})"
    command = [sys.executable, "-c", code]
    loaded = subprocess.run(command, cwd=CLIENT, capture_output=True, text=True, check=True)
    assert loaded.stdout == "set()\n"


# --- pictures ---------------------------------------------------------------------------------------------------


def saved(tmp_path: Path, picture: Image.Image, name: str = "picture.png", **options: Any) -> Path:
    path = tmp_path / name
    picture.save(path, **options)
    return path


@pytest.mark.parametrize("size", [(300, 200), (200, 300)])
def test_of_a_photograph_the_middle_square_is_felt_as_finely_as_a_map_can(
    size: tuple[int, int], tmp_path: Path
) -> None:
    picture = Image.new("RGB", size, "black")
    picture.paste("white", (size[0] // 2 - 100, size[1] // 2 - 100, size[0] // 2 + 100, size[1] // 2 + 100))
    image = Map.from_image(saved(tmp_path, picture, "photo.jpg", quality=95), high_um=1.0)
    assert levels(image).shape == (128, 128)
    assert levels(image).min() > 240


def test_a_picture_lies_as_the_camera_was_held(tmp_path: Path) -> None:
    picture = Image.new("L", (4, 4), 0)
    picture.putpixel((0, 0), 255)
    exif = Image.Exif()
    exif[0x0112] = 6  # taken with the camera turned: the first row is the right side
    grey = levels(Map.from_image(saved(tmp_path, picture, exif=exif), high_um=1.0))
    assert list(zip(*np.nonzero(grey), strict=True)) == [(0, 3)]


def test_a_file_that_is_no_picture_is_one_sentence(tmp_path: Path) -> None:
    whole = saved(tmp_path, Image.effect_noise((64, 64), 50.0)).read_bytes()
    for name, data in (("text.png", b"hello"), ("empty.png", b""), ("cut.png", whole[: len(whole) // 2])):
        path = tmp_path / name
        path.write_bytes(data)
        with pytest.raises(RefusedError, match=name):
            Map.from_image(path, high_um=1.0)
