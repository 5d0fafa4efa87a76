"""Progress: late enough to matter, with an estimate; a bar that is gone at the end, or lines in a pipe."""

from __future__ import annotations

import io
import sys

import pytest
import tqdm.std

from hapticd.tools.progress import progress_bar


@pytest.mark.parametrize(
    ("is_terminal", "shown"),
    [(True, "measuring [######..................]  25 %, 00:15 left"), (False, "measuring: 50 %, 05:00 left\n")],
)
def test_long_work_shows_what_is_left_and_short_work_nothing(
    monkeypatch: pytest.MonkeyPatch, is_terminal: bool, shown: str
) -> None:
    stream, t_s = io.StringIO(), 0.0
    monkeypatch.setattr(stream, "isatty", lambda: is_terminal)
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(tqdm.std, "time", lambda: t_s)
    with progress_bar("measuring") as progress:
        for t_s, done_frac in ((0.5, 0.1), (5.0, 0.25), (300.0, 0.5)):
            progress(done_frac)
            assert t_s > 0.5 or not stream.getvalue()
    assert shown in stream.getvalue()
    assert stream.getvalue().endswith("\r")
