"""A session with a scripted participant, on a fake plate and clock."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from plates import FakeClient, Person

from hapticd.tools.study.conduct import REST_S, conduct
from hapticd.tools.study.panel import PanelKey, Screen
from hapticd.tools.study.protocol import Design, FrictionLevel
from hapticd.tools.study.session import Session, SessionFile, read
from hapticd.tools.study.stage import WALKER, Stage

TRIALS = 6
GIVEN = Session("P1", 3, Design(trials=TRIALS))


class LeftError(Exception):
    """The participant leaves."""


def sticky(screen: Screen) -> PanelKey:
    return PanelKey.HIGH if PanelKey.HIGH in screen.keys and PanelKey.NEXT not in screen.keys else PanelKey.NEXT


def hold(path: Path, person: Person, client: FakeClient, given: Session = GIVEN) -> None:
    with SessionFile(path, given) as file:
        conduct(file, Stage(client, given.design), person, client.clock)  # type: ignore[arg-type]


def test_each_trial_gives_finger_and_virtual_finger_what_its_combination_says(tmp_path: Path) -> None:
    client = FakeClient()
    hold(tmp_path / "P1.jsonl", Person(sticky), client)
    felt = [targets for targets in client.released if targets]
    expected = [{1: 1.0, WALKER: 0.0} if friction is FrictionLevel.LOW else {1: 0.0, WALKER: 1.0}
                for friction in GIVEN.presented]  # fmt: skip
    assert felt == [{1: 0.0, WALKER: 1.0}, *expected]  # the training begins with high friction
    assert client.targets_um == {}


def test_the_answers_and_how_the_plate_was_explored_are_kept(tmp_path: Path) -> None:
    client = FakeClient()
    client.limited = True
    hold(tmp_path / "P1.jsonl", Person(sticky), client)
    held = read(tmp_path / "P1.jsonl")
    assert held.is_over
    for trial, answer in enumerate(held.answers, 1):
        assert (answer.trial, answer.answer, answer.limited_frac) == (trial, FrictionLevel.HIGH, 1.0)
        assert answer.speed_mm_s == pytest.approx(50.0)
        assert answer.touched_s == pytest.approx(0.58)
        assert answer.took_s == pytest.approx(0.59)
    assert held.answers[1].t_unix_s - held.answers[0].t_unix_s == pytest.approx(REST_S + held.answers[1].took_s)


def test_nothing_on_the_screen_depends_on_what_is_presented(tmp_path: Path) -> None:
    shown = []
    for seed in (3, 4):
        person = Person(sticky)
        given = Session("P1", seed, Design(trials=TRIALS))
        hold(tmp_path / f"{seed}.jsonl", person, FakeClient(), given)
        shown.append((given.presented, person.screens, list(person.notes)))
    assert shown[0][0] != shown[1][0]
    assert shown[0][1:] == shown[1][1:]


def test_a_session_left_in_any_trial_continues_with_it(tmp_path: Path) -> None:
    for leaves_at in range(1, TRIALS + 1):
        path = tmp_path / f"{leaves_at}.jsonl"

        def leave(screen: Screen, trial: int = leaves_at) -> PanelKey:
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

    def pause_once(screen: Screen) -> PanelKey:
        if PanelKey.PAUSE in screen.keys and not paused:
            paused.append(screen)
            return PanelKey.PAUSE
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

    def impatient(screen: Screen) -> PanelKey:
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
    stage = Stage(client, Design())  # type: ignore[arg-type]
    stage.present(FrictionLevel.LOW)
    stage.step()
    client.finger = 2
    stage.step()
    assert client.targets_um == {WALKER: 0.0, 1: 1.0, 2: 1.0}
    client.targets_um.clear()
    client.instance = 2
    stage.step()
    assert client.targets_um == {2: 1.0}
    assert stage.touch.path_mm == pytest.approx(0.5)  # one step of finger 2; the change of fingers does not count


def test_the_training_presents_both_frictions_by_name_and_shows_the_speed(tmp_path: Path) -> None:
    client = FakeClient()
    client.speed_mm_s = 130.0
    choices = [PanelKey.LOW, PanelKey.HIGH, PanelKey.LOW, PanelKey.NEXT]

    def trained(screen: Screen) -> PanelKey:
        return choices.pop(0) if choices else sticky(screen)

    person = Person(trained)
    hold(tmp_path / "P1.jsonl", person, client)
    named = [screen.heading for screen in person.screens if screen.heading.startswith("Training")]
    assert named == [f"Training: {which} friction" for which in ("high", "low", "high", "low")]
    assert "130 mm/s, too fast: slower" in person.notes


def test_markers_name_each_trial_but_not_its_stimulus(tmp_path: Path) -> None:
    marked = []
    for seed in (3, 4):
        client = FakeClient()
        given = Session("P1", seed, Design(trials=2))
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
