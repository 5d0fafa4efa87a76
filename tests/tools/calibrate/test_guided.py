"""`hapticd calibrate touch --guided`: what it says while it records."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from hapticd.__main__ import main
from hapticd.design.touch.guide import GUIDED_S
from hapticd.tools.calibrate import guided
from hapticd.tools.calibrate.guided import Guide
from hapticd.tools.record import attach


def test_it_says_where_to_touch_from_the_recording_s_start_on_and_ends() -> None:
    said: list[str] = []
    begun: list[float] = []
    t_s = 0.0
    guide = Guide(lambda: begun.append(t_s), said.append, lambda: t_s)
    guide.notify(attach.WAITING)
    t_s = 5.0
    assert not guide.is_ended()
    assert said == [attach.WAITING]
    guide.notify(attach.BEGUN)
    guide.notify(attach.LATE)
    assert begun == [5.0]
    ends = []
    for tick in range(round(10 * GUIDED_S) + 1):
        t_s = 5.0 + 0.1 * tick
        ends.append(guide.is_ended())
    assert ends.index(True) == round(10 * GUIDED_S)
    assert said[3] == " 60 s left: stroke the lower left quarter with one finger, the upper right one with another"
    assert 60 <= len(said) < 80


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("--guided", "session.mcap"), "either a RECORDING"),
        ((), "either a RECORDING"),
        (("session.mcap", "--sim"), "only with --guided"),
    ],
)
def test_what_does_not_go_together_is_refused(
    arguments: tuple[str, ...], why: str, tmp_path: Path, refused: Callable[..., str]
) -> None:
    assert why in refused("calibrate", "touch", *arguments, "--out", str(tmp_path / "out"))


@pytest.mark.long
def test_simulated_fingers_are_recorded_and_calibrated_by(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guided, "GUIDED_S", 2.0)
    out = tmp_path / "out"
    for _ in range(2):  # the recording of the run before is replaced
        assert main(["calibrate", "touch", "--guided", "--sim", "--out", str(out)]) == 1
        assert "Nothing is adopted. Only 2.0 s of touching" in capsys.readouterr().out
    assert (out / "touch.mcap").is_file()
