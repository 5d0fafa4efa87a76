"""Each example against the whole service on the simulated plate, in real time, for a second."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from test_examples import NAMES, example

from hapticd.tools.study.program import rehearsal
from hapticd_client import Client

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
    "paper_environment": r"^finger \d+ landed at x = [-+][\d.]+ mm: friction (0\.2|1)$",
    "photograph": r"^\d+: x [-+ ][\d. +-]+, y [\d. +-]+, friction [01]\.\d\d",
    "piano": r"^finger \d+: [A-Gc], [\d.]+ Hz$",
    "print_achieved": r"^. (ACTIVE|ARMED) +",
    "reach": r"^finger \d+: ",
    "slider": r"^7 detents on a track of 100 mm",
    "turntable": r"^fingers on the record: [012]$",
    "virtual_finger": r"^finger \d+: friction 0\.2$",
    "webcam": r"^the picture of (a light|the camera), 10 a second$",
}


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
