"""The bench over random laboratories, on small sizes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest

from hapticd.bench import worlds
from hapticd.bench.loop import ASKED, GUIDED, HAPTICD, PAPER, PERFECT, Job, felt_figures, measured, play
from hapticd.bench.tables import Table
from hapticd.design.person import FRICTION_SPEED_MM_S
from hapticd.sim import lockstep
from hapticd.sim.fingers.scenarios import REAL, SLIPPERY_UM
from hapticd.sim.matched_person import matched_factor
from hapticd.sim.plate.glasses import FINGERTIP, WIDE
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.score import Score
from hapticd.sim.settings import Settings, in_world
from hapticd.sim.world_errors import USUAL_MM_S, SensorErrors, Skin, WorldErrors
from hapticd.sim.world_tolerances import LEVELS

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]  # fits of eight modes


SECONDS, TOUCHING_S = 1.0, 8.0


def one_touched(_: str, play: Callable[[Job], dict[str, Score]], jobs: Sequence[Job]) -> list[dict[str, Score]]:
    """Play the fingertip plate, touched in its laboratory alone; the wide plate's scores are that laboratory's."""
    found = list[dict[str, Score]]()
    for job in jobs:
        plate = job.settings.plate.plate
        is_touched = (plate, job.level) == (FINGERTIP, worlds.LABORATORY)
        scores = found[0] if plate == WIDE else play(job._replace(touching_s=TOUCHING_S * is_touched))
        before = {name.replace(HAPTICD, GUIDED): one for name, one in scores.items() if name.endswith(HAPTICD)}
        found.append(before | scores)
    return found


@pytest.fixture(scope="module")
def tables() -> dict[str, Table]:
    return {table.name: table for table in worlds.run(1, seconds=SECONDS, touching_s=TOUCHING_S, campaign=one_touched)}


def test_the_worse_the_world_the_more_leaks_and_less_than_under_the_papers_scheme(tables: dict[str, Table]) -> None:
    table = tables["worlds"]
    ours_um = [table.figure(f"{level}: {HAPTICD}", "contact_leak_um") for level in LEVELS]
    assert ours_um[0] < ours_um[1] < ours_um[2]
    for level in LEVELS:
        paper, ours, perfect = (table.figure(f"{level}: {scheme}", "contrast") for scheme in (PAPER, HAPTICD, PERFECT))
        assert paper < ours < perfect
    assert 0.0 < table.figure(f"{worlds.LABORATORY}: {GUIDED}", "most_over_before_ratio") < 1.05


def test_frictions_but_not_amplitudes_are_too_slippery_where_the_person_is_not_known() -> None:
    settings = Settings(motion=REAL, plate=PlateSettings.of(WIDE))
    scores = play(Job(settings, worlds.LABORATORY, 2, 1.5, felt_um=SLIPPERY_UM))  # k is 1.39
    frictions, known, amplitudes = (
        felt_figures([scores[f"{asked}: {HAPTICD}"]])["slippery_bias_jnd"]
        for asked in ("frictions", "frictions, curve known", "amplitudes")
    )
    assert frictions < min(known, amplitudes) - 1.0


def test_a_laboratory_is_worse_where_over_5_points_less_are_felt() -> None:
    score = lockstep.run("strokes", settings=Settings(plate=PlateSettings.of(WIDE)), seconds=1.0).score
    after = [replace(score, felt_frac=felt_frac) for felt_frac in (0.5, 0.46, 0.44, 0.3)]
    scores = {f"{asked}: {scheme}": after[0] for asked in ASKED for scheme in (HAPTICD, GUIDED, PERFECT)}
    found = worlds._felt({WIDE: [scores | {f"frictions: {GUIDED}": one} for one in after]})
    assert [found.figure(f"wide, frictions: {one}", "worse_frac") for one in (HAPTICD, GUIDED)] == [0.0, 0.5]


def test_a_person_is_matched_in_the_plates_own_amplitudes_and_by_own_strokes() -> None:
    settings = Settings(motion=REAL, plate=PlateSettings.of(WIDE))

    def factor(**errors: Any) -> float:
        played = in_world(settings, WorldErrors(**errors))
        return matched_factor(played, measured(played, 1), 1, 2.0)

    usual = factor()
    assert factor(friction_factor=1.3) == pytest.approx(1.3 * usual, rel=0.02)
    assert factor(sensors=SensorErrors((0.05,) * 8)) < 0.98 * usual  # the plate moves less than they read
    assert factor(skin=Skin(speed_s_m=1.0)) < 0.99 * usual  # hands are faster than the finger of the factor
    as_assumed = factor(skin=Skin(speed_s_m=1e3 / FRICTION_SPEED_MM_S))
    at_rest = 1.0 + USUAL_MM_S / FRICTION_SPEED_MM_S
    assert as_assumed == pytest.approx(at_rest, rel=0.03)  # the observer errs by 0.02


def test_the_plate_keeps_to_its_limits_in_truth_in_every_world(tables: dict[str, Table]) -> None:
    ours = [row["limit_most_frac"] for scheme, row in tables["worlds"].rows.items() if HAPTICD in scheme]
    assert 0.5 < max(ours) <= 1.0


def test_stamps_that_jitter_by_3_ms_cost_a_tenth_at_most() -> None:
    worlds = Settings(stamp_jitter_ms=1.0), Settings(stamp_jitter_ms=3.0)
    usual_um, jittering_um = (lockstep.run("strokes", settings=one, seconds=6.0).score.leak_um for one in worlds)
    assert jittering_um < 1.1 * usual_um
