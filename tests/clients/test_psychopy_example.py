"""The PsychoPy example, with a substitute of PsychoPy: a screen of texts, and a participant who presses keys."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from fake_daemon import FakeDaemon

from hapticd_client import Client

EXAMPLE = Path(__file__).parents[2] / "clients" / "examples" / "psychopy" / "two_intervals.py"


class Screen:
    """What the example does with PsychoPy: the texts that were shown, the frictions that lay there meanwhile."""

    def __init__(self, daemon: FakeDaemon, keys: list[str]) -> None:
        self._daemon = daemon
        self._keys = keys
        self.shown: list[str] = []
        self.felt_um: list[float] = []
        self.saved: list[tuple[str, list[dict[str, Any]]]] = []
        self.is_closed = False

    def modules(self) -> dict[str, ModuleType]:
        parts: dict[str, Any] = {
            "core": SimpleNamespace(wait=lambda _s: self.felt_um.append(self._daemon.felt_um(0.0)), Clock=object),
            "event": SimpleNamespace(waitKeys=self._wait_keys),
            "data": SimpleNamespace(TrialHandler=self._handler),
            "visual": SimpleNamespace(Window=self._window, TextStim=self._text),
        }
        package = ModuleType("psychopy")
        for name, part in parts.items():
            setattr(package, name, part)
        return {"psychopy": package}

    def _wait_keys(self, keyList: list[str], timeStamped: object) -> list[tuple[str, float]]:
        assert timeStamped is not None
        key = self._keys.pop(0)
        assert key in keyList
        return [(key, 0.7)]

    def _window(self, **_options: object) -> SimpleNamespace:
        def close() -> None:
            self.is_closed = True

        return SimpleNamespace(flip=lambda: None, close=close)

    def _text(self, _window: object, **_options: object) -> SimpleNamespace:
        text = SimpleNamespace(text="")
        text.draw = lambda: self.shown.append(text.text)
        return text

    def _handler(self, conditions: list[dict[str, float]], repeats: int, method: str) -> Any:
        assert method == "random"
        screen = self

        class Handler:
            """One row for each trial."""

            def __init__(self) -> None:
                self.rows: list[dict[str, Any]] = []

            def __iter__(self) -> Any:
                for condition in conditions * repeats:
                    self.rows.append(dict(condition))
                    yield condition

            def addData(self, name: str, value: object) -> None:
                self.rows[-1][name] = value

            def saveAsWideText(self, path: str, delim: str) -> None:
                assert delim == "\t"
                screen.saved.append((path, self.rows))

        return Handler()


class NoRecording:
    """In place of a recording, which needs a whole service."""

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        pass


def run(daemon: FakeDaemon, keys: list[str], monkeypatch: pytest.MonkeyPatch) -> tuple[Screen, list[str]]:
    recorded: list[str] = []

    def record(_client: Client, path: str) -> NoRecording:
        recorded.append(path)
        return NoRecording()

    screen = Screen(daemon, keys)
    for name, module in screen.modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(Client, "record", record)
    spec = importlib.util.spec_from_file_location("two_intervals", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(["--participant", "P03", "--repeats", "1", "--endpoint", str(daemon.directory)])
    return screen, recorded


def test_each_trial_lays_two_frictions_marks_what_happens_and_keeps_the_answer(
    daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    screen, recorded = run(daemon, ["1", "2", "1", "2"], monkeypatch)
    assert recorded == ["sub-P03_task-twointervals_physio.mcap"]
    assert [min(pair) for pair in zip(screen.felt_um[::2], screen.felt_um[1::2], strict=True)] == [0.0] * 4
    slippery_um = [max(pair) for pair in zip(screen.felt_um[::2], screen.felt_um[1::2], strict=True)]
    assert slippery_um == sorted(slippery_um, reverse=True)  # the levels rise to bare glass
    assert [one.fields["event"] for one in daemon.markers[:3]] == ["first", "second", "answer"]
    ((path, rows),) = screen.saved
    assert path == "sub-P03_task-twointervals_beh.tsv"
    assert [row["answer"] for row in rows] == ["first", "second", "first", "second"]
    assert all(
        row["is_right"] == marker.fields["is_right"] for row, marker in zip(rows, daemon.markers[2::3], strict=True)
    )
    assert screen.is_closed
