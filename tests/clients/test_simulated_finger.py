"""`hapticd_client.sim`: a finger that a program steers over a simulated plate."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zmq

from hapticd.sim.fingers.hands import decode_hands
from hapticd_client import HapticdError, RefusedError, sim
from hapticd_client.sim import STEP_S, Finger
from hapticd_contract.simulated import USUAL_PRESSURE_FRAC, SimulatedTouch

PATIENCE_MS = 10_000


class Plate:
    """What a finger needs of a client."""

    name = "experiment-17"

    def __init__(self, rig: Path | None) -> None:
        self._rig = None if rig is None else str(rig)

    def plate(self) -> dict[str, Any]:
        return {"size_mm": [137.5, 100.0], "simulated": self._rig}


class Rig:
    """The rig's end of the socket."""

    def __init__(self, directory: Path) -> None:
        self._context = zmq.Context()
        self.socket = self._context.socket(zmq.PULL)
        self.socket.bind(f"ipc://{directory / 'fingers'}")

    def until(self, touch: SimulatedTouch | None) -> str:
        """Read until the message that this is the sender's finger, and return the sender."""
        while self.socket.poll(PATIENCE_MS):
            message = decode_hands(self.socket.recv())
            assert message.fingers is not None
            if list(message.fingers.values()) == ([] if touch is None else [touch]):
                return message.sender
        raise AssertionError(f"{touch} did not arrive")

    def close(self) -> None:
        self._context.destroy(linger=0)


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    made = Rig(tmp_path)
    yield made
    made.close()


@pytest.fixture(autouse=True)
def _at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sim.time, "sleep", lambda _seconds: None)


def test_a_finger_lands_moves_presses_and_lifts(rig: Rig, tmp_path: Path) -> None:
    with Finger(Plate(tmp_path)) as finger:  # type: ignore[arg-type]
        finger.land(-30, 0)
        sender = rig.until(SimulatedTouch(-30.0, 0.0, USUAL_PRESSURE_FRAC))
        finger.move((30, 0), (30, 20), speed_mm_s=1000)
        rig.until(SimulatedTouch(30.0, 20.0, USUAL_PRESSURE_FRAC))
        finger.press(0.6, major_mm=14, minor_mm=10, angle_rad=0.5)
        assert rig.until(SimulatedTouch(30.0, 20.0, 0.6, 14.0, 10.0, 0.5)) == sender
        finger.lift()
        rig.until(None)


def test_a_way_has_a_step_each_hundredth_of_a_second_and_ends_where_it_leads() -> None:
    start, end = SimulatedTouch(0.0, 0.0, 0.1), SimulatedTouch(10.0, -5.0, 0.5)
    steps = list(sim.ways(start, end, 0.1))
    assert len(steps) == round(0.1 / STEP_S)
    assert steps[4].x_mm == pytest.approx(5.0)
    assert steps[4].pressure_frac == pytest.approx(0.3)
    assert steps[-1] == end
    assert list(sim.ways(start, end, 0.0)) == [end]


@pytest.mark.parametrize(
    ("move", "sentence"),
    [
        (lambda finger: finger.land(69, 0), "land: x_mm is 69: the plate reaches from -68.75 to 68.75 mm."),
        (lambda finger: finger.move((0, 0)), "move: this finger is lifted: land it first."),
        (lambda finger: finger.move((0, 0), speed_mm_s=0), "move: speed_mm_s must be greater than 0."),
        (lambda finger: finger.land(0, 0, pressure_frac=2), "land: pressure_frac: 2 is out of bounds"),
        (
            lambda finger: (finger.land(0, 0), finger.land(1, 1)),
            "land: this finger is down: move it, or lift it first.",
        ),
        (lambda finger: (finger.land(0, 0), finger.press(0.5, major_mm=9)), "press: give both axes"),
    ],
)
@pytest.mark.usefixtures("rig")
def test_what_a_finger_cannot_do_is_one_sentence(move: Any, sentence: str, tmp_path: Path) -> None:
    with Finger(Plate(tmp_path)) as finger, pytest.raises(RefusedError) as refused:  # type: ignore[arg-type]
        move(finger)
    assert sentence in str(refused.value)


@pytest.mark.parametrize("has_directory", [False, True])
def test_a_plate_that_is_not_simulated_here_cannot_be_touched(has_directory: bool, tmp_path: Path) -> None:
    with pytest.raises(HapticdError, match="Only a simulated plate can be touched"):
        Finger(Plate(tmp_path if has_directory else None))  # type: ignore[arg-type]
