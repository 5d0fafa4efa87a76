"""`hapticd play`, and what it plays, on the machine in lock-step: each file is felt at its time, where it lies."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_daemon import FakeDaemon
from machine_bench import SLIPPERY, STICKY, Bench
from PIL import Image

from hapticd.__main__ import main
from hapticd.errors import ExitCode
from hapticd_client import content
from hapticd_client.asset import asset_of, upload
from hapticd_client.checks import checked
from hapticd_client.target_set import TargetSet
from hapticd_client.targets import Asset
from hapticd_contract.effects import Effect, Form, Start
from hapticd_contract.surfaces import Shape, Surface, shape_field


def pattern(folder: Path, *times_s: float) -> Path:
    """An AHAP file with clicks."""
    events = [{"Event": {"Time": t_s, "EventType": "HapticTransient"}} for t_s in times_s]
    path = folder / "clicks.ahap"
    path.write_text(json.dumps({"Version": 1.0, "Pattern": events}), encoding="utf-8")
    return path


class BenchPlate:
    """The calls of a client that content makes, as messages to a machine in virtual time."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.targets = TargetSet()
        self.given_um: dict[int, list[tuple[float, float]]] = {}
        self.begin_s = self.clock()

    def status(self) -> dict[str, Any]:
        body = self.bench.ask("status")["body"]
        assert isinstance(body, dict)
        return body

    def asset(self, rows: Any) -> Asset:
        asset = asset_of(rows)
        upload(lambda body: self.bench.ask("asset", **body)["body"], "content", asset)
        return asset

    def surface(self, name: str, shape: Shape | None, *, position_mm: Any, z: int, **given: Any) -> None:
        if "map" in given:
            given["map"] = given["map"].message
        surface = Surface(name=name, position_mm=position_mm, z=z, **shape_field(shape), **given)
        self._send(self.targets.with_surface(checked(surface), 5.0))

    def effect(self, name: str, form: Form, *, start: Start) -> None:
        self._send(self.targets.with_effect(checked(Effect.of(form, None, start, name=name)), 5.0))

    def stop(self, name: str) -> None:
        self._send(self.targets.without_effect(name))

    def sleep(self, seconds: float) -> None:
        for _ in range(round(seconds * 1000)):
            self.bench.run(1)
            tick = self.bench.machine.last_tick
            for point in tick.points if tick is not None else ():
                assert isinstance(point.key, int)
                self.given_um.setdefault(point.key, []).append((self.clock() - self.begin_s, point.target_um))

    def clock(self) -> float:
        return self.bench.t_ns * 1e-9

    def _send(self, targets: TargetSet) -> None:
        self.targets = targets
        self.bench.machine.targets(targets.payload("content", None), self.bench.t_ns, "")
        assert self.bench.machine.clients.refused == 0, self.bench.machine.clients.last_refusal


def landed(*fingers_mm: tuple[float, float]) -> BenchPlate:
    bench = Bench(*fingers_mm)
    bench.run(500)
    return BenchPlate(bench)


def test_each_click_is_given_to_all_fingers_at_its_time_and_nothing_in_between(tmp_path: Path) -> None:
    plate = landed(SLIPPERY, STICKY)
    score = content.load(pattern(tmp_path, 0.0, 0.4), high_um=1.2)
    score.play(plate, sleep=plate.sleep, clock=plate.clock)
    assert sorted(plate.given_um) == [1, 2]
    for given_um in plate.given_um.values():
        felt_s = [t_s for t_s, um in given_um if um > 0.3]
        assert max(um for _, um in given_um) == pytest.approx(1.2, abs=0.3)
        for begin_s in (0.1, 0.5):
            assert any(begin_s - 0.02 <= t_s <= begin_s + 0.04 for t_s in felt_s)
        assert all(min(abs(t_s - 0.1), abs(t_s - 0.5)) < 0.06 for t_s in felt_s)
    assert plate.targets.effects == {}


def test_a_picture_of_1024_pixels_is_given_where_it_lies(tmp_path: Path) -> None:
    plate = landed(SLIPPERY, STICKY)
    levels = np.zeros((1024, 1024), dtype=np.uint8)
    levels[:, :512] = 255
    Image.fromarray(levels).save(tmp_path / "half.png")
    content.load(tmp_path / "half.png", high_um=1.0).play(plate, 0.3, sleep=plate.sleep, clock=plate.clock)
    assert {finger: given_um[-1][1] for finger, given_um in plate.given_um.items()} == {1: 1.0, 2: 0.0}
    assert plate.status()["assets"] == {"count": 1, "uploads": 0, "bytes": 2**20}


# --- the command ------------------------------------------------------------------------------------------------


def test_the_command_plays_a_file_prints_what_is_dropped_and_ends(
    daemon: FakeDaemon, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    daemon.fingers = {1: (0.0, 0.0)}
    path = pattern(tmp_path, 0.0)
    text = path.read_text(encoding="utf-8").replace("]", ', {"Event": {"EventType": "AudioCustom"}}]')
    path.write_text(text, encoding="utf-8")
    assert main(["play", str(path), "--endpoint", str(daemon.directory), "--seconds", "0.2"]) == ExitCode.DONE
    printed = capsys.readouterr()
    assert printed.out == "clicks.ahap: 0.02 s of effects\nno finger touched the plate\n"
    assert printed.err == "not felt as it is: events AudioCustom.\n"


@pytest.mark.parametrize(
    ("name", "options", "sentence"),
    [
        ("no.wav", [], "no.wav: cannot be read (No such file or directory).\n"),
        ("a.mp3", [], "a.mp3: must end in one of .png, .jpg,"),
        ("a.ahap", ["--sim", "--endpoint", "."], "--sim starts a service of its own: it cannot be combined"),
        ("a.ahap", ["--friction"], "a.ahap: a width and friction are for pictures.\n"),
    ],
)
def test_a_wrong_call_is_one_sentence(
    name: str, options: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["play", str(tmp_path / name), *options]) == ExitCode.WRONG_CALL
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(
    ("width_mm", "sentence"),
    [
        ("900", "900 x 450 mm is larger than the plate of 137.5 x 137.5 mm: give 0.1 .. 137.5."),
        ("137.6", "137.6 x 68.8 mm is larger than the plate of 137.5 x 137.5 mm: give 0.1 .. 137.5."),
        ("0.05", "--width-mm: 0.05 is out of bounds, it must be 0.1 .. 1000."),
        ("nan", "--width-mm: nan is out of bounds, it must be 0.1 .. 1000."),
    ],
)
def test_a_picture_wider_than_the_plate_is_refused_before_it_is_laid(
    width_mm: str, sentence: str, daemon: FakeDaemon, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Image.fromarray(np.full((8, 16), 200, dtype=np.uint8)).save(tmp_path / "wide.png")
    call = ["play", str(tmp_path / "wide.png"), "--endpoint", str(daemon.directory), "--seconds", "0.1"]
    assert main([*call, "--width-mm", width_mm]) == ExitCode.WRONG_CALL
    assert capsys.readouterr().err.endswith(f"{sentence}\n")
    assert not daemon.scene.surfaces.layers
    assert main([*call, "--width-mm", "137.5"]) == ExitCode.DONE


@pytest.mark.long
def test_a_file_is_played_on_the_simulated_plate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = pattern(tmp_path, *[0.05 * index for index in range(20)])
    assert main(["play", str(path), "--sim"]) == ExitCode.DONE
    assert "um for finger 1" in capsys.readouterr().out
