"""A session with a scripted participant, on a fake plate and clock."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from people import paper
from plates import FakeClient, Person

from hapticd_study.conduct import conduct
from hapticd_study.experiment import parse
from hapticd_study.panel import Screen
from hapticd_study.session import Session, SessionFile, read
from hapticd_study.stage import Stage

TRIALS = 6
WALKER = "study-walker"
GIVEN = Session("P1", 3, paper(TRIALS))


class LeftError(Exception):
    """The participant leaves."""


def keys(screen: Screen) -> list[str]:
    return [key.name for key in screen.keys]


def sticky(screen: Screen) -> str:
    return "high" if "high" in keys(screen) and "next" not in keys(screen) else "next"


def hold(path: Path, person: Person, client: FakeClient, given: Session = GIVEN) -> Session:
    with SessionFile(path, given) as file:
        conduct(file, Stage(client, given.experiment), person, client)  # type: ignore[arg-type]
    return read(path)


def test_a_session_presents_its_combinations_and_keeps_answers_and_exploration(tmp_path: Path) -> None:
    client = FakeClient()
    client.limited = True
    held = hold(tmp_path / "P1.jsonl", Person(sticky), client)
    felt = [targets for targets in client.released if targets]
    expected = [{1: 1.0, WALKER: 0.0} if trial.correct == "low" else {1: 0.0, WALKER: 1.0}
                for trial in GIVEN.presented]  # fmt: skip
    assert felt == [{1: 0.0, WALKER: 1.0}, *expected]  # the training begins with high friction
    assert client.targets_um == {}
    assert held.is_over
    for trial, answer in enumerate(held.answers, 1):
        assert (answer.trial, answer.answer, answer.limited_frac) == (trial, "high", 1.0)
        assert (answer.felt_friction, answer.pressure_frac, answer.bias_jnd) == pytest.approx((0.25, 0.2, -0.5))
        assert (answer.speed_mm_s, answer.touched_s, answer.took_s) == pytest.approx((50.0, 0.58, 0.59))
    gap_s = held.answers[1].t_unix_s - held.answers[0].t_unix_s
    assert gap_s == pytest.approx(GIVEN.experiment.rest_s + held.answers[1].took_s)


def test_neither_screens_nor_markers_depend_on_what_is_presented(tmp_path: Path) -> None:
    shown = []
    for seed in (3, 4):
        person, client, given = Person(sticky), FakeClient(), Session("P1", seed, paper(TRIALS))
        hold(tmp_path / f"{seed}.jsonl", person, client, given)
        shown.append((given.presented, person.screens, list(person.notes), client.markers))
    assert shown[0][0] != shown[1][0]
    assert shown[0][1:] == shown[1][1:]
    assert shown[0][3][:3] == ["study P1 begins", "study P1 trial 1 start", "study P1 trial 1 answer high"]
    assert shown[0][3][-1] == "study P1 ends"


def test_a_session_left_in_any_trial_continues_with_it(tmp_path: Path) -> None:
    for leaves_at in range(1, TRIALS + 1):
        path = tmp_path / f"{leaves_at}.jsonl"

        def leave(screen: Screen, trial: int = leaves_at) -> str:
            if screen.heading == f"Trial {trial} of {TRIALS}":
                raise LeftError
            return sticky(screen)

        with pytest.raises(LeftError):
            hold(path, Person(leave), FakeClient())
        assert len(read(path).answers) == leaves_at - 1
        person = Person(sticky)
        assert hold(path, person, FakeClient()).is_over
        again = leaves_at > 1
        assert (person.screens[0].heading == f"{leaves_at - 1} of {TRIALS} answered") == again
        assert any(screen.heading.startswith("Training") for screen in person.screens) != again


def test_a_pause_stops_the_plate_and_repeats_the_trial(tmp_path: Path) -> None:
    client = FakeClient()
    paused: list[Any] = []

    def pause_once(screen: Screen) -> str:
        if "pause" in keys(screen) and not paused:
            paused.append(screen)
            return "pause"
        if screen.heading == f"0 of {TRIALS} answered":
            paused.append(dict(client.targets_um))
        return sticky(screen)

    held = hold(tmp_path / "P1.jsonl", Person(pause_once), client)
    assert paused[1] == {}
    felt = [targets for targets in client.released if targets]
    assert felt[1] == felt[2]
    assert [answer.trial for answer in held.answers] == list(range(1, TRIALS + 1))


def test_an_answer_without_a_touch_does_not_count(tmp_path: Path) -> None:
    client = FakeClient()
    client.finger = None
    presses = 0

    def impatient(screen: Screen) -> str:
        nonlocal presses
        presses += screen.heading == f"Trial 1 of {TRIALS}"
        if presses == 3:
            client.finger = 2
        return sticky(screen)

    person = Person(impatient)
    held = hold(tmp_path / "P1.jsonl", person, client)
    assert presses == 4
    assert list(person.notes).count("Touch the plate first.") == 3
    assert held.answers[0].touched_s == pytest.approx(0.58)


def test_the_training_presents_both_frictions_by_name_and_shows_the_speed(tmp_path: Path) -> None:
    client = FakeClient()
    client.speed_mm_s = 130.0
    choices = ["low", "high", "low", "next"]
    person = Person(lambda screen: choices.pop(0) if choices else sticky(screen))
    hold(tmp_path / "P1.jsonl", person, client)
    named = [screen.heading.removeprefix("Training: ") for screen in person.screens]
    assert named[:4] == ["high", "low", "high", "low"]
    assert "130 mm/s, too fast: slower" in person.notes


PAIR = {
    "question": "Which is more slippery?",
    "trials": 4,
    "practice": 1,
    "feedback": True,
    "break_after": 2,
    "intervals": {"of": "level", "standard": 1.0, "touched_s": 0.3, "pause_s": 0.1},
    "adaptive": {"method": "staircase", "start": 0.5, "step": 0.1, "lowest": 0.1, "highest": 0.9, "harder": "higher"},
    "plate": {"targets": [{"finger": 1, "friction": "$level"}, {"finger": 2, "friction": 1.0}]},
}


def test_two_intervals_are_felt_one_after_the_other_with_feedback_and_a_break(tmp_path: Path) -> None:
    client = FakeClient()

    def answered(screen: Screen) -> str | None:
        return None if keys(screen) == ["pause"] else "first" if "first" in keys(screen) else "next"

    person = Person(answered)
    held = hold(tmp_path / "P1.jsonl", person, client, Session("P1", 3, parse(PAIR)))
    assert held.is_over
    texts = [screen.text for screen in person.screens]
    one = ["The plate is at rest: wait a moment.", "The first one: move over the plate."]
    one += ["The plate is at rest: wait a moment.", "The second one: move over the plate.", PAIR["question"]]
    assert texts[:5] == one
    assert texts.count("Right.") + texts.count("Wrong.") == 5  # the practice and four trials
    assert texts.count("Wrong.") == sum(t.correct == "second" for t in held.presented) + (texts[5] == "Wrong.")
    assert sum(text.startswith("The plate is at rest. You can") for text in texts) == 1  # the break
    assert len({trial.levels["level"] for trial in held.presented}) > 1
    both = ["interval first", "interval second"]
    assert client.markers[:2] == [f"study P1 practice 1 {what}" for what in both]
    assert client.markers[3:6] == [f"study P1 trial 1 {what}" for what in ("start", *both)]


def test_each_finger_gets_its_target_as_it_lands_also_again_and_from_another_daemon() -> None:
    client = FakeClient()
    stage = Stage(client, parse(PAIR))  # type: ignore[arg-type]
    stage.present({"level": 0.5})
    assert client.message.targets == ()
    for fingers, instance, expected in (
        ((1,), 1, [(1, 0.5)]),
        ((1, 7, 9), 1, [(1, 0.5), (7, 1.0)]),
        ((2, 7), 1, [(2, 0.5), (7, 1.0)]),
        ((2, 7), 2, [(2, 0.5), (7, 1.0)]),
    ):
        client.finger, client.more, client.instance = fingers[0], fingers[1:], instance
        client.message = None  # type: ignore[assignment]
        stage.step()
        assert [(one.finger, one.friction) for one in client.message.targets] == expected
    assert stage.touch.path_mm == pytest.approx(1.0)  # two steps; the change of fingers does not count
