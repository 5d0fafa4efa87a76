"""A participant's file: of comparisons at the terminal or on a page, or of a force sensor; what the service takes."""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import SplitResult, urlsplit

import numpy as np
import pytest
from aiohttp import ClientSession
from asynchronous import until

from hapticd.__main__ import main
from hapticd.config import person as participants
from hapticd.config.sections import Config, PlateConfig
from hapticd.core.friction import FrictionCurve
from hapticd.daemon.settings import friction_curve
from hapticd.sim.observer import KINDS, SimulatedObserver
from hapticd.tools.calibrate import person

SEED = 2
SERVED = FrictionCurve.exponential(decay_um=0.8)


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


class Plate:
    """A client of a plate that one finger strokes, and an observer, who answers by what it then feels."""

    def __init__(self) -> None:
        self.laid_um, self.gain = [0.0], 1.0
        self.observer = SimulatedObserver(KINDS["keen"], SEED)

    def __enter__(self) -> Plate:
        return self

    def __exit__(self, *_: object) -> None:
        self.laid_um.append(0.0)

    def plate(self) -> dict[str, Any]:
        relative = (1.0, SERVED.floor_frac)
        return {"friction_curve": [[um, share] for um, share in zip((0.0, SERVED.full_um), relative, strict=True)]}

    def surface(self, _: str, *, amplitude_um: float) -> None:
        self.laid_um.append(amplitude_um)

    def remove(self, _: str) -> None:
        self.laid_um.append(0.0)

    def states(self, _: float) -> Iterator[Any]:
        one = SimpleNamespace(virtual=False, contact_um=0.0, felt_friction=1.0, x_mm=0.0, y_mm=0.0)
        yield SimpleNamespace(fingers=(one, one), t_ns=0)
        for t_ns in count(10**7, 10**7):
            one.x_mm = abs(1e-7 * t_ns % 200.0 - 100.0)  # at 100 mm/s, to and fro
            time.sleep(0.0)  # the page's thread goes on
            one.contact_um = 1.2 * self.laid_um[-1]  # RMS: it is uneven
            one.felt_friction = SERVED.friction_frac(SERVED.friction(0.95 * self.laid_um[-1]))
            yield SimpleNamespace(fingers=(one,), t_ns=t_ns)

    def answer(self, _: str = "") -> str:
        return "P " if self.observer.compare(self.gain * 0.95 / 1.05 * self.laid_um[-1]).is_slipperier else "r"

    def visit(self, link: str) -> None:
        """Answer as a browser that was opened with a file that leads to the page."""
        found = re.findall('url=([^"]+)', Path(urlsplit(link).path).read_text())
        asyncio.run(self.answer_at(urlsplit(found[0])))

    async def answer_at(self, address: SplitResult) -> None:
        origin, shown = f"http://{address.netloc}", dict[str, Any]()
        async with ClientSession(headers={"Origin": origin}) as session:
            assert (await session.get(f"{origin}/")).status == 403
            assert "person.js" in await (await session.get(address.geturl())).text()
            for last in (3, 41):  # answers, after which the page is gone
                async with session.ws_connect(f"{origin}/socket?{address.query}") as socket:
                    async with session.ws_connect(f"{origin}/socket?{address.query}") as second:
                        assert "close one" in str((await second.receive()).extra)
                    while "floors" not in shown and shown.get("done", 0) < last:
                        if (shown := await socket.receive_json()).get("is_ready"):
                            await socket.send_str("plate" if self.answer() == "P " else "reference")
                await until(lambda: self.laid_um[-1] == 0.0)
        floor, low, high = shown["floors"]
        assert low < floor < high


@pytest.mark.parametrize("front", [(), ("--browser",)], ids=["terminal", "page"])
def test_the_person_at_a_front_strokes_an_even_plate_and_a_check_keeps_the_curve(
    front: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plate = Plate()

    def call(*arguments: str) -> int:
        return main(["calibrate", "person", "--participant", "anna", "--out", str(tmp_path), *front, *arguments])

    monkeypatch.setattr(person, "Client", lambda *_, **__: plate)
    monkeypatch.setattr("builtins.input", plate.answer)
    monkeypatch.setenv("DISPLAY", "a screen")
    monkeypatch.setattr("webbrowser.open", plate.visit)
    assert call() == 0
    file = participants.folder_of(tmp_path, "anna") / participants.FILE
    curve = friction_curve(Config(plate=participants.load(file, PlateConfig())[0]))
    assert curve.speed_gain(100.0) == 1.05
    assert curve.friction(1.0) == pytest.approx(plate.observer.curve.friction(1.0), rel=0.1)
    assert plate.laid_um[-1] == 0.0
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
        (["person", "--sim", "--participant", "anna", "--browser"], "leave out one of them"),
        (["person", "--sim", "--participant", "anna", "--reference", "0.9"], "out of bounds"),
        (["all", "--sim", "--participant", "anna"], "for one step"),
    ):
        assert main(["calibrate", *arguments, "--out", str(tmp_path)]) != 0
        complaint = capsys.readouterr().err
        assert sentence in complaint
        assert complaint.count("\n") == 1
