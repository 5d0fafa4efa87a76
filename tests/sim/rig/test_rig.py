"""The simulated rig: its endpoints, and its end with its owner."""

from __future__ import annotations

import os
import socket
import subprocess
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
import zmq

from hapticd.board_protocol import BoardState, BoardTime, BoardVerdict
from hapticd.board_values import BoardHello, BoardStatus
from hapticd.core.board.session import BoardSession
from hapticd.errors import DeviceError
from hapticd.sim.rig import sockets as rigsockets
from hapticd.sim.rig.process import RigProcess, RigSettings
from hapticd.sim.rig.program import Rig
from hapticd.sim.world import CONTROL_HZ
from hapticd.wire import device
from hapticd.wire.trackpad import Decoder
from hapticd_contract.simulated import SimulatedTouch

pytestmark = pytest.mark.long

PATIENCE_S = 10.0


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Rig, Path]]:
    """A rig with fingers that lie still, served by a thread."""
    directory = tmp_path_factory.mktemp("rig")
    made = Rig(directory, RigSettings("rest", 1, record=True))
    thread = threading.Thread(target=made.serve)
    thread.start()
    yield made, directory
    made.stop()
    thread.join()
    made.close()
    assert list(directory.iterdir()) == []


@contextmanager
def opened(directory: Path) -> Iterator[int]:
    """The board's terminal, as a daemon opens it."""
    fd = os.open(directory / "board", os.O_RDWR | os.O_NOCTTY)
    tty.setraw(fd)
    try:
        yield fd
    finally:
        with suppress(OSError):
            os.close(fd)


