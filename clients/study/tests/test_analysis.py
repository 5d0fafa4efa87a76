"""The statistics against the paper's figures and closed forms."""

from __future__ import annotations

import math

import pytest
from people import session

from hapticd_study.analysis import Group, Result, analyse, analyse_group, result

# Constructed, for the paper prints no participant's rate: of all seven counts of 20 whose average is its 73.57 %, those
# whose standard deviation comes nearest to its 17.72 % and that have one participant at chance, as it reports.
PAPER = (10, 12, 12, 15, 17, 17, 20)


def group(counts: tuple[int, ...]) -> Group:
    return analyse_group([person(f"P{place}", count) for place, count in enumerate(counts, 1)])


def person(name: str, correct: int) -> Result:
    return result(name, {"high": (min(correct, 10), 10), "low": (max(correct - 10, 0), 10)})


def test_seven_participants_reproduce_the_paper_s_average_and_standard_deviation() -> None:
    judged = group(PAPER)
    assert f"{100 * judged.mean_frac:.2f}" == "73.57"
    assert 100 * judged.sd_frac == pytest.approx(17.72, abs=0.01)
    assert judged.t == pytest.approx((judged.mean_frac - 0.5) / (judged.sd_frac / math.sqrt(7)))
    assert judged.t_p == pytest.approx(0.01255, abs=1e-5)  # its "p <= 0.1"
    tail = sum(math.comb(140, k) for k in range(103, 141)) / 2**140
    assert (judged.correct, judged.trials) == (103, 140)
    assert judged.pooled_p == pytest.approx(2 * tail)


def test_a_session_is_analysed_by_its_stimuli() -> None:
    held = session("P1", 13)
    judged = analyse(held)
    first = [trial.correct for trial in held.presented[:13]]
    assert (judged.correct, judged.trials) == (13, 20)
    assert judged.by_answer == {answer: (first.count(answer), 10) for answer in ("high", "low")}


def test_p_is_the_binomial_tail_and_the_interval_clopper_and_pearson_s() -> None:
    for correct in range(21):
        further = [k for k in range(21) if abs(k - 10) >= abs(correct - 10)]
        assert person("P", correct).p == pytest.approx(sum(math.comb(20, k) for k in further) / 2**20)
    assert person("P", 20).interval_frac == (pytest.approx(0.025 ** (1 / 20)), 1.0)
