"""Mode maps that can be read but drive nothing: refused by `run`, reported by `doctor`, one sentence each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from machine_bench import PLATE

from hapticd.__main__ import main


@pytest.mark.parametrize(
    ("to_mm", "shapes", "word"),
    [
        (1e-3, None, "x_mm runs from -0.06875 to 0.06875 on a plate of 137.5 mm; give positions in mm"),
        (1.0, np.zeros(PLATE.shapes.shape), "mode 1 is zero everywhere"),
        (1.0, np.ones(PLATE.shapes.shape), "modes 1 and 2 have the same shape"),
        (1.0, np.stack([np.eye(111), -2.0 * np.eye(111)]), "modes 1 and 2 have the same shape"),
    ],
    ids=["in metres", "all zero", "twice", "twice, scaled"],
)
@pytest.mark.parametrize("command", [("run", "--check"), ("doctor",)], ids=" ".join)
def test_a_map_that_drives_nothing_is_refused_in_one_sentence(
    command: tuple[str, ...],
    to_mm: float,
    shapes: npt.NDArray[np.float64] | None,
    word: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    written = PLATE.shapes if shapes is None else shapes
    np.savez(tmp_path / "map.npz", x_mm=PLATE.x_mm * to_mm, y_mm=PLATE.y_mm * to_mm, shapes=written)
    config = tmp_path / "hapticd.toml"
    config.write_text(f'[plate]\nmodes_file = "map.npz"\n[sim]\nrig_dir = "{tmp_path}"\n', encoding="utf-8")
    assert main([*command, "--config", str(config)]) == (1 if command == ("doctor",) else 78)
    printed = capsys.readouterr()
    (line,) = [line for line in (printed.out + printed.err).splitlines() if word in line]
    assert f"plate.modes_file: {tmp_path}/map.npz: " in line
    assert command == ("doctor",) or printed.err.count("\n") == 1