@contextmanager
def connected(directory: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as pad:
        pad.settimeout(PATIENCE_S)
        pad.connect(str(directory / "trackpad"))
        yield pad


def test_the_endpoint_gives_genuine_reports_one_a_packet_to_each_that_connects(rig: tuple[Rig, Path]) -> None:
    with connected(rig[1]) as one, connected(rig[1]) as other:
        for pad in (one, other):
            decoder = Decoder("mt2-usb")
            frames = [frame for _ in range(3) for frame in decoder.decode(pad.recv(512), 0)]
            assert [len(frame.contacts) for frame in frames] == [2, 2, 2]


# --- a person's fingers, and the truth ---


@contextmanager
def socket_of(directory: Path, kind: int, name: str) -> Iterator[zmq.Socket[bytes]]:
    with zmq.Context() as context, context.socket(kind) as end:
        end.linger = 0
        end.rcvtimeo = round(PATIENCE_S * 1e3)
        if kind == zmq.SUB:
            end.subscribe(b"")
        end.connect(f"ipc://{directory / name}")
        yield end


def truth_where(end: zmq.Socket[bytes], condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The first truth that meets the condition."""
    for _ in range(round(PATIENCE_S / rigsockets.PERIOD_S)):
        truth = msgpack.unpackb(end.recv())
        if condition(truth):
            return dict(truth)
    raise AssertionError(f"still {truth}")


def test_a_users_fingers_replace_the_scenarios_until_they_lift() -> None:
    with RigProcess("rest", 1) as running, socket_of(running.directory, zmq.SUB, "truth") as truth:
        truth_where(truth, lambda state: len(state["fingers"]) == 2)
        with socket_of(running.directory, zmq.PUSH, "fingers") as fingers:
            for message in (b"no fingers", msgpack.packb({"fingers": {"1": [7.0, -3.0]}})):
                fingers.send(message)
            truth_where(truth, lambda state: state["fingers"] == [[7.0, -3.0]])
        truth_where(truth, lambda state: state["fingers"] == [])


def test_the_pad_reports_a_persons_finger_like_any_other(tmp_path: Path) -> None:
    made = Rig(tmp_path, RigSettings("hands", 1, record=True))
    sensed: list[bytes] = []
    made._pad.send = sensed.append  # type: ignore[method-assign]
    made.hands.hold({"1": SimulatedTouch(7.0, -3.0, 0.5)}, 0.05)
    made._advance(0.4)
    made._sockets.close()
    decoder = Decoder("mt2-usb")
    contacts = [contact for data in sensed for frame in decoder.decode(data, 0) for contact in frame.contacts]
    places_mm = np.array([(contact.x_mm, contact.y_mm) for contact in contacts])
    made.save(tmp_path / "plate.npz")
    made.close()
    assert len(contacts) > 20
    assert contacts[-1].pressure_frac == pytest.approx(0.5, abs=0.002)
    assert 0.01 < np.std(places_mm[:, 0]) < 0.1
    np.testing.assert_allclose(places_mm.mean(axis=0), (7.0, -3.0), atol=0.05)
    with np.load(tmp_path / "plate.npz") as arrays:
        down = np.isfinite(arrays["finger_true_mm"][:, 0, 0])
        assert arrays["finger_true_mm"].shape == (800, 1, 2)
        np.testing.assert_array_equal(arrays["t_s"][down][0], 0.05)
        assert np.isnan(arrays["target_um"]).all()


class BusyRig(Rig):
    """A rig on a computer that needs two seconds to simulate one; `t_s` is its clock."""

    t_s = 0.0

    def __init__(self, directory: Path) -> None:
        super().__init__(directory, RigSettings("rest", 1, record=True))
        advance = self.world.advance

        def slowly(t_s: float) -> bytes:
            before_s = self.world.t_s
            output = advance(t_s)
            self.t_s += 2.0 * (self.world.t_s - before_s)
            return output

        self.world.advance = slowly  # type: ignore[method-assign]

    def _now_s(self) -> float:
        return self.t_s

    def turn(self) -> None:
        """One of `serve`'s passes."""
        self.t_s += 1e-4
        for key, _ in self._selector.select(0):
            key.data()
        self._keep_up(self._now_s())


def test_a_board_on_a_busy_computer_keeps_its_clock_and_follows_its_host(tmp_path: Path) -> None:
    made, decoder, seconds = BusyRig(tmp_path), device.Decoder(), 4.0
    session = BoardSession(link_start_ns=5_000_000, controller="deadbeat")
    with opened(tmp_path) as fd:
        os.set_blocking(fd, False)
        commands = session.link_up(0)
        while made.t_s < seconds:
            t_ns = round(made.t_s * 1e9)
            os.write(fd, b"".join(device.encode(command) for command in commands))
            made.turn()
            commands = session.timer(t_ns)
            with suppress(BlockingIOError):
                for message in decoder.feed(os.read(fd, 4096)):
                    match message:
                        case BoardHello():
                            commands += session.receive_hello(message, t_ns)
                        case BoardVerdict():
                            commands += session.receive_answer(t_ns)
                        case BoardTime():
                            session.receive_time(message, t_ns)
                        case BoardStatus():
                            session.receive_status(message, t_ns)
    made.save(tmp_path / "plate.npz")
    made.close()
    assert (session.ready, session.ended, session.clock.relocks) == (True, "", 0)
    assert session.status is not None
    assert session.status.state is BoardState.LIVE
    with np.load(tmp_path / "plate.npz") as arrays:
        assert arrays["t_s"][-1] == pytest.approx(seconds, abs=0.1)
        assert 0.3 < len(arrays["t_s"]) / (seconds * CONTROL_HZ) < 0.6  # half of the time was left out


def test_a_rig_process_leaves_nothing_behind() -> None:
    with RigProcess("rest", 1, record=True) as running:
        directory = running.directory
        files = {"board", "trackpad", "modes.npz", "neighbours.npz", "plate.toml", "truth", "fingers"}
        assert {path.name for path in directory.iterdir()} == files
        assert running.t_start_s > 0
    assert running.process.returncode == 0
    assert not directory.exists()
    assert {"t_s", "truth_um"} <= set(running.history)  # however short the run was


def test_a_ctrl_c_while_a_rig_starts_leaves_nothing_behind(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    class Interrupted(subprocess.Popen[str]):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            started.append(self)
            self.stdout = _Interrupting(self.stdout)  # type: ignore[assignment]

    class _Interrupting:
        def __init__(self, pipe: Any) -> None:
            self.close = pipe.close

        def readline(self) -> str:
            raise KeyboardInterrupt

    started: list[subprocess.Popen[str]] = []
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("hapticd.sim.rig.process.subprocess.Popen", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        RigProcess("rest", 1)
    assert [process.returncode is not None for process in started] == [True]
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""


def test_a_rig_that_does_not_start_is_one_sentence(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(DeviceError, match="The simulated rig did not start"):
        RigProcess("rest", 1, plate="no-such-plate")
    assert "there is no plate 'no-such-plate'" in capfd.readouterr().err
