"""The pictures: that they are written, and of what."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.sim import lockstep
from hapticd.sim.lockstep import Run
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.settings import Settings
from hapticd.tools import plotting, simulated_picture

pytestmark = pytest.mark.long

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def run() -> Run:
    return lockstep.run("swap", seconds=3.2)


def size_px(path: Path) -> tuple[int, int]:
    data = path.read_bytes()
    assert data.startswith(PNG)
    return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")


@pytest.mark.parametrize(
    ("scenario", "seconds"),
    [("paper-figure-11", 1.3), ("step", 1.3), ("rest", 0.2), ("step", 0.2), ("hands", 0.2)],  # 0.2 s: no finger yet
)
def test_a_run_is_drawn_as_a_png(scenario: str, seconds: float, tmp_path: Path) -> None:
    simulated_picture.draw_run(lockstep.run(scenario, seconds=seconds), tmp_path / "run.png")
    assert size_px(tmp_path / "run.png")[0] > 600


def axes_of(run: Run, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The axes of the run's picture, from top to bottom."""
    figures: list[Any] = []
    with monkeypatch.context() as patched:
        patched.setattr(plotting, "save", lambda figure, _: figures.append(figure))
        simulated_picture.draw_run(run, Path("run.png"))
    return list(figures[0].axes)


def test_a_plate_with_contacts_is_drawn_with_their_rms_before_the_amplitude_at_the_centre(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = lockstep.run("strokes", settings=Settings(plate=PlateSettings.of("fingertip")), seconds=1.0)
    modes, _, fingers = axes_of(run, monkeypatch)
    texts = [text.get_text() for text in fingers.get_legend().get_texts()]
    assert texts == ["finger 1", "finger 2", "at its centre", "targets"]
    assert [text.get_text() for text in modes.get_legend().get_texts()][:4] == [f"$W_{{{k}d}}$" for k in (1, 2, 3, 4)]
    contact = next(line for line in fingers.get_lines() if line.get_label() == "finger 2")
    counts = contact.get_xdata() > 0.6
    rms_um = np.sqrt(np.mean(contact.get_ydata()[counts] ** 2))
    assert rms_um == pytest.approx(run.score.contact_leak_um, rel=0.1)
    assert f"contrast {run.score.contrast:.1f}" in fingers.get_title(loc="left")
    assert "over the contact, µm RMS" in fingers.get_ylabel()
