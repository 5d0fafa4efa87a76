"""Scans in universal files: written by pyuff, read as the same points and readings, and damaged ones are refused."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.errors import HapticdError, ModesError
from hapticd.tools.calibrate import modes
from hapticd.tools.calibrate.universal_file import read_universal, scan_of

pyuff = pytest.importorskip("pyuff")

POINTS_MM = np.array([[-60.0, -40.0], [0.0, 12.5], [55.5, 40.0]])
READINGS = np.array([[1.0 + 0.5j, -0.25j], [-0.5 + 0.1j, 2.0 + 0j], [0.25 + 0j, -1.0 + 0.2j]])
AWAY = 0.1  # of the peak, at the frequencies beside it
PER_METRE = 1000.0  # of a file in mm


def functions(**record: Any) -> list[dict[str, Any]]:
    """Spectra of three lines at each point, with two amplifiers as references, largest at the second line."""
    return [
        pyuff.prepare_58(
            binary=record.get("binary", 0),
            id1="scan",
            func_type=record.get("func_type", 4),
            rsp_node=node + 1,
            rsp_dir=record.get("rsp_dir", 3),
            ref_node=record.get("ref_node", 101 + mode),
            ref_dir=3,
            load_case_id=0,
            rsp_ent_name="NONE",
            ref_ent_name="NONE",
            ord_data_type=6,
            num_pts=3,
            abscissa_spacing=1,
            abscissa_min=29195.0,
            abscissa_inc=10.0,
            abscissa_spec_data_type=18,
            ordinate_spec_data_type=8,
            orddenom_spec_data_type=13,
            x=np.array([29195.0, 29205.0, 29215.0]),
            data=READINGS[node, mode] * np.array([AWAY, 1.0, AWAY]),
        )
        for mode in range(2)
        for node in range(3)
    ]


def nodes(per_metre: float = PER_METRE) -> list[dict[str, Any]]:
    x, y = POINTS_MM.T * 1e-3 * per_metre
    geometry = pyuff.prepare_15(node_nums=[1, 2, 3], x=x, y=y, z=np.zeros(3))
    units = pyuff.prepare_164(
        units_code=9,
        units_description="USER",
        temp_mode=1,
        length=per_metre,
        force=1.0,
        temp=1.0,
        temp_offset=0.0,
    )
    return [units, geometry]


def written(folder: Path, sets: list[dict[str, Any]], name: str = "scan.uff") -> Path:
    path = folder / name
    pyuff.UFF(str(path)).write_sets(sets, "overwrite")
    return path


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff writes one with files left open
@pytest.mark.parametrize(
    ("sets", "readings"),
    [
        *(([*nodes(per_metre), *functions()], READINGS) for per_metre in (1.0, 1000.0, 39.37007874)),
        ([*nodes(), *functions(binary=1)], READINGS),
        ([*nodes(), *functions(ref_node=101)], READINGS),
        ([*nodes(), *functions(rsp_dir=-3)], -READINGS),
        ([nodes(1.0)[1], *functions()[1:]], np.where(np.eye(3, 2) * [[1], [0], [0]] > 0, np.nan, READINGS)),
    ],
    ids=["m", "mm", "in", "binary", "a reference again is the next mode", "the other face", "metres, a lost point"],
)
def test_points_and_readings_come_back_in_mm_with_a_mode_for_each_reference(
    sets: list[dict[str, Any]], readings: npt.NDArray[np.complex128], tmp_path: Path
) -> None:
    scan, _ = read_universal(written(tmp_path, sets))
    np.testing.assert_allclose(scan.points_mm, POINTS_MM, atol=1e-3)
    np.testing.assert_allclose(scan.readings, readings, atol=1e-9)


OTHERS = {6: "coherence", 2: "auto spectrum", 9: "power spectral density", 3: "cross spectrum"}


@pytest.mark.parametrize(
    ("kinds", "left_out"),
    [((4, *OTHERS), OTHERS.values()), ((3, 6), ["coherence"])],
    ids=["frequency responses first", "else cross spectra"],
)
def test_functions_beside_the_scans_are_counted_by_what_they_are(
    kinds: tuple[int, ...], left_out: Iterable[str], tmp_path: Path
) -> None:
    others = [one for kind in kinds for one in functions(func_type=kind)]
    along = functions(func_type=kinds[0], rsp_dir=1)
    scan, found = read_universal(written(tmp_path, [*nodes(), *others, *along]))
    np.testing.assert_allclose(scan.readings, READINGS, atol=1e-9)
    assert found == {**dict.fromkeys(left_out, 6), "response along the plate": 6}


@pytest.mark.parametrize(("unit", "per_metre"), [("mm", 1000.0), ("cm", 100.0), ("in", 39.37007874)])
def test_positions_without_units_that_are_no_metres_need_the_unit(unit: str, per_metre: float, tmp_path: Path) -> None:
    path = written(tmp_path, [nodes(per_metre)[1], *functions()])
    with pytest.raises(ModesError, match=r"scan\.uff.*metres.*--unit mm"):
        read_universal(path)
    np.testing.assert_allclose(read_universal(path, unit).scan.points_mm, POINTS_MM, atol=1e-3)


def test_the_modes_step_reads_a_universal_file(tmp_path: Path) -> None:
    path = written(tmp_path, [nodes(1000.0)[1], *functions()], "SCAN.UNV")
    scan, _ = modes._read(argparse.Namespace(scan=path, unit="mm"))
    assert scan.readings.shape == (3, 2)


@pytest.mark.parametrize(
    ("sets", "said"),
    [
        (functions(), "holds no nodes"),
        (nodes(), "holds no nodes"),
        ([*nodes(), *functions(rsp_dir=1)], "but response along the plate"),
        ([*nodes(), *functions(func_type=6)], "no frequency responses .*but coherence"),
        ([{**nodes()[1], "node_nums": [1, 2, 9]}, *functions()], "has no position of node 3"),
        ([nodes()[0] | {"length": 0.0}, nodes()[1], *functions()], "no usable unit of length"),
        ([nodes()[1] | {"x": [np.nan, 0.0, 0.0]}, *functions()], "without a usable position"),
        ([*nodes(), functions()[0] | {"data": [1.0]}, *functions()[1:]], "different lengths"),
        ([*nodes(), *(one | {"data": []} for one in functions())], "without values"),
    ],
)
def test_what_is_missing_is_said(sets: list[dict[str, Any]], said: str) -> None:
    with pytest.raises(ModesError, match=said):
        scan_of(sets)


def test_damaged_bytes_never_raise_anything_else(tmp_path: Path) -> None:
    whole = written(tmp_path, [*nodes(), *functions()]).read_bytes()
    random = np.random.default_rng(3)
    path = tmp_path / "damaged.uff"
    for _ in range(60):
        data = bytearray(whole[: int(random.integers(len(whole)))])
        for at in random.integers(len(data), size=8) if data else ():
            data[at] = int(random.integers(256))
        path.write_bytes(data)
        with contextlib.suppress(ModesError):
            read_universal(path)


def test_a_missing_file_and_a_missing_library_get_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ModesError, match="cannot be read"):
        read_universal(tmp_path / "none.uff")
    monkeypatch.setitem(__import__("sys").modules, "pyuff", None)
    with pytest.raises(HapticdError, match="A universal file \\(UFF\\) needs pyuff"):
        read_universal(tmp_path / "none.uff")
