"""The pictures: that they are written, and of what."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.files import plotting
from hapticd.sim import lockstep, picture
from hapticd.sim.lockstep import Run, Settings
from hapticd.sim.picture import Film
from hapticd.sim.plate.ground_truth import PlateSettings

pytestmark = pytest.mark.long

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def run() -> Run:
    return lockstep.run("swap", seconds=3.2)


def size_px(path: Path) -> tuple[int, int]:
    data = path.read_bytes()
    assert data.startswith(PNG)
    return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")


def test_two_films_are_drawn_side_by_side(run: Run, tmp_path: Path) -> None:
    ours, paper = Film.of(run, "hapticd"), Film.of(run, "the paper's scheme")
    picture.draw([ours], tmp_path / "one.png")
    picture.draw([ours, paper], tmp_path / "two.png", seconds=1.5)

    one, two = size_px(tmp_path / "one.png"), size_px(tmp_path / "two.png")
    assert one == pytest.approx((3.2 * picture.INCHES_PER_S * plotting.DPI, 880), abs=1)
    assert two == (2 * round(picture.LEAST_IN * plotting.DPI), 880)


@pytest.mark.parametrize(
    ("scenario", "seconds"),
    [("paper-figure-11", 1.3), ("step", 1.3), ("rest", 0.2), ("step", 0.2), ("hands", 0.2)],  # 0.2 s: no finger yet
)
def test_a_run_is_drawn_as_a_png(scenario: str, seconds: float, tmp_path: Path) -> None:
    picture.draw_run(lockstep.run(scenario, seconds=seconds), tmp_path / "run.png")
    assert size_px(tmp_path / "run.png")[0] > 600


def axes_of(run: Run, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The axes of the run's picture, from top to bottom."""
    figures: list[Any] = []
    with monkeypatch.context() as patched:
        patched.setattr(plotting, "save", lambda figure, _: figures.append(figure))
        picture.draw_run(run, Path("run.png"))
    return list(figures[0].axes)


def test_the_quadrature_of_two_slipping_fingers_is_shown_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    run = lockstep.run("both-slip", seconds=1.0)
    highest_um = float(np.abs(run.modal_um.imag).max())
    assert highest_um > 1.0
    low_um, high_um = axes_of(run, monkeypatch)[1].get_ylim()
    assert -low_um == high_um > highest_um


def test_references_lie_behind_the_amplitudes_that_follow_them(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = axes_of(run, monkeypatch)[0].get_lines()
    for mode, (reference, amplitude) in enumerate((lines[0:2], lines[2:4])):
        np.testing.assert_array_equal(reference.get_ydata(), run.reference_um[:, mode].real)
        np.testing.assert_array_equal(amplitude.get_ydata(), run.modal_um[:, mode].real)
        assert reference.get_linewidth() > 2 * amplitude.get_linewidth()
        assert reference.get_color() == amplitude.get_color()


def test_of_a_long_run_its_first_seconds_are_drawn_and_its_title_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    modes, _, fingers = axes_of(lockstep.run("paper-figure-10", seconds=7.0), monkeypatch)
    assert modes.get_title(loc="left") == "paper-figure-10, 5 s of 7 s"
    assert fingers.get_xlim() == pytest.approx((0.0, 5.0), abs=0.001)
    assert fingers.get_title(loc="left").endswith("(in 7 s)")


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


def test_the_time_from_the_steps_target_to_the_plate_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    *_, fingers = axes_of(lockstep.run("step", seconds=1.3), monkeypatch)
    assert any("5.5 ms: the link's 5 ms" in text.get_text() for text in fingers.texts)


def test_a_still_plates_noise_does_not_fill_the_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    modes, _, fingers = axes_of(lockstep.run("hands", seconds=0.4), monkeypatch)
    assert modes.get_ylim() == pytest.approx((-picture.LEAST_UM, picture.LEAST_UM), rel=0.15)
    assert [text.get_text() for text in fingers.texts] == ["no finger has a target"]
    assert modes.figure.get_supxlabel().endswith("simulated hands, seed 1")


def test_a_window_of_a_film_is_judged_by_itself(run: Run) -> None:
    film = Film.of(run, "swap")
    window = film.between(1.0, 2.0)

    assert film.score == run.score
    assert len(window.t_s) == len(window.truth_um) == len(window.reference_um) == 2000
    assert window.t_s[0] >= 1.0
    assert window.t_s[-1] < 2.0
    still_um = np.abs(window.truth_um[200:, 1])
    assert window.score.leak_um == pytest.approx(math.sqrt(float(np.mean(still_um**2))))
