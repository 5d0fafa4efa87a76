"""`hapticd stream`: refused arguments and missing libraries, each one sentence."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest

from hapticd.__main__ import main


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("prometheus", "--port", "70000"), "--port: 70000 is out of bounds"),
        (("prometheus", "--port", "0", "--endpoint", "tcp://plate:7410"), "needs two keys"),
    ],
)
def test_invalid_arguments_are_one_sentence(arguments: tuple[str, ...], word: str, refused: Callable[..., str]) -> None:
    assert word in refused("stream", *arguments)


@pytest.mark.parametrize(
    ("action", "module", "library"),
    [("prometheus", "prometheus_client", "prometheus-client"), ("lsl", "pylsl", "pylsl")],
)
def test_a_missing_library_is_named_with_what_installs_it(
    action: str, module: str, library: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    assert main(["stream", action]) == 1
    assert f"run `{sys.executable} -m pip install '{library}>=" in capsys.readouterr().err
