"""The order of the stimuli: balanced, shuffled, and stable."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.tools.study.protocol import Design, FrictionLevel, StudyError, participant_name, presented


@settings(deadline=None)
@given(st.integers(0, 2**63 - 1), st.integers(1, 60))
def test_both_frictions_are_presented_equally_often(seed: int, trials: int) -> None:
    order = presented(seed, trials)
    assert len(order) == trials
    assert abs(order.count(FrictionLevel.LOW) - order.count(FrictionLevel.HIGH)) == trials % 2


def test_a_seed_has_the_same_order_under_every_version_of_python() -> None:
    assert "".join(friction[0] for friction in presented(7, 12)) == "hlhlhhhllllh"
    assert "".join(friction[0] for friction in presented(2**40, 5)) == "hlhlh"


def test_combination_1_is_the_paper_s() -> None:
    design = Design(slippery_um=1.5)
    assert (FrictionLevel.LOW.combination, design.amplitudes_um(FrictionLevel.LOW)) == (1, (1.5, 0.0))
    assert (FrictionLevel.HIGH.combination, design.amplitudes_um(FrictionLevel.HIGH)) == (2, (0.0, 1.5))


@pytest.mark.parametrize(
    "wrong",
    [
        {"trials": 0},
        {"trials": 1001},
        {"slippery_um": 0.0},
        {"slippery_um": math.nan},
        {"slippery_um": 20.1},
        {"line_speed_mm_s": 0.0},
        {"line_speed_mm_s": math.inf},
        {"line_mm": ((0.0, 0.0), (math.nan, 0.0))},
    ],
)
def test_an_invalid_design_is_refused_by_name(wrong: dict[str, Any]) -> None:
    with pytest.raises(StudyError, match=next(iter(wrong))):
        Design(**wrong)


@pytest.mark.parametrize("name", ["", "-P", "a/b", "..", "P 3", "ä", "x" * 33, "P03\n"])
def test_an_invalid_name_is_refused(name: str) -> None:
    with pytest.raises(StudyError, match="participant"):
        participant_name(name)
    assert participant_name("P03-b_2") == "P03-b_2"
