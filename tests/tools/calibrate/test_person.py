"""A participant's file: from comparisons at the terminal, or from a force sensor, and what the service takes of it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.config import person as participants
from hapticd.config.sections import Config, PlateConfig
from hapticd.daemon.settings import friction_curve
from hapticd.sim.observer import KINDS, SimulatedObserver
from hapticd.tools.calibrate import person

SEED = 2


def test_comparisons_and_a_force_sensor_give_the_same_file_and_agree(tmp_path: Path) -> None:
    true = SimulatedObserver(KINDS["usual"], SEED).curve
    levels_um = np.repeat(np.linspace(0.0, 2.6, 27), 5)
    noise = 0.005 * np.random.default_rng(1).standard_normal(len(levels_um))
    readings = zip(levels_um, true.frictions(levels_um, np.zeros(1)) + noise, strict=True)
    file = tmp_path / "anna.csv"
    file.write_text("\n".join(("amplitude_um,friction", *(f"{um:.3f},{value:.5f}" for um, value in readings))))
    plate = PlateConfig(modes_file=str(tmp_path / "modes.npz"), friction_speed_mm_s=40.0)
    results = participants.folder_of(tmp_path, "anna")
    compared = ("person", "--sim", "--seed", str(SEED))
    for arguments in (compared, ("friction", "--readings", str(file), "--finger", "left thumb")):
        (results / "person.json").unlink(missing_ok=True)  # of the simulated plate, which is kept apart
        assert main(["calibrate", *arguments, "--participant", "anna", "--out", str(tmp_path)]) == 0
        found, note = participants.find("anna", plate)
        assert note == ""
        curve = friction_curve(Config(plate=found))
        for um in (0.25, 0.5, 1.0):
            assert curve.friction(um) == pytest.approx(true.friction(um), rel=0.1)
    assert found.friction_speed_mm_s == 40.0  # of the plate: none was measured
    written = (results / participants.FILE).read_text()
    assert 'finger = "left thumb"' in written
    (results / participants.FILE).write_text(re.sub(r'date = "[\d-]+"', 'date = "2026-01-02"', written))
    assert "is of 2026-01-02" in participants.find("anna", plate)[1]


def test_the_person_at_the_terminal_strokes_an_even_plate_and_a_check_keeps_the_curve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    laid_um: list[float] = []

    class Plate:
        gain = 1.0

        def __enter__(self) -> Plate:
            return self

        def __exit__(self, *_: object) -> None:
            laid_um.append(0.0)

        def surface(self, _: str, *, amplitude_um: float) -> None:
            laid_um.append(amplitude_um)

        def states(self) -> Iterator[Any]:
            one = SimpleNamespace(virtual=False, contact_um=0.95 * laid_um[-1])
            yield SimpleNamespace(fingers=(one, one))
            while True:
                yield SimpleNamespace(fingers=(one,))

    plate, observer = Plate(), SimulatedObserver(KINDS["keen"], SEED)

    def answer(_: str) -> str:
        return "P " if observer.compare(plate.gain * 0.95 * laid_um[-1]).is_slipperier else "r"

    def call(*arguments: str) -> int:
        return main(["calibrate", "person", "--participant", "anna", "--out", str(tmp_path), *arguments])

    monkeypatch.setattr(person, "Client", lambda *_, **__: plate)
    monkeypatch.setattr("builtins.input", answer)
    assert call() == 0
    file = participants.folder_of(tmp_path, "anna") / participants.FILE
    curve = friction_curve(Config(plate=participants.load(file, PlateConfig())[0]))
    assert curve.friction(1.0) == pytest.approx(observer.curve.friction(1.0), rel=0.1)
    assert laid_um[-1] == 0.0
    written = file.read_text()
    for plate.gain, sentence in ((1.0, "comparisons confirm"), (1.5, "measure again")):
        assert call("--check", "--finger", "left thumb") == 0
        assert sentence in capsys.readouterr().out
        assert file.read_text() == written


def test_a_wrong_call_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, sentence in (
        (["person", "--sim"], "add --participant NAME"),
        (["person", "--sim", "--participant", "../anna"], "is no participant's name"),
        (["person", "--sim", "--participant", "anna", "--check"], "has no curve to check"),
        (["person", "--sim", "--participant", "anna", "--reference", "0.9"], "out of bounds"),
        (["all", "--sim", "--participant", "anna"], "for one step"),
    ):
        assert main(["calibrate", *arguments, "--out", str(tmp_path)]) != 0
        complaint = capsys.readouterr().err
        assert sentence in complaint
        assert complaint.count("\n") == 1
