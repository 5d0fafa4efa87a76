"""Mode-map files: a round trip to the last bit, laboratories' own formats, and hostile files refused in a sentence."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.errors import HapticdError, ModesError
from hapticd.formats.mode_map import (
    FORMATS,
    SweptModes,
    decode_grid,
    decode_scan,
    encode_grid,
    read_grid,
    read_scan,
    read_swept,
    require_usable,
    write_swept,
)

HEADER = "x_mm,y_mm,phi_1,phi_2\n"


def uneven_grid(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    x_mm, y_mm = (np.cumsum(random.uniform(0.1, 5.0, count)) - 10.0 for count in (7, 5))
    return x_mm, y_mm, random.standard_normal((2, 5, 7))


def csv_rows(grid: tuple[np.ndarray, np.ndarray, np.ndarray]) -> list[str]:
    return encode_grid(grid, ".csv").decode().splitlines()[1:]


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("seed", range(3))
def test_what_was_saved_is_loaded_to_the_last_bit(tmp_path: Path, suffix: str, seed: int) -> None:
    modes = ModeShapes.from_grid(*uneven_grid(seed))
    path = tmp_path / f"plate{suffix}"

    modes.save(path)
    again = ModeShapes.load(str(path))

    np.testing.assert_array_equal(again.x_mm, modes.x_mm)
    np.testing.assert_array_equal(again.y_mm, modes.y_mm)
    np.testing.assert_array_equal(again.shapes, modes.shapes)


@settings(deadline=None, max_examples=25)
@given(st.randoms(use_true_random=False), st.integers(0, 4))  # 5 may be a whole line of the grid
def test_rows_may_come_in_any_order_and_some_may_be_missing(random: object, missing: int) -> None:
    grid = uneven_grid(1)
    rows = csv_rows(grid)
    random.shuffle(rows)  # type: ignore[attr-defined]
    lost = rows[:missing]

    x_mm, y_mm, shapes = decode_grid((HEADER + "\n".join(rows[missing:])).encode(), ".csv")

    known = np.isfinite(shapes)
    assert np.count_nonzero(~known) == 2 * len(lost)
    np.testing.assert_array_equal(x_mm, grid[0])
    np.testing.assert_array_equal(y_mm, grid[1])
    np.testing.assert_array_equal(shapes[known], grid[2][known])


def test_a_laboratory_s_own_file_is_understood() -> None:
    rows = [
        "\ufeffx_mm, y_mm, phi_1",
        "# scanned on a Tuesday",
        "",
        *(f"{x + 1e-4 * y:.4f}, {y}, {'' if x == y == 0 else x * y}" for y in range(4) for x in range(4)),
    ]

    x_mm, _, shapes = decode_grid("\r\n".join(rows).encode(), ".csv")

    assert x_mm.size == 4  # a position's jitter of less than a micrometre is no line of its own
    assert np.isnan(shapes[0, 0, 0])
    assert shapes[0, 2, 3] == 6.0


def test_a_file_with_gaps_loads_filled_and_reads_with_them(tmp_path: Path) -> None:
    axis_mm = np.linspace(-10.0, 10.0, 6)
    rows = csv_rows((axis_mm, axis_mm, np.add.outer([1.0, 2.0], np.add.outer(axis_mm, axis_mm))))
    path = tmp_path / "plate.csv"
    path.write_text(HEADER + "\n".join(rows[:7] + rows[8:]))

    assert np.isnan(read_grid(path)[2][:, 1, 1]).all()
    np.testing.assert_allclose(ModeShapes.load(path).shapes[:, 1, 1], [-11.0, -10.0], atol=1e-8)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "header"),
        ("x,y,phi_1\n0,0,1\n", "header"),
        ("x_mm;y_mm;phi_1\n0,0;0,0;1,0\n", "with commas between cells and points in numbers"),
        ("x_mm,y_mm\n0,0\n", "header"),
        ("x_mm,y_mm,phi_2,phi_1\n", "header"),
        (HEADER, "no points"),
        (HEADER + "0,0,1,1\n\n1,0,1\n", "line 4 has 3 values, the header 4"),
        (HEADER + "0,0,1,one\n", "line 2 holds something that is not a number"),
        (HEADER + "nan,0,1,1\n", "line 2 has no usable position"),
        (HEADER + "0,,1,1\n", "line 2 has no usable position"),
        (HEADER + "0,0,1,1\n1,0,1,1\n0,1,1,1\n0,0,2,2\n", "line 5 repeats a point of the grid"),
        (HEADER + "".join(f"{x},{x * x},1,1\n" for x in range(5)), "rectangular grid"),
        (HEADER + "".join(f"{x},0,1,1\n" for x in range(5)), "at least 4"),
        (HEADER + "".join(f"{x},{y},inf,1\n" for x in range(4) for y in range(4)), "infinite"),
        ("x_mm,y_mm,re_1,im_1\n0,0,1,1\n", "complex readings"),
        ("#" * (1 << 24) + "\n", "more than 16 MiB"),
    ],
)
def test_a_file_that_is_no_map_is_refused_with_its_name(tmp_path: Path, text: str, what: str) -> None:
    path = tmp_path / "plate.csv"
    path.write_text(text)

    with pytest.raises(ModesError, match=what) as refusal:
        ModeShapes.load(path)

    assert str(refusal.value).startswith(f"{path}: ")
    assert str(refusal.value).count(str(path)) == 1
    assert str(refusal.value).endswith(".")


@pytest.mark.parametrize("name", ["missing.csv", "missing.npz", "plate.txt", "plate"])
def test_a_missing_or_nameless_file_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ModesError, match=name):
        ModeShapes.load(tmp_path / name)


def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(HapticdError, match="cannot be written"):
        ModeShapes.from_grid(*uneven_grid(0)).save(tmp_path / "no-such-directory" / "plate.npz")


@pytest.mark.parametrize(
    ("arrays", "what"),
    [
        ({"x_mm": np.arange(4.0), "shapes": np.ones((1, 4, 4))}, "does not hold x_mm, y_mm, shapes"),
        ({"x_mm": np.arange(4.0), "y_mm": np.arange(4.0), "shapes": np.ones((1, 4, 4), complex)}, "complex shapes"),
        ({"x_mm": np.arange(4.0), "y_mm": np.array(["a"] * 4), "shapes": np.ones((1, 4, 4))}, "not numbers"),
        ({"x_mm": np.array([{}] * 4), "y_mm": np.arange(4.0), "shapes": np.ones((1, 4, 4))}, "not a readable NPZ"),
    ],
)
def test_an_archive_of_something_else_is_refused(tmp_path: Path, arrays: dict[str, np.ndarray], what: str) -> None:
    path = tmp_path / "plate.npz"
    np.savez(path, **arrays)  # type: ignore[arg-type]

    with pytest.raises(ModesError, match=what):
        ModeShapes.load(path)


@given(st.binary(max_size=200), st.sampled_from(FORMATS))
def test_no_bytes_raise_anything_but_a_sentence(data: bytes, suffix: str) -> None:
    for decode in (decode_grid, decode_scan):
        with pytest.raises(ModesError):
            decode(data, suffix)


@given(st.integers(0, 10**6), st.integers(1, 255), st.sampled_from(FORMATS))
def test_a_damaged_file_is_read_or_refused(position: int, flip: int, suffix: str) -> None:
    data = bytearray(encode_grid(uneven_grid(2), suffix))
    data[position % len(data)] ^= flip

    try:
        decode_scan(bytes(data), suffix)
        modes = ModeShapes.from_grid(*decode_grid(bytes(data), suffix))
    except ModesError:
        return
    assert np.isfinite(modes.evaluate(np.zeros((1, 2)))).all()


def test_a_file_of_more_points_than_a_grid_has_is_refused() -> None:
    with pytest.raises(ModesError, match="more than 160000 points"):
        decode_grid(b"x_mm,y_mm,phi_1\n" + b"1,1,1\n" * 160_001, ".csv")


def test_a_line_without_end_is_no_table() -> None:
    with pytest.raises(ModesError, match="no such table"):
        decode_grid(b"x_mm,y_mm,phi_1\n" + b"1" * 20_000, ".csv")


@pytest.mark.parametrize(
    ("member", "packing", "what"),
    [
        (bytes((1 << 24) + 1), zipfile.ZIP_DEFLATED, "more than 16 MiB"),
        (b"", zipfile.ZIP_BZIP2, "not a readable NPZ"),
        (b"\x93NUMPY\x02\x00", zipfile.ZIP_STORED, "not a readable NPZ"),
    ],
)
def test_an_archive_that_numpy_would_not_write_is_refused(member: bytes, packing: int, what: str) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", packing) as archive:
        for name in ("x_mm", "y_mm", "shapes"):
            archive.writestr(f"{name}.npy", member)
    with pytest.raises(ModesError, match=what):
        decode_grid(buffer.getvalue(), ".npz")


# --- scans ------------------------------------------------------------------------------------------------------


def test_every_form_of_a_scan_gives_the_same_readings(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    points_mm = random.uniform(-60.0, 60.0, (50, 2))
    readings = random.standard_normal((50, 2)) + 1j * random.standard_normal((50, 2))
    readings[3, 1] = np.nan
    swept = {"frequency_hz": np.ones(2), "q_factor": np.ones(2), "gain_um_per_v_s": np.eye(2)}
    np.savez(tmp_path / "not_swept.npz", points_mm=points_mm, readings=readings)
    np.savez(tmp_path / "scan.npz", points_mm=points_mm, readings=readings, **swept)  # type: ignore[arg-type]
    forms: dict[str, Callable[[complex], tuple[float, float]]] = {
        "re_1,im_1,re_2,im_2": lambda w: (w.real, w.imag),
        "abs_1,deg_1,abs_2,deg_2": lambda w: (abs(w), float(np.degrees(np.angle(w)))),
    }
    scans = [read_scan(tmp_path / "scan.npz"), read_scan(tmp_path / "not_swept.npz")]
    assert scans[0].swept is not None
    assert scans[0].swept.gain_um_per_v_s.tolist() == [[1.0, 0.0], [0.0, 1.0]]
    for columns, parts in forms.items():
        rows = [
            f'"{x!r}", {y!r},' + ",".join("," if np.isnan(w) else "{!r},{!r}".format(*parts(w)) for w in row)
            for (x, y), row in zip(points_mm.tolist(), readings.tolist(), strict=True)
        ]
        (tmp_path / "scan.csv").write_text("\n".join(["# by hand", "", f"x_mm,y_mm,{columns}", *rows]))
        scans.append(read_scan(tmp_path / "scan.csv"))
    for scan in scans:
        np.testing.assert_allclose(scan.points_mm, points_mm)
        np.testing.assert_allclose(scan.readings, readings, rtol=1e-12, atol=1e-12)


def test_a_grid_of_complex_values_and_a_real_table_are_scans(tmp_path: Path) -> None:
    shapes = np.arange(12.0).reshape(2, 2, 3) * (1 + 2j)
    np.savez(tmp_path / "grid.npz", x_mm=np.arange(3.0), y_mm=np.arange(2.0), shapes=shapes)
    scan = read_scan(tmp_path / "grid.npz")
    assert scan.points_mm.tolist()[4] == [1.0, 1.0]
    assert scan.readings[4].tolist() == [4 + 8j, 10 + 20j]
    scan = decode_scan(b"x_mm,y_mm,phi_1\n1,2,3\n4,5,\n", ".csv")
    assert scan.points_mm.tolist() == [[1.0, 2.0], [4.0, 5.0]]
    assert scan.readings[0, 0] == 3.0
    assert np.isnan(scan.readings[1, 0])


def swept_scan(gain_um_per_v_s: np.ndarray, q_factor: float = 1.0) -> dict[str, np.ndarray]:
    swept = {"frequency_hz": np.ones(2), "q_factor": np.full(2, q_factor), "gain_um_per_v_s": gain_um_per_v_s}
    return {"points_mm": np.zeros((3, 2)), "readings": np.zeros((3, 2)), **swept}


@pytest.mark.parametrize(
    ("arrays", "sentence"),
    [
        ({"x_mm": np.zeros(2)}, "does not hold points_mm, readings nor x_mm"),
        ({"points_mm": np.array(["a"]), "readings": np.zeros(1)}, "not numbers"),
        ({"points_mm": np.zeros((3, 2)), "readings": np.zeros((2, 2))}, r"are \(3, 2\) and \(2, 2\)"),
        ({"points_mm": np.zeros((3, 2), complex), "readings": np.zeros((3, 2))}, "complex positions"),
        ({"x_mm": np.zeros(2), "y_mm": np.zeros(2), "shapes": np.zeros((1, 3, 2))}, "the axes need"),
        (swept_scan(np.eye(3)), "frequency_hz, q_factor, gain_um_per_v_s"),
        (swept_scan(np.full((2, 2), np.nan)), "all finite"),
        (swept_scan(np.eye(2), q_factor=0.0), "all finite"),
    ],
)
def test_arrays_that_are_no_scan_are_refused(tmp_path: Path, arrays: dict[str, np.ndarray], sentence: str) -> None:
    np.savez(tmp_path / "scan.npz", **arrays)  # type: ignore[arg-type]
    with pytest.raises(ModesError, match=sentence):
        read_scan(tmp_path / "scan.npz")


# --- what can be read, and not used ---


AXIS_MM = np.linspace(-60.0, 60.0, 9)
SLOPES = np.stack(np.meshgrid(AXIS_MM, AXIS_MM)) / 60.0
ZERO_MODE = np.stack([SLOPES[0], np.zeros((9, 9))])


@pytest.mark.parametrize(
    ("x_mm", "y_mm", "shapes", "sentence"),
    [
        (AXIS_MM * 1e-3, AXIS_MM, SLOPES, "x_mm runs from -0.06 to 0.06 on a plate of 137.5 mm; give positions in mm"),
        (AXIS_MM, AXIS_MM + 60.0, SLOPES, "y_mm runs from 0 to 120 on a plate of 137.5 mm"),
        (AXIS_MM - 15.0, AXIS_MM, SLOPES, "x_mm runs from -75 to 45"),
        (AXIS_MM, AXIS_MM, ZERO_MODE, "mode 2 is zero everywhere"),
        (AXIS_MM, AXIS_MM, np.stack([*SLOPES, -3.0 * SLOPES[0]]), "modes 1 and 3 have the same shape"),
    ],
)
def test_a_map_off_the_plate_of_zeros_or_with_one_shape_twice_is_refused(
    x_mm: npt.NDArray[np.float64], y_mm: npt.NDArray[np.float64], shapes: npt.NDArray[np.float64], sentence: str
) -> None:
    with pytest.raises(ModesError, match=re.escape(sentence)):
        require_usable((x_mm, y_mm, shapes), (137.5, 137.5))


def test_a_map_that_is_shifted_a_little_or_is_of_one_mode_is_used() -> None:
    require_usable((AXIS_MM + 12.0, AXIS_MM - 12.0, SLOPES[:1]), (137.5, 137.5))


def test_a_table_that_is_no_csv_is_refused_with_its_line() -> None:
    with pytest.raises(ModesError, match="quotes"):  # a cell that does not end
        decode_scan(b'x_mm,y_mm,phi_1\n"' + 200 * (b"1" * 1000 + b"\n"), ".csv")


def test_a_sweep_s_first_modes_are_read_back_and_more_than_it_has_are_refused(tmp_path: Path) -> None:
    swept = SweptModes(np.array([29100.0, 29200.0, 29300.0]), np.full(3, 500.0), np.arange(6.0).reshape(3, 2))
    write_swept(tmp_path / "sweep.npz", swept)
    for read, count in ((read_swept(tmp_path / "sweep.npz"), 3), (read_swept(tmp_path / "sweep.npz", 2), 2)):
        assert [one.tolist() for one in read] == [one[:count].tolist() for one in swept]
    with pytest.raises(ModesError, match="has 4 modes: scan those of the sweep, in its order, 29100, 29200, 29300"):
        read_swept(tmp_path / "sweep.npz", 4)
