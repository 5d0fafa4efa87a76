"""Each example against the whole service on the simulated plate, in real time, for a second."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from test_examples import NAMES, example

from hapticd.tools.daemon_process import DaemonProcess
from hapticd_client import Client, FingerState
from hapticd_client.sim import Finger

pytestmark = pytest.mark.long

PATIENCE_S = 60.0

# Expected output of each example for two stroking fingers.
EXPECTED = {
    "audio": r"^heart\.wav: 3\.\d+ s of effects, again and again",
    "braille": r"^glass: 1245 123 1 234 234$",
    "button": r"^A button of 36 mm in the middle of the plate: press it$",
    "catch": r"^Catch the slippery patch",
    "compass": r"^Follow the ring: which way is north\?$",
    "detents": r"^finger \d+: detent [0-8]$",
    "find_the_edge": r"^Score: \d+ in 1 s$",
    "grating": r"^finger \d+: stripes every 8 mm, 0 \.\. 1\.5 um$",
    "maze": r"^Find the gaps of 5 walls",
    "moving_patch": r"^patch at x = -40 mm: \+40 mm/s$",
    "paper_environment": r"^finger \d+ landed at x = [-+][\d.]+ mm: friction (0\.49|1)$",
    "photograph": r"^\d+: x [-+ ][\d. +-]+, y [\d. +-]+, friction [01]\.\d\d",
    "piano": r"^finger \d+: [A-Gc], [\d.]+ Hz$",
    "print_achieved": r"^. (ACTIVE|ARMED) +",
    "reach": r"^finger \d+: ",
    "slider": r"^7 detents on a track of 100 mm",
    "turntable": r"^fingers on the record: [012]$",
    "virtual_finger": r"^finger \d+: friction 0\.49$",
    "webcam": r"^the picture of (a light|the camera), 10 a second$",
}


def rehearsal(scenario: str) -> DaemonProcess:
    return DaemonProcess(f'scenario = "{scenario}"', log_level="error")


@pytest.fixture(scope="module")
def service() -> Iterator[Path]:
    """A running service whose two fingers are down."""
    with rehearsal("strokes") as running:
        with Client(running.runtime_dir, timeout_s=PATIENCE_S) as client:
            next(state for state in client.states(PATIENCE_S) if len(state.fingers) == 2)
        yield running.runtime_dir


def test_every_example_is_tried() -> None:
    assert sorted(EXPECTED) == NAMES


@pytest.mark.timeout(180)
@pytest.mark.parametrize("name", NAMES)
def test_an_example_runs_on_the_simulated_plate(name: str, service: Path, capsys: pytest.CaptureFixture[str]) -> None:
    example(name).main(["--endpoint", str(service), "--seconds", "1"])
    printed = capsys.readouterr()
    assert printed.err == ""
    assert re.search(EXPECTED[name], printed.out, re.MULTILINE), printed.out


@pytest.mark.timeout(180)
def test_a_programs_finger_clicks_the_button_by_pressing_and_is_where_it_was_moved() -> None:
    button = example("button")
    with rehearsal("hands") as running, Client(running.runtime_dir, timeout_s=PATIENCE_S) as plate:
        with Finger(plate) as finger:
            button.lay(plate, 0.35, 2.0)
            events = plate.events(PATIENCE_S)
            finger.land(0, 0)
            light = seen(plate, lambda state: state.pressure_frac > 0.1)
            finger.press(0.6)
            clicked = next(event for event in events if event.kind == "begun" and event.effect == "click")
            hard = seen(plate, lambda state: state.pressure_frac > 0.59)
            finger.press(0.2)
            finger.move((25, -10), speed_mm_s=200)
            moved = seen(plate, lambda state: abs(state.x_mm - 25) < 0.5 and abs(state.y_mm + 10) < 0.5)
        next(state for state in plate.states(PATIENCE_S) if not state.fingers)
    assert {light.id, clicked.finger, hard.id, moved.id} == {light.id}
    assert hard.area_mm2 > 1.5 * light.area_mm2


def seen(plate: Client, is_there: Callable[[FingerState], bool]) -> FingerState:
    """Wait for the state of a finger."""
    return next(finger for state in plate.states(PATIENCE_S) for finger in state.fingers if is_there(finger))
