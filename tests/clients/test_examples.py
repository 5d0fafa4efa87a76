"""The examples run, print their actions and stop cleanly."""

from __future__ import annotations

import importlib.util
import math
import os
import random
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from fake_daemon import FakeDaemon

from hapticd.core.friction import DEFAULT_FRICTION_CURVE
from hapticd_client import (
    Client,
    FingerState,
    Grating,
    Map,
    PlateEvent,
    PlateState,
)
from hapticd_contract.states import EventKind

SLIPPERY_UM = DEFAULT_FRICTION_CURVE.amplitude_um(0.05)  # what the examples call slippery
CLIENTS = Path(__file__).parents[2] / "clients"
NAMES = sorted(path.stem for path in (CLIENTS / "examples").glob("*.py"))


def example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, CLIENTS / "examples" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run(name: str, daemon: FakeDaemon, *arguments: str) -> None:
    example(name).main(["--endpoint", str(daemon.directory), "--seconds", "0.1", *arguments])


@pytest.mark.parametrize("name", NAMES)
def test_help_shows_an_example(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        example(name).main(["--help"])
    assert left.value.code == 0
    assert "example: hapticd run --sim" in capsys.readouterr().out


@pytest.mark.parametrize("name", NAMES)
def test_without_a_daemon_an_example_ends_with_one_sentence(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    program = example(name)
    monkeypatch.setattr(program, "Client", partial(Client, timeout_s=0.05))
    with pytest.raises(SystemExit) as left:
        program.main(["--endpoint", str(tmp_path)])
    assert left.value.code == 1
    assert capsys.readouterr().err.startswith(f"No hapticd answers at {tmp_path}")


def test_the_papers_environment_makes_left_fingers_slip_and_right_ones_stick(
    daemon: FakeDaemon, capsys: pytest.CaptureFixture[str]
) -> None:
    daemon.fingers = {1: (-20.0, 0.0), 2: (20.0, 0.0)}
    run("paper_environment", daemon, "--friction", "0.05")
    lines = capsys.readouterr().out.splitlines()
    assert lines == ["finger 1 landed at x = -20.0 mm: friction 0.05", "finger 2 landed at x = +20.0 mm: friction 1"]
    assert daemon.scene.owner_of(1) is None


@pytest.mark.parametrize(("arguments", "user", "virtual"), [([], 0.2, 1.0), (["--swap"], 1.0, 0.2)])
def test_the_study_gives_user_and_virtual_finger_opposite_friction(
    daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch, arguments: list[str], user: float, virtual: float
) -> None:
    daemon.fingers = {1: (-20.0, 0.0)}
    wanted_um: dict[int | str, float | None] = {}
    publish = daemon.server.publish

    def noted(payload: bytes) -> None:
        for key in (1, "walker"):
            wanted_um[key] = (
                daemon.scene.amplitude_um(key, 0.0, 0.0) if daemon.scene.owner_of(key) else wanted_um.get(key)
            )
        publish(payload)

    monkeypatch.setattr(daemon.server, "publish", noted)
    run("virtual_finger", daemon, *arguments)
    amplitude_um = DEFAULT_FRICTION_CURVE.amplitude_um
    assert wanted_um == {1: amplitude_um(user), "walker": amplitude_um(virtual)}


def test_targets_and_achieved_amplitudes_are_printed(
    daemon: FakeDaemon, client: Client, capsys: pytest.CaptureFixture[str]
) -> None:
    daemon.fingers = {1: (-20.0, 0.0), 2: (20.0, 0.0)}
    client.set(1, amplitude_um=1.25)
    run("print_achieved", daemon, "--every", "0.01")
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 2
    assert lines[-1] == "  ACTIVE  1: 1.25 -> 1.25 um"


def test_each_finger_gets_the_middle_of_its_reach(daemon: FakeDaemon, capsys: pytest.CaptureFixture[str]) -> None:
    daemon.fingers = {1: (-20.0, 0.0)}
    run("reach", daemon, "--every", "0.01")
    assert "finger 1: friction 0.25 .. 0.75, set to 0.50" in capsys.readouterr().out


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_ctrl_c_is_a_clean_end(name: str, daemon: FakeDaemon) -> None:
    command = [sys.executable, str(CLIENTS / "examples" / f"{name}.py"), "--endpoint", str(daemon.directory)]
    environ = {**os.environ, "PYTHONPATH": str(CLIENTS / "python"), "PYTHONUNBUFFERED": "1"}
    daemon.fingers = {1: (-20.0, 0.0)}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, env=environ, stdout=pipe, stderr=pipe, text=True) as process:
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, complaints = process.communicate(timeout=5.0)
        assert (process.returncode, complaints) == (0, "")
    assert daemon.scene.owner_of(1) is None


# --- textures ---------------------------------------------------------------------------------------------------


class ScriptedPlate:
    """Fingers where each of the states has them, `step_ns` apart; what they were last given, and all that was laid."""

    def __init__(self, *fingers_mm: dict[int, tuple[float, float]], step_ns: int = 100_000_000) -> None:
        self._fingers_mm = fingers_mm
        self.step_ns = step_ns
        self.given: dict[int | str, dict[str, Any]] = {}
        self.laid: list[tuple[str, Any, dict[str, Any]]] = []

    def states(self) -> Iterator[PlateState]:
        for seq, places_mm in enumerate(self._fingers_mm):
            fingers = tuple(
                FingerState(key, x_mm, y_mm, None, None, None, None, False) for key, (x_mm, y_mm) in places_mm.items()
            )
            yield PlateState(1, seq, 1 + self.step_ns * seq, "ACTIVE", fingers, (), False, 10.0, 16.0)

    def set(self, finger: FingerState, **target: Any) -> None:
        self.given[finger.id] = target

    def surface(self, name: str, shape: object = None, **fields: Any) -> None:
        self.laid.append((name, shape, fields))


def felt_um(daemon: FakeDaemon, target: dict[str, Any], *places_mm: tuple[float, float]) -> list[float | None]:
    """What a finger with this target feels at these places, once the daemon took it."""
    with Client(daemon.directory) as plate:
        plate.set(1, **target)
        return [daemon.scene.amplitude_um(1, *place_mm) for place_mm in places_mm]


def test_the_grating_is_slippery_on_its_stripes_and_sticky_between(daemon: FakeDaemon) -> None:
    plate = ScriptedPlate({1: (-20.0, 0.0)})
    example("grating").serve(plate, Grating(6.0, 1.5, angle_rad=math.pi / 2), math.inf)
    felt = felt_um(daemon, plate.given[1], (0.0, 0.0), (0.0, 3.0), (0.0, 6.0))
    assert felt == pytest.approx([1.5, 0.0, 1.5])


def test_the_photograph_s_ball_is_lit_from_the_upper_left(daemon: FakeDaemon) -> None:
    plate = ScriptedPlate({1: (-20.0, 0.0)})
    program = example("photograph")
    program.serve(plate, Map(program.ball(), frictions=(1.0, 0.05)), math.inf)
    light, middle, shade, outside = felt_um(
        daemon, plate.given[1], (-35.0, 35.0), (0.0, 0.0), (40.0, -40.0), (-65.0, 65.0)
    )
    assert light == pytest.approx(SLIPPERY_UM, abs=0.1)
    assert middle == pytest.approx(DEFAULT_FRICTION_CURVE.amplitude_um(1.0 - 0.95 / 3**0.5), abs=0.05)
    assert (shade, outside) == (0.0, 0.0)


def test_a_detent_is_sticky_and_the_way_to_the_next_is_not(daemon: FakeDaemon) -> None:
    plate = ScriptedPlate({1: (-49.0, 0.0)})
    program = example("detents")
    program.serve(plate, program.slider_map(5, 0.05), 5, math.inf)
    places_mm = ((-50.0, 0.0), (-37.5, 0.0), (0.0, 5.0), (12.5, 5.0), (12.5, 20.0), (66.0, 0.0))
    assert felt_um(daemon, plate.given[1], *places_mm) == [0.0, SLIPPERY_UM, 0.0, SLIPPERY_UM, 0.0, 0.0]


def test_braille_is_sticky_on_its_dots_and_slippery_beyond(
    daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    program, felt = example("braille"), []

    def look(_: float) -> None:
        places_mm = [*program.dots_mm("az"), (0.0, 0.0), (0.0, 40.0)]
        felt.extend(daemon.felt_um(*place_mm) for place_mm in places_mm)

    monkeypatch.setattr(program.time, "sleep", look)
    program.main(["AZ", "--endpoint", str(daemon.directory)])
    assert felt == [0.0] * 5 + [1.5, 1.5]
    assert program.dots_mm("a") == [(-4.5, 9.0)]  # dot 1 is at the upper left
    assert capsys.readouterr().out == "az: 1 1356\n"


def happened(kind: EventKind, finger: int, effect: str, client: str) -> PlateEvent:
    return PlateEvent(1, kind.value, 7, finger=finger, x_mm=0.0, y_mm=0.0, client=client, effect=effect)


def test_the_button_s_daemon_clicks_by_pressure_and_its_program_counts(
    daemon: FakeDaemon, client: Client, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    program = example("button")
    program.lay(client, 0.4, 2.0)
    edge, click = daemon.scene.effects.held
    assert (edge.name, edge.effect.start.surface, edge.effect.on) == ("edge", "button", None)
    assert (click.effect.on, click.effect.start.threshold) == ("button", 0.4)
    events = [
        happened(EventKind.PRESSED, 3, "click", client.name),
        happened(EventKind.BEGUN, 3, "click", client.name),
        happened(EventKind.BEGUN, 3, "edge", client.name),
        happened(EventKind.BEGUN, 4, "click", "another"),
        happened(EventKind.BEGUN, 4, "click", client.name),
    ]
    monkeypatch.setattr(Client, "events", lambda *_: iter(events))
    program.count(client, 1.0)
    assert capsys.readouterr().out.splitlines() == ["finger 3: click 1", "finger 4: click 2"]


def test_each_key_of_the_piano_hums_while_a_finger_is_on_it(daemon: FakeDaemon, client: Client) -> None:
    example("piano").lay(client, 0.0)
    assert [held.name for held in daemon.scene.effects.held] == list("CDEFGABc")
    for held in daemon.scene.effects.held:
        assert held.effect.on == held.effect.start.surface == held.name
    felt = [daemon.felt_um(x_mm) for x_mm in (-56.0, 0.0, 8.0, 70.0)]
    assert felt == [2.0, 0.0, 2.0, 0.0]


def test_the_slider_prints_each_detent_that_a_finger_reaches(capsys: pytest.CaptureFixture[str]) -> None:
    way_mm = ((-49.0, 0.0), (-30.0, 0.0), (-30.0, 30.0), (10.0, 30.0), (10.0, 0.0), (90.0, 0.0), (88.0, 0.0))
    program = example("detents")
    plate = ScriptedPlate(*({7: place_mm} for place_mm in way_mm))
    program.serve(plate, program.slider_map(5, 0.05), 5, math.inf)
    assert capsys.readouterr().out.splitlines() == [f"finger 7: detent {detent}" for detent in (0, 1, 2, 4)]


def played(plate: ScriptedPlate, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Output of the game after its instructions."""
    example("find_the_edge").play(plate, 25.0, 0.05, random.Random(1), 60.0)
    return capsys.readouterr().out.splitlines()[1:]


EDGE_MM = random.Random(1).uniform(-40.0, 40.0)


def test_an_edge_between_close_fingers_is_caught_and_another_hidden(capsys: pytest.CaptureFixture[str]) -> None:
    outside = {1: (EDGE_MM - 5.0, 0.0), 2: (EDGE_MM + 5.0, 30.0)}
    lines = played(ScriptedPlate(outside, outside), capsys)
    assert [line.partition(" after")[0] for line in lines] == [f"Caught at x = {EDGE_MM:+.0f} mm", "Score: 1 in 60 s"]


@pytest.mark.parametrize("places_mm", [(5.0, 15.0), (-20.0, 20.0)])
def test_an_edge_outside_or_between_distant_fingers_is_not(
    places_mm: tuple[float, float], capsys: pytest.CaptureFixture[str]
) -> None:
    fingers = {1: (EDGE_MM + places_mm[0], 0.0), 2: (EDGE_MM + places_mm[1], 30.0)}
    assert played(ScriptedPlate(fingers), capsys) == ["Score: 0 in 60 s"]


def test_the_edge_is_slippery_on_its_left(daemon: FakeDaemon, capsys: pytest.CaptureFixture[str]) -> None:
    plate = ScriptedPlate({1: (-20.0, 0.0)})
    played(plate, capsys)
    assert felt_um(daemon, plate.given[1], (EDGE_MM - 2.0, 40.0), (EDGE_MM + 2.0, -40.0)) == [SLIPPERY_UM, 0.0]


def test_a_photograph_that_is_none_is_one_sentence(daemon: FakeDaemon, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        run("photograph", daemon, str(CLIENTS / "PROTOCOL.md"))
    assert left.value.code == 1
    assert capsys.readouterr().err.endswith("PROTOCOL.md: is not a PNG or JPEG that Pillow can read.\n")
