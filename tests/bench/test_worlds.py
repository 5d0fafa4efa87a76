"""The bench over random laboratories, on small sizes."""

from __future__ import annotations

from typing import Any

import pytest

from hapticd.bench import worlds
from hapticd.bench.loop import AFTER, GUIDED, HAPTICD, NOTHING_WRONG, PAPER, PERFECT, Job, play
from hapticd.bench.tables import Table
from hapticd.sim import lockstep
from hapticd.sim.settings import Settings
from hapticd.sim.world_tolerances import LEVELS
from hapticd.tools import campaigns

pytestmark = pytest.mark.long


SECONDS, TOUCHING_S = 1.0, 12.0
SOME = ("pad_pose", "sensors", "stamp_jitter_ms")


@pytest.fixture(scope="module")
def tables() -> dict[str, Table]:
    return {table.name: table for table in worlds.run(1, seconds=SECONDS, touching_s=TOUCHING_S, causes=SOME)}


def test_the_worse_the_world_the_more_leaks_and_less_than_under_the_papers_scheme(tables: dict[str, Table]) -> None:
    table = tables["worlds"]
    ours_um = [table.figure(f"{level}: {HAPTICD}", "leak_um") for level in LEVELS]
    assert table.figure(f"{NOTHING_WRONG}: {HAPTICD}", "leak_um") < ours_um[0] < ours_um[1] < ours_um[2]
    for level, of_level_um in zip(LEVELS, ours_um, strict=True):
        paper_um = table.figure(f"{level}: {PAPER}", "leak_um")  # about as much in the worst, at points
        assert table.figure(f"{level}: {PERFECT}", "leak_um") < of_level_um < 1.1 * paper_um
        assert table.figure(f"{level}: {AFTER}", "most_over_before_ratio") < 1.05


@pytest.mark.parametrize("name", ["worlds_causes", "worlds_contact_causes"])
def test_every_cause_is_made_perfect_once_the_largest_share_first(name: str, tables: dict[str, Table]) -> None:
    first, *rest = tables[name].rows
    assert first == HAPTICD
    assert {*rest} == {f"{cause} perfect" for cause in SOME}
    shares = [tables[name].figure(row, "share_frac") for row in rest]
    assert shares == sorted(shares, reverse=True)
    assert shares[0] > 0.0


def test_contacts_differ_by_more_than_under_the_papers_scheme(tables: dict[str, Table]) -> None:
    table = tables["worlds_contact"]
    for level in (NOTHING_WRONG, worlds.LABORATORY, worlds.WORST):
        paper, ours, perfect = (table.rows[f"{level}: {scheme}"] for scheme in (PAPER, HAPTICD, PERFECT))
        assert paper["contrast"] < ours["contrast"] < perfect["contrast"]
        assert 0.0 <= ours["felt_frac"] <= 1.0


def test_the_plate_keeps_to_its_limits_in_truth_in_every_world(tables: dict[str, Table]) -> None:
    ours = [
        row["limit_most_frac"]
        for name in ("worlds", "worlds_contact")
        for scheme, row in tables[name].rows.items()
        if HAPTICD in scheme
    ]
    assert 0.5 < max(ours) <= 1.0


def test_contacts_are_touched_freely_and_guided_points_freely(tables: dict[str, Table]) -> None:
    free, guided = (
        tables["worlds_contact"].figure(f"{worlds.LABORATORY}: {scheme}", "contact_leak_um")
        for scheme in (AFTER, GUIDED)
    )
    assert free != guided > 0.0
    assert not any(GUIDED in row for row in tables["worlds"].rows)


def test_processes_give_what_one_process_gives() -> None:
    jobs = [Job(Settings(), "mild", seed, SECONDS, 2.0, touched=(AFTER,)) for seed in (1, 2)]
    played = campaigns.run("worlds", play, jobs, jobs=2)
    assert repr(played) == repr([*map(play, jobs)])  # NaN, which perfect knowledge has, equals no other one


def strokes_leak_um(**errors: Any) -> float:
    return lockstep.run("strokes", settings=Settings(**errors), seconds=6.0).score.leak_um


def test_stamps_that_jitter_by_3_ms_cost_a_tenth_at_most() -> None:
    assert strokes_leak_um(stamp_jitter_ms=3.0) < 1.1 * strokes_leak_um()
