"""The bench over random laboratories, on small sizes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from hapticd.bench import worlds
from hapticd.bench.tables import Table
from hapticd.config.sections import Config, PredictionConfig
from hapticd.sim import lockstep
from hapticd.sim.fingers.pad_noise import PadNoise
from hapticd.sim.settings import Settings
from hapticd.tools import campaigns

pytestmark = pytest.mark.long


SECONDS, TOUCHING_S = 1.0, 6.0
SOME = ("pad_pose", "sensors", "stamp_jitter_ms")


@pytest.fixture(scope="module")
def tables() -> dict[str, Table]:
    found = worlds.run(worlds=1, seconds=SECONDS, touching_s=TOUCHING_S, causes=SOME)
    return {table.name: table for table in found}


def leak_um(table: Table, row: str) -> float:
    return table.row(row).figures["leak_um"]


def test_the_worse_the_world_the_more_leaks_and_less_than_under_the_papers_scheme(tables: dict[str, Table]) -> None:
    table = tables["worlds"]
    ours_um = [leak_um(table, f"{level}: {worlds.HAPTICD}") for level in worlds.LEVELS]
    assert leak_um(table, f"{worlds.NOTHING_WRONG}: {worlds.HAPTICD}") < ours_um[0] < ours_um[1] < ours_um[2]
    for level, of_level_um in zip(worlds.LEVELS, ours_um, strict=True):
        paper_um = leak_um(table, f"{level}: {worlds.PAPER}")  # about as much in the worst, at points
        assert leak_um(table, f"{level}: {worlds.PERFECT}") < of_level_um < 1.1 * paper_um


def test_touching_leaves_no_level_worse(tables: dict[str, Table]) -> None:
    for level in worlds.LEVELS:
        figures = tables["worlds"].row(f"{level}: {worlds.AFTER}").figures
        assert figures["before_ratio_most"] < 1.05
        assert figures["paper_ratio"] > 0.9


@pytest.mark.parametrize("name", ["worlds_causes", "worlds_contact_causes"])
def test_every_cause_is_made_perfect_once_the_largest_share_first(name: str, tables: dict[str, Table]) -> None:
    ours, *rest = tables[name].rows
    assert ours.name == worlds.HAPTICD
    assert {row.name for row in rest} == {f"{cause} perfect" for cause in SOME}
    shares = [row.figures["share_frac"] for row in rest]
    assert shares == sorted(shares, reverse=True)
    assert shares[0] > 0.0


def test_contacts_differ_by_more_than_under_the_papers_scheme(tables: dict[str, Table]) -> None:
    table = tables["worlds_contact"]
    for level in (worlds.NOTHING_WRONG, worlds.LABORATORY, worlds.WORST):
        paper, ours, perfect = (
            table.row(f"{level}: {scheme}").figures for scheme in (worlds.PAPER, worlds.HAPTICD, worlds.PERFECT)
        )
        assert paper["contrast"] < ours["contrast"] < perfect["contrast"]
        assert 0.0 < ours["contact_slip_um"] < 2.0
        assert 0.0 <= ours["felt_frac"] <= 1.0


def test_the_plate_keeps_to_its_limits_in_truth_in_every_world(tables: dict[str, Table]) -> None:
    for name in ("worlds", "worlds_contact"):
        for row in tables[name].rows:
            if worlds.PAPER not in row.name:
                assert row.figures.get("limit_frac_most", 0.0) <= 1.0, row.name


def test_contacts_are_touched_freely_and_guided_points_freely(tables: dict[str, Table]) -> None:
    free, guided = (tables["worlds_contact"].row(f"{worlds.LABORATORY}: {scheme}") for scheme in worlds.TOUCHED)
    assert free.figures["contact_leak_um"] != guided.figures["contact_leak_um"] > 0.0
    assert not any(worlds.GUIDED in row.name for row in tables["worlds"].rows)


def test_processes_give_what_one_process_gives() -> None:
    jobs = [worlds.Job(Settings(), "mild", seed, SECONDS, 2.0, causes=()) for seed in (1, 2)]
    played = campaigns.run("worlds", worlds.play, jobs, jobs=2)
    assert repr(played) == repr([*map(worlds.play, jobs)])  # NaN, which perfect knowledge has, equals no other one


def strokes_leak_um(**errors: Any) -> float:
    return lockstep.run("strokes", settings=Settings(**errors), seconds=6.0).score.leak_um


def test_stamps_that_jitter_by_3_ms_cost_a_tenth_at_most() -> None:
    assert strokes_leak_um(stamp_jitter_ms=3.0) < 1.1 * strokes_leak_um()


def test_noise_four_times_the_expected_costs_a_fifth_more_than_if_it_were_configured() -> None:
    known = replace(Config(), prediction=PredictionConfig(noise_mm=0.2))
    assert strokes_leak_um(noise=PadNoise(0.2)) < 1.2 * strokes_leak_um(noise=PadNoise(0.2), config=known)
