"""The felt iteration as machine code gives the bits of the Python that it was translated from."""

from __future__ import annotations

import importlib
import importlib.util
from array import array
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import hapticd
from hapticd.compiled import why_interpreted
from hapticd.core.friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.solver.felt import counted_jnd

SOURCE = Path(hapticd.__file__).parent / "core" / "solver" / "felt_descent.py"
CURVES = (DEFAULT_FRICTION_CURVE, FrictionCurve.from_amplitudes((0.0, 0.1, 0.3, 0.8, 1.4), 0.12))


def as_python() -> ModuleType:
    spec = importlib.util.spec_from_file_location("hapticd.core.solver.felt_descent_py", SOURCE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def machine_code() -> ModuleType:
    module = importlib.import_module("hapticd.core.solver.felt_descent")
    if not str(module.__file__).endswith(EXTENSION_SUFFIXES[0]):
        pytest.skip(f"Python runs: {why_interpreted()}")
    return module


def called(module: ModuleType, seed: int) -> list[list[float]]:
    """What a call returns and changes, for a random problem of up to 6 fingers on up to 8 modes."""
    random = np.random.default_rng(seed)
    fingers, modes, points = int(random.integers(1, 7)), int(random.integers(1, 9)), int(random.integers(1, 13))
    scale = float(random.choice([1.0, 1.0, 1.0, 0.0, 1e-200, 1e120, np.nan]))
    curve = CURVES[seed % 2]
    shapes = (scale * random.uniform(-1, 1, (fingers * points, modes))).tobytes()
    d_um, q_um = random.normal(size=(2, modes)).tolist()
    frictions = random.choice([1.0, 0.9, 0.8, 0.5, 0.24, curve.floor_frac], fingers).tolist()
    counted = counted_jnd(frictions, random.integers(0, 4, fingers).tolist())
    logs = random.normal(size=fingers).tolist()
    found: Any = module.descend(
        shapes,
        [1.0 / points] * points,
        frictions,
        counted,
        random.choice([1.0, 1.6], fingers).tolist(),
        curve.pieces,
        (curve.full_um, curve.floor_frac),
        tuple((10.0 ** random.uniform(-3, 1, modes)).tolist()),
        d_um,
        q_um,
        logs,
        int(random.integers(0, 5)),
        0.03,
    )
    rms_um: Any = module.contacts_rms_um(shapes, [1.0 / points] * points, d_um, q_um)
    return [*found, d_um, q_um, logs, rms_um]


def test_machine_code_gives_the_python_s_bits(machine_code: ModuleType) -> None:
    python = as_python()
    for seed in range(1000):
        assert [list(map(float.hex, one)) for one in called(machine_code, seed)] == [
            list(map(float.hex, one)) for one in called(python, seed)
        ], seed


def test_machine_code_gives_the_shapes_bits_on_the_map_beyond_it_and_nowhere(machine_code: ModuleType) -> None:
    python, disc = as_python(), [(0.3, -0.2, 0.25), (0.9, 0.1, 0.5), (-1.0, 0.4, 0.25)]
    for seed in range(60):
        random = np.random.default_rng(seed)
        modes, columns, rows = int(random.integers(1, 9)), int(random.integers(4, 12)), int(random.integers(4, 12))
        x_mm, y_mm = np.linspace(-30.0, 30.0, columns), np.cumsum(random.uniform(0.5, 9.0, rows))
        plate = ModeShapes(x_mm, y_mm, random.normal(size=(modes, rows, columns)))
        centres_mm = [*random.uniform(-40.0, 60.0, (20, 2)).tolist(), [x_mm[-1], y_mm[-1]], [np.nan, 0.0]]
        centres_mm += [[np.inf, -np.inf], [float(x_mm[1]), float(y_mm[1])]]
        contacts = [(*centre_mm, *random.uniform(-6.0, 6.0, 3).tolist()) for centre_mm in centres_mm]
        contacts += [(float(x_mm[2]), float(y_mm[0]), 0.0, 0.0, 0.0)]
        found = machine_code.contact_shapes(plate, disc, contacts)
        assert found == python.contact_shapes(plate, disc, contacts), seed


@pytest.mark.parametrize(
    ("disc", "contacts", "error"),
    [
        ([(0.0, 0.0)], [(0.0, 0.0, 5.0, 0.0, 5.0)], ValueError),
        ([(0.0, 0.0, 1.0)], [(0.0, 0.0)], ValueError),
        ([(0.0, 0.0, 1.0)], [(0.0, 0.0, 5.0, 0.0, "a")], TypeError),
        (None, [], TypeError),
    ],
)
def test_a_disc_or_contact_of_another_form_is_refused(
    machine_code: ModuleType, disc: object, contacts: object, error: type[Exception]
) -> None:
    plate = ModeShapes(np.arange(4.0), np.arange(5.0), np.ones((2, 5, 4)))
    with pytest.raises(error):
        machine_code.contact_shapes(plate, disc, contacts)
    with pytest.raises(AttributeError):
        machine_code.contact_shapes(None, [(0.0, 0.0, 1.0)], [(0.0, 0.0, 5.0, 0.0, 5.0)])


@pytest.mark.parametrize(
    ("place", "given", "error"),
    [
        (0, b"", ValueError),
        (0, bytes(24), ValueError),
        (0, None, TypeError),
        (1, ["a", "b"], TypeError),
        (2, [1.0, 1.0], ValueError),
        (3, [], ValueError),
        (5, [], ValueError),
        (5, [(0.0, 0.0)], ValueError),
        (8, [0.0, 0.0], ValueError),
        (10, [None], TypeError),
    ],
)
def test_what_is_no_list_of_the_right_length_is_refused(
    machine_code: ModuleType, place: int, given: object, error: type[Exception]
) -> None:
    arguments: list[object] = [
        array("d", (1.0, 0.5)).tobytes(),
        [0.5, 0.5],
        [0.5],
        [0.9],
        [1.0],
        [(0.0, 0.0, 0.7)],
        (2.0, 0.05),
        (1.0,),
        [0.1],
        [0.0],
        [0.0],
        1,
        0.03,
    ]
    machine_code.descend(*arguments)
    arguments[place] = given
    with pytest.raises(error):
        machine_code.descend(*arguments)


def test_amplitudes_are_taken_apart_and_put_together_as_in_python(machine_code: ModuleType) -> None:
    python, modal_um = as_python(), (1.5, 2.0 - 3.0j, complex(-0.0, -1.0), np.complex128(0.5j))
    parts = machine_code.components(modal_um)
    assert parts == python.components(modal_um) == ([1.5, 2.0, -0.0, 0.0], [0.0, -3.0, -1.0, 0.5])
    assert machine_code.phasors(*parts) == python.phasors(*parts) == modal_um
    assert {type(part) for part in parts[0] + parts[1]} == {float}
    for wrong in ("a", [None], 1.0):
        with pytest.raises(TypeError):
            machine_code.components(wrong)
    with pytest.raises(ValueError, match="another length"):
        machine_code.phasors([1.0], [])
    with pytest.raises(TypeError):
        machine_code.phasors([1.0], ["a"])


def test_tables_that_are_no_arrays_of_doubles_are_refused(machine_code: ModuleType) -> None:
    class Modes:
        tables = memoryview(bytes(16)), memoryview(np.arange(4.0)), memoryview(np.arange(5.0))

    with pytest.raises(ValueError, match="no such array"):
        machine_code.contact_shapes(Modes(), [(0.0, 0.0, 1.0)], [(0.0, 0.0, 5.0, 0.0, 5.0)])
