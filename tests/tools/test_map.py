"""`hapticd plate map`: where fingers feel the frictions that are asked of them."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pictures import faults

from hapticd.__main__ import main
from hapticd.core.friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from hapticd.core.solver.instant import InstantSolver
from hapticd.design.felt_places import felt_map
from hapticd.sim.score import felt
from hapticd.tools.map.picture import FeltPanel, felt_figure
from hapticd.tools.map.plate import mapped_plate
from hapticd.values import WEBER_FRAC

PLATE = mapped_plate(Namespace(modes=None, plate="fingertip", config=None))
MODES, SIZE_MM, LIMITS_UM = PLATE[:3]
GIVEN_MM = (-30.0, 20.0)


def shapes(points_mm: np.ndarray) -> np.ndarray:
    return MODES.evaluate(points_mm.reshape(-1, 2)).reshape(*points_mm.shape[:-1], -1)


def error_in_the_daemon(places_mm: np.ndarray, frictions: tuple[float, ...]) -> float:
    """Settle the daemon's solver from rest; return the largest error by the simulation's own quadrature."""
    solver = InstantSolver(MODES, LIMITS_UM, contact_radius_mm=5.0)
    targets_um = [DEFAULT_FRICTION_CURVE.amplitude_um(friction) for friction in frictions]
    places = [(x_mm, y_mm, target_um) for (x_mm, y_mm), target_um in zip(places_mm.tolist(), targets_um, strict=True)]
    modal_um = (0j,) * 4
    for _ in range(40):
        modal_um = solver.solve(places, modal_um, 100_000_000).modal_um
    _, got = felt(places_mm[None], np.array(modal_um)[None], shapes)
    asked = [DEFAULT_FRICTION_CURVE.friction(target_um) for target_um in targets_um]
    return float(np.abs((got[0] / asked - 1.0) / WEBER_FRAC).max())


def test_the_map_agrees_with_the_daemon_s_solver_and_the_simulation_s_quadrature(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, picture = tmp_path / "felt.npz", tmp_path / "felt.png"
    command = ["plate", "map", "--plate", "fingertip", "--finger=-30,20", "--friction", "0.2,1", "--cells", "9"]
    assert main([*command, "--out", str(out), "--plot", str(picture)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("a plate of 190 x 190 mm, 4 modes")
    assert picture.stat().st_size > 0
    with np.load(out) as arrays:
        x_mm, y_mm = arrays["x_mm"], arrays["y_mm"]
        for number, frictions in ((1, (0.2, 1.0)), (2, (1.0, 0.2))):
            largest_jnd = np.abs(arrays[f"errors_jnd_{number}"]).max(axis=0)
            is_felt = largest_jnd <= 1.0
            assert tuple(arrays[f"frictions_{number}"]) == frictions
            assert f"as asked on {100 * is_felt.mean():.1f} % of the plate" in lines[number]
            places_mm = [np.array([GIVEN_MM, (x, y)]) for y in y_mm for x in x_mm]
            daemon_jnd = np.array([error_in_the_daemon(one_mm, frictions) for one_mm in places_mm]).reshape(9, 9)
            assert (daemon_jnd <= 1.0).any()
            assert np.mean((daemon_jnd <= 1.0) & ~is_felt) <= 0.03  # the map tries more starts: it finds no less
            assert np.mean((daemon_jnd <= 1.0) != is_felt) <= 0.2


def test_the_map_follows_the_configured_friction_curve() -> None:
    steep = FrictionCurve.exponential(full_um=1.0, decay_um=0.35)  # half the vibration for the same friction
    usual, easy = (
        felt_map(MODES, [GIVEN_MM], (0.2, 1.0), limits_um, curve, radius_mm=5.0, size_mm=SIZE_MM, cells=5)
        for curve, limits_um in ((DEFAULT_FRICTION_CURVE, LIMITS_UM), (steep, [one / 2.0 for one in LIMITS_UM]))
    )
    assert usual.felt_frac > 0.0
    np.testing.assert_allclose(easy.largest_jnd.min(), usual.largest_jnd.min(), atol=0.2)
    assert np.median(easy.largest_jnd) == pytest.approx(np.median(usual.largest_jnd), rel=0.2)


def test_the_pictures_have_no_text_that_is_cut_or_covered() -> None:
    panels = []
    for frictions in ((0.2, 1.0, 0.5), (1.0, 0.2, 0.5)):
        given_mm = [(-95.0, 95.0), (95.0, -95.0)]
        result = felt_map(
            MODES, given_mm, frictions, LIMITS_UM, DEFAULT_FRICTION_CURVE, radius_mm=5.0, size_mm=SIZE_MM, cells=5
        )
        panels.append(FeltPanel(given_mm, frictions, result))
    assert faults(felt_figure(panels, PLATE)) == []
    assert faults(felt_figure(panels[:1], PLATE)) == []


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ("--friction 0.2,1 --finger 1,2 --finger 30,4", "has 2 frictions for 3 fingers"),
        ("--finger 1,2 --friction 0.2,1.1", "--friction: 1.1 is out of bounds, it must be 0 .. 1"),
        ("--finger 1,2 --plate there-is-none", "--plate: "),
        ("--finger 1,2 --cells 402", "--cells: 402 is out of bounds"),
        ("--finger 1,2 " * 16, "--finger: 16 fingers are too many: give at most 15"),
        ("--finger 1", "--finger: '1' is not 2 numbers"),
        ("--finger nan,2", "--finger: nan is out of bounds"),
        ("--finger 69,2", "--finger 69,2: lies off a plate of 137.5 x 137.5 mm"),
        ("--finger 1,2 --modes there-is-none.npz", "--modes: there-is-none.npz: cannot be read"),
    ],
)
def test_invalid_arguments_are_refused_in_a_sentence(arguments: str, why: str, refused: Callable[..., str]) -> None:
    assert why in refused("plate", "map", *arguments.split())
