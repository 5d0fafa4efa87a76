"""What the slipping finger's share depends on: where the limit's micrometres count, and a third mode."""

from __future__ import annotations

import pytest

from hapticd.bench import leak_share
from hapticd.bench.tables import Table

AT_FINGERS = "peak at fingers, 2 modes"
THREE_MODES = "peak at fingers, 3 modes"
NO_FADE = "free plate, 2 modes, no fade"


@pytest.fixture(scope="module")
def table() -> Table:
    return leak_share.run(seeds=(1,), seconds=2.0, names=(AT_FINGERS, THREE_MODES, NO_FADE))


def test_micrometres_that_count_where_fingers_are_give_a_larger_share_and_a_third_mode_gives_more(table: Table) -> None:
    for name in ("slip_frac", "perfect_slip_frac"):
        shares = [table.row(row).figures[name] for row in (leak_share.DEFAULT, AT_FINGERS, THREE_MODES)]
        assert shares == sorted(set(shares))
    limited = [table.row(row).figures["perfect_limited_frac"] for row in (leak_share.DEFAULT, AT_FINGERS, THREE_MODES)]
    assert limited == sorted(set(limited), reverse=True)


def test_no_loop_serves_the_slipping_finger_better_than_perfect_knowledge(table: Table) -> None:
    for row in table.rows:
        assert row.figures["slip_frac"] < row.figures["perfect_slip_frac"] <= 1.0


def test_the_fade_gives_amplitude_away_for_less_leak(table: Table) -> None:
    faded, whole = (table.row(row).figures for row in (leak_share.DEFAULT, NO_FADE))
    assert faded["slip_frac"] < whole["slip_frac"]
    assert faded["leak_um"] < whole["leak_um"]
    assert faded["perfect_slip_frac"] == whole["perfect_slip_frac"]


def test_every_kind_of_shapes_has_its_row_with_two_modes_and_with_three() -> None:
    settings = leak_share.alternatives()
    assert len(settings) == 12
    for name, chosen in settings.items():
        assert name.startswith(chosen.plate.shapes)
        assert len(chosen.config.limits.w_limit_um) == chosen.plate.driven_modes
        assert (chosen.config.solver.fade == 0.0) is name.endswith("no fade")
