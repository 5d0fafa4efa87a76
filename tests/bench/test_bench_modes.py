"""The bench of the modes: reading a map, making one, what a contact and a scale change, how many digits hold."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise

import pytest

from hapticd.bench import modes, modes_contact, modes_fit, modes_scale, stability_modes
from hapticd.bench.tables import UNITS, Table, plain, render

TABLES: dict[str, Callable[[], Table]] = {
    "modes": lambda: modes.run(pairs=150, seeds=(1,), repeats=1, calls=5),
    "map-fit": lambda: modes_fit.run(seeds=(1,), repeats=1, kinds=("turned", "held")),
    "contact": lambda: modes_contact.run(pairs=200, repeats=1, calls=5),
    "scale": lambda: modes_scale.run(pairs=150, seeds=(1,), seconds=3.0, repeats=1),
}


@cache
def table(name: str) -> Table:
    return TABLES[name]()


def figures(name: str, figure: str) -> dict[str, float]:
    return {row.name: row.figures[figure] for row in table(name).rows if figure in row.figures}


@pytest.mark.parametrize("name", TABLES)
def test_every_figure_is_a_finite_number_with_its_unit_in_the_name(name: str) -> None:
    told = json.loads(json.dumps(plain(table(name)), allow_nan=False))
    for one in told["alternatives"].values():
        for key, value in one.items():
            assert math.isfinite(value), key
            assert key.endswith((*UNITS, "_ratio")), key
    assert table(name).default in render(table(name))


def test_each_order_of_interpolation_errs_less_and_the_basis_itself_not_at_all() -> None:
    leak = figures("modes", "interpolation_um_per_um")
    orders = [f"{way}, fitted map" for way in ("nearest", "bilinear", "bicubic at", "quintic")]

    assert all(leak[less] < leak[more] / 10.0 for more, less in pairwise(orders))
    assert leak["analytic basis"] < 1e-12


def test_with_the_scan_s_noise_nothing_beats_the_default_by_a_hundredth() -> None:
    leak = figures("modes", "leak_um_per_um")

    assert all(value > 0.99 * leak[modes.DEFAULT] for value in leak.values())


def test_outside_splines_have_our_gradients() -> None:
    pytest.importorskip("scipy")
    error = figures("modes", "slope_error_frac")

    assert error["RectBivariateSpline, fitted map"] == pytest.approx(error[modes.DEFAULT], rel=1e-3)
    assert error["RectBivariateSpline, quintic, fitted map"] == pytest.approx(error["quintic, fitted map"], rel=1e-3)


def test_the_choice_takes_the_better_fit_of_a_free_plate_and_of_a_held_one() -> None:
    turned, held = figures("map-fit", "turned_frac"), figures("map-fit", "held_frac")

    assert turned[modes_fit.DEFAULT] == turned["free-plate modes"] < 0.25 < 5.0 < turned["plate equation"]
    assert held[modes_fit.DEFAULT] == held["plate equation"] < 0.5 < 5.0 < held["free-plate modes"]


def test_a_map_is_nearer_the_plate_than_any_outside_fit_of_the_same_scan() -> None:
    pytest.importorskip("scipy")
    held = figures("map-fit", "held_frac")

    assert all(held[name] > 1.5 * held[modes_fit.DEFAULT] for name in held if name.startswith("scipy"))


def test_a_disc_s_matrix_wins_over_the_disc_what_it_gives_up_at_its_centre() -> None:
    disc, point = figures("contact", "disc_um_per_um"), figures("contact", "point_um_per_um")

    assert point["point"] < 1e-6 < point["disc"]
    assert disc["disc"] < 0.95 * disc["point"]
    assert disc["disc"] == pytest.approx(disc["disc, by quadrature"], rel=1e-3)
    assert disc["disc, 3 modes"] < disc["point, 3 modes"] < disc["point"]


def test_shapes_scaled_where_fingers_are_and_a_third_mode_are_limited_less() -> None:
    limited = figures("scale", "limited_frac")

    assert limited["X Y, peak at fingers"] < limited[modes_scale.DEFAULT]
    assert limited["X Y 9x6, peak over the plate"] < limited["X Y, peak at fingers"]
    assert figures("scale", "edge_um")[modes_scale.DEFAULT] == 4.0


def test_outside_references_that_are_missing_are_left_out_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (modes_fit, stability_modes):
        monkeypatch.setattr(module, "optional", lambda _: None)
    fits, skipped = modes_fit._fits()

    assert not set(fits) & set(skipped)
    assert all(name.startswith("scipy") for name in skipped)
    assert [name for name, _ in stability_modes.rows()] == ["modes: edge, outside, NaN, huge", "modes: contact discs"]


def test_digits_hold_and_no_position_is_answered_with_nonsense() -> None:
    pytest.importorskip("mpmath")
    rows = dict(stability_modes.rows(points=20))

    hostile = rows["modes: edge, outside, NaN, huge"]
    assert hostile["points_count"] > 100
    assert all(value == 0 for name, value in hostile.items() if name != "points_count")
    assert rows["modes: Ritz, rounding"]["frequency_digits_count"] > 12
    assert rows["modes: Ritz, ten more terms"]["frequency_digits_count"] > 8  # the issue asks for 4
    assert rows["modes: Ritz, ten more terms"]["shape_digits_count"] > 5
    assert rows["modes: sums of Legendre products"]["correct_digits_count"] > 13
    assert rows["modes: bicubic at"]["correct_digits_count"] > 12
    assert rows["modes: bicubic at"]["slope_digits_count"] > 12
    assert rows["modes: contact discs"]["correct_digits_count"] > 8
