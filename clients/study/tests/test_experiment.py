"""Experiments as people write them: what a trial shows, and one sentence for each mistake."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd_contract.contents import Grating
from hapticd_study.experiment import PAPER, StudyError, load, parse, participant_name

SPOT = {
    "name": "spot",
    "question": "Smooth or rough?",
    "answers": {"smooth": "", "rough": ""},
    "correct": "kind",
    "factors": {"kind": {"smooth": {"um": 0.0}, "rough": {"um": 1.0}}, "period_mm": [2.0, 4.0]},
    "trials": 4,
    "plate": {
        "targets": [{"finger": 1, "friction": 0.5}],
        "surfaces": [
            {
                "name": "spot",
                "circle_mm": 20.0,
                "grating": {"period_mm": "$period_mm", "high_um": "$kind.um"},
            }
        ],
        "effects": [{"name": "click", "surface": "spot", "pulse": {"height_um": 1.0, "length_s": 0.02}}],
    },
}
STAIRS = {"method": "staircase", "start": 1.0, "step": 0.1, "lowest": 0.0, "highest": 1.0}
QUEST = {"method": "quest+", "levels": [0.0, 0.5, 1.0], "spreads": [0.1, 0.2]}
RATED = {"question": "How alike?", "answers": {"1": "", "2": ""}, "trials": 2}
PAIR = {"of": "level", "standard": 0.5}
BARE: dict[str, Any] = {
    "question": "Which is more slippery?",
    "trials": 10,
    "intervals": PAIR,
    "adaptive": STAIRS,
    "plate": {"targets": [{"finger": 1, "friction": "$level"}]},
}


def test_combination_1_is_the_paper_s() -> None:
    made = load(PAPER)
    for friction, own_um, virtual_um in (("low", 1.0, 0.0), ("high", 0.0, 1.0)):
        scene = made.targets({"friction": friction})
        assert {one.finger: one.amplitude_um for one in scene.targets} == {1: own_um, "study-walker": virtual_um}
        assert (scene.virtuals[0].path_mm, scene.virtuals[0].speed_mm_s) == (((-40.0, 25.0), (40.0, -15.0)), 40.0)
    assert (made.trials, made.conditions()) == (20, ({"friction": "low"}, {"friction": "high"}))


def test_a_trial_fills_targets_surfaces_and_effects_with_its_levels() -> None:
    made = parse(SPOT)
    scene = made.targets({"kind": "rough", "period_mm": 4.0})
    assert scene.surfaces[0].grating == Grating(period_mm=4.0, high_um=1.0)
    assert scene.effects[0].surface == "spot"
    assert len(made.conditions()) == 4
    assert made.conditions(without="period_mm") == ({"kind": "smooth"}, {"kind": "rough"})


def test_an_adaptive_method_and_two_intervals_have_their_own_answers_and_abscissa() -> None:
    made = parse(BARE)
    assert (list(made.choices), made.is_graded, made.abscissa) == (["first", "second"], True, "level")
    assert made.targets({"level": 0.5}).targets[0].friction == 0.5
    assert parse({**BARE, "adaptive": QUEST}).adaptive.levels == (0.0, 0.5, 1.0)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("base", "change", "sentence"),
    [
        (SPOT, {"trials": 0}, "trials: 0 is out of bounds, it must be 1 .. 1000."),
        (SPOT, {"colour": 1}, "colour: unknown field, see clients/study/README.md."),
        (SPOT, {"answers": {"smooth": ""}}, "answers: must be 2 .. 9, each with its label."),
        (SPOT, {"correct": "form"}, "correct: 'form' is not one of the factors (kind, period_mm)."),
        (SPOT, {"correct": "period_mm"}, "correct: each level of this factor must be one of the answers."),
        (SPOT, {"curve": "kind"}, "curve: needs a factor whose levels are numbers."),
        (SPOT, {"blocks": "period_mm", "trials": 5}, "trials: must be a multiple of the number of blocks."),
        (SPOT, {"factors": {"kind": ["smooth", "rough"]}}, "plate: '$period_mm' is neither a factor nor an entry"),
        (SPOT, {"factors": {"a b": [1]}}, "a b: is no name for a factor"),
        (SPOT, {"factors": {"level": [1]}}, "level: is the name of what an adaptive method chooses"),
        (SPOT, {"plate": {"targets": [{"finger": 1, "friction": 2.0}]}}, "plate.targets[0].friction: 2 is out of"),
        (SPOT, {"plate": {"targets": [{"finger": 1}]}}, "plate.targets[0]: needs exactly one of"),
        (SPOT, {"correct": "", "feedback": True}, "practice: its feedback needs right and wrong answers"),
        (BARE, {"answers": {"a": "", "b": ""}}, "answers: with intervals the answers are first and second"),
        (BARE, {"intervals": {**PAIR, "of": "hand"}}, "intervals.of: 'hand' is not one of the factors (level)."),
        (BARE, {"adaptive": {**STAIRS, "start": 2.0}}, "adaptive.start: must be within lowest .. highest."),
        (BARE, {"adaptive": {**STAIRS, "highest": 3.0}}, "plate.targets[0].friction: 3 is out of bounds"),
        (BARE, {"adaptive": {**QUEST, "levels": [0.0, 7.0]}}, "plate.targets[0].friction: 7 is out of bounds"),
        (BARE, {"adaptive": {**QUEST, "spreads": [0.0]}}, "adaptive.spreads: must be above 0."),
        (BARE, {"adaptive": {"method": "guess"}}, "adaptive.method: must be one of"),
        (BARE, {"intervals": {**PAIR, "standard": -1.0}}, "plate.targets[0].friction: -1 is out of bounds"),
    ],
)
def test_a_mistake_is_one_sentence_with_its_place(base: dict[str, Any], change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(StudyError) as refused:
        parse({**base, **change})
    assert str(refused.value).startswith(sentence)
    assert str(refused.value).count(".\n") == 0


def test_the_readme_s_experiment_is_one_and_its_two_hands_are_a_part_of_one() -> None:
    text = PAPER.parents[1].joinpath("README.md").read_text(encoding="utf-8")
    whole, part = (tomllib.loads(block) for block in re.findall(r"```toml\n(.*?)```", text, re.DOTALL))
    made = parse(whole)
    assert (made.abscissa, made.trials) == ("level", 60)
    hands = parse({**RATED, "factors": {"left": [0.2, 1.0]}, **part})
    (surface,) = hands.targets({"left": 0.2}).surfaces
    assert (surface.name, surface.friction, surface.position_mm) == ("left", 0.2, (-50.0, 0.0))


@pytest.mark.parametrize("text", [b"\xff", b"a = ", b"name = 1"])
def test_a_file_that_is_no_experiment_is_one_sentence(text: bytes, tmp_path: Path, refused: Callable[..., str]) -> None:
    path = tmp_path / "own.toml"
    path.write_bytes(text)
    complaint = refused("run", "--participant", "P1", "--out", str(tmp_path), "--protocol", str(path))
    assert complaint.startswith(f"hapticd-study: {path}: ")


plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.just("$level"),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)


@settings(deadline=None)
@given(st.sampled_from([SPOT, BARE]), st.sampled_from([*SPOT, *BARE]), plain)
def test_whatever_a_field_holds_only_the_study_s_error_is_raised(base: dict[str, Any], name: str, value: Any) -> None:
    try:
        made = parse({**base, name: value})
    except StudyError:
        return
    assert 1 <= made.trials <= 1000


@pytest.mark.parametrize("name", ["", "-P", "a/b", "..", "P 3", "ä", "x" * 33, "P03\n"])
def test_an_invalid_name_is_refused(name: str) -> None:
    with pytest.raises(StudyError, match="participant"):
        participant_name(name)
    assert participant_name("P03-b_2") == "P03-b_2"
