"""`hapticd stream`: a refused endpoint and a missing library, each one sentence."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest

from hapticd.__main__ import main
from hapticd.tools.record import inlets


def test_an_unusable_endpoint_is_one_sentence(refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inlets, "pylsl", lambda: None)
    assert "needs two keys" in refused("stream", "lsl", "--endpoint", "tcp://plate:7410")


def test_a_missing_library_is_named_with_what_installs_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pylsl", None)
    assert main(["stream", "lsl"]) == 1
    assert f"run `{sys.executable} -m pip install 'pylsl>=" in capsys.readouterr().err
