"""A person's answers at the terminal: numbers, nothing, nonsense, and the end."""

from __future__ import annotations

import asyncio
import io

import pytest

from hapticd.errors import HapticdError
from hapticd.tools.calibrate.bench import Terminal


def answers(monkeypatch: pytest.MonkeyPatch, text: str) -> Terminal:
    monkeypatch.setattr("sys.stdin", io.StringIO(text))
    return Terminal()


def test_reading_is_a_number_with_a_point_or_a_comma(monkeypatch: pytest.MonkeyPatch) -> None:
    person = answers(monkeypatch, "3.31\n1,65\n\n")
    assert asyncio.run(person.read_supply(0)) == 3.31
    assert asyncio.run(person.read_idle(1)) == 1.65
    assert asyncio.run(person.read_output(0, 1.0)) is None


def test_nonsense_is_asked_for_again(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    person = answers(monkeypatch, "about three\nnan\n3.3\n")
    assert asyncio.run(person.read_supply(0)) == 3.3
    assert "'about three' is no number of volts" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["q\n", ""])
def test_q_and_the_end_of_input_stop_and_say_how_to_go_on(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(HapticdError, match="goes on here"):
        answers(monkeypatch, text).mend([])
