"""A session with a scripted participant, on a fake plate and clock."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from people import paper
from plates import FakeClient, Person

from hapticd.tools.study.conduct import conduct
from hapticd.tools.study.experiment import parse
from hapticd.tools.study.panel import Screen
from hapticd.tools.study.session import Session, SessionFile, read
from hapticd.tools.study.stage import Stage

TRIALS = 6
WALKER = "study-walker"
GIVEN = Session("P1", 3, paper(TRIALS))


class LeftError(Exception):
    """The participant leaves."""


def keys(screen: Screen) -> list[str]:
    return [key.name for key in screen.keys]


def sticky(screen: Screen) -> str:
    return "high" if "high" in keys(screen) and "next" not in keys(screen) else "next"


def hold(path: Path, person: Person, client: FakeClient, given: Session = GIVEN) -> None:
    with SessionFile(path, given) as file:
        conduct(file, Stage(client, given.experiment), person, client.clock)  # type: ignore[arg-type]


def test_each_trial_gives_finger_and_virtual_finger_what_its_combination_says(tmp_path: Path) -> None:
    client = FakeClient()
    hold(tmp_path / "P1.jsonl", Person(sticky), client)
    felt = [targets for targets in client.released if targets]
    expected = [{1: 1.0, WALKER: 0.0} if trial.correct == "low" else {1: 0.0, WALKER: 1.0}
                for trial in GIVEN.presented]  # fmt: skip
    assert felt == [{1: 0.0, WALKER: 1.0}, *expected]  # the training begins with high friction
    assert client.targets_um == {}


def test_the_answers_and_how_the_plate_was_explored_are_kept(tmp_path: Path) -> None:
    client = FakeClient()
    client.limited = True
    hold(tmp_path / "P1.jsonl", Person(sticky), client)
    held = read(tmp_path / "P1.jsonl")
    assert held.is_over
    for trial, answer in enumerate(held.answers, 1):
        assert (answer.trial, answer.answer, answer.limited_frac) == (trial, "high", 1.0)
        assert answer.speed_mm_s == pytest.approx(50.0)
        assert answer.touched_s == pytest.approx(0.58)
        assert answer.took_s == pytest.approx(0.59)
    assert held.answers[1].t_unix_s - held.answers[0].t_unix_s == pytest.approx(
        GIVEN.experiment.rest_s + held.answers[1].took_s
    )


def test_nothing_on_the_screen_depends_on_what_is_presented(tmp_path: Path) -> None:
    shown = []
    for seed in (3, 4):
        person = Person(sticky)
        given = Session("P1", seed, paper(TRIALS))
        hold(tmp_path / f"{seed}.jsonl", person, FakeClient(), given)
        shown.append((given.presented, person.screens, list(person.notes)))
    assert shown[0][0] != shown[1][0]
    assert shown[0][1:] == shown[1][1:]


def test_a_session_left_in_any_trial_continues_with_it(tmp_path: Path) -> None:
    for leaves_at in range(1, TRIALS + 1):
        path = tmp_path / f"{leaves_at}.jsonl"

        def leave(screen: Screen, trial: int = leaves_at) -> str:
            if screen.heading == f"Trial {trial} of {TRIALS}":
                raise LeftError
            return sticky(screen)

        for answer in (leave, sticky):
            person = Person(answer)
            try:
                hold(path, person, FakeClient())
            except LeftError:
                assert len(read(path).answers) == leaves_at - 1
        assert read(path).is_over
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

    hold(tmp_path / "P1.jsonl", Person(pause_once), client)
    assert paused[1] == {}
    felt = [targets for targets in client.released if targets]
    assert felt[1] == felt[2]
    assert [answer.trial for answer in read(tmp_path / "P1.jsonl").answers] == list(range(1, TRIALS + 1))


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
    hold(tmp_path / "P1.jsonl", person, client)
    assert presses == 4
    assert list(person.notes).count("Touch the plate first.") == 3
    assert read(tmp_path / "P1.jsonl").answers[0].touched_s == pytest.approx(0.58)


def test_a_finger_that_lands_again_or_meets_another_daemon_gets_its_target() -> None:
    client = FakeClient()
    stage = Stage(client, paper())  # type: ignore[arg-type]
    stage.present({"friction": "low"})
    stage.step()
    client.finger = 2
    stage.step()
    assert client.targets_um == {WALKER: 0.0, 2: 1.0}
    client.targets_um.clear()
    client.instance = 2
    stage.step()
    assert client.targets_um == {WALKER: 0.0, 2: 1.0}
    assert stage.touch.path_mm == pytest.approx(0.5)  # one step of finger 2; the change of fingers does not count


def test_the_training_presents_both_frictions_by_name_and_shows_the_speed(tmp_path: Path) -> None:
    client = FakeClient()
    client.speed_mm_s = 130.0
    choices = ["low", "high", "low", "next"]

    def trained(screen: Screen) -> str:
        return choices.pop(0) if choices else sticky(screen)

    person = Person(trained)
    hold(tmp_path / "P1.jsonl", person, client)
    named = [screen.heading for screen in person.screens if screen.heading.startswith("Training")]
    assert named == [f"Training: {which}" for which in ("high", "low", "high", "low")]
    assert "130 mm/s, too fast: slower" in person.notes


def test_markers_name_each_trial_but_not_its_stimulus(tmp_path: Path) -> None:
    marked = []
    for seed in (3, 4):
        client = FakeClient()
        given = Session("P1", seed, paper(2))
        hold(tmp_path / f"{seed}.jsonl", Person(sticky), client, given)
        marked.append(client.markers)
    assert marked[0] == marked[1]
    assert marked[0] == [
        "study P1 begins",
        "study P1 trial 1 start",
        "study P1 trial 1 answer high",
        "study P1 trial 2 start",
        "study P1 trial 2 answer high",
        "study P1 ends",
    ]


SPOT_ON = [{"finger": 1, "friction": "$level"}, {"finger": 2, "friction": 1.0}]
PAIR = {
    "question": "Which is more slippery?",
    "trials": 4,
    "practice": 1,
    "feedback": True,
    "break_after": 2,
    "intervals": {"of": "level", "standard": 0.9, "touched_s": 0.5},
    "adaptive": {"method": "staircase", "start": 0.5, "step": 0.1, "lowest": 0.1, "highest": 0.8, "harder": "higher"},
    "plate": {"targets": SPOT_ON},
}


def test_two_intervals_are_felt_in_turn_then_the_answer_is_asked_and_graded(tmp_path: Path) -> None:
    given, client = Session("P1", 3, parse(PAIR)), FakeClient()
    screens: list[tuple[str, float | None]] = []

    def first(screen: Screen) -> str | None:
        return next((name for name in ("next", "first") if name in keys(screen)), None)

    class Watched(Person):
        def show(self, screen: Screen) -> None:
            super().show(screen)
            targets = client.message.targets if client.targets_um else ()
            screens.append((screen.text, targets[0].friction if targets else None))

    hold(tmp_path / "P1.jsonl", Watched(first), client, given)
    held = read(tmp_path / "P1.jsonl")
    assert held.is_over
    texts = [text for text, _ in screens]
    one = ["The plate is at rest: wait a moment.", "The first one: move over the plate."]
    one += ["The plate is at rest: wait a moment.", "The second one: move over the plate.", PAIR["question"]]
    assert texts[:5] == one
    assert texts.count("Right.") + texts.count("Wrong.") == 5  # the practice and four trials
    assert texts.count("Wrong.") == sum(t.correct == "second" for t in held.presented) + (texts[5] == "Wrong.")
    assert sum(text.startswith("The plate is at rest. You can") for text in texts) == 1  # the break
    assert [len({trial.levels["level"] for trial in held.presented})] != [1]
    both = ["interval first", "interval second"]
    assert client.markers[:2] == [f"study P1 practice 1 {what}" for what in both]
    assert client.markers[3:6] == [f"study P1 trial 1 {what}" for what in ("start", *both)]


def test_each_of_two_fingers_gets_its_own_target_in_the_order_in_which_they_landed() -> None:
    client = FakeClient()
    stage = Stage(client, parse(PAIR))  # type: ignore[arg-type]
    stage.present({"level": 0.5})
    assert client.message.targets == ()
    stage.step()
    assert [(one.finger, one.friction) for one in client.message.targets] == [(1, 0.5)]
    client.more = (7, 9)
    stage.step()
    assert [(one.finger, one.friction) for one in client.message.targets] == [(1, 0.5), (7, 1.0)]
    assert stage.touch.felt_friction == 0.25
    assert stage.touch.pressure_frac == pytest.approx(0.2)
