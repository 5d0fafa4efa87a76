"""The firmware on a bench: the C core with a simulated plate, driven by the encoders that the daemon uses."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.board_values import BoardMessage, BoardStatus
from hapticd.sim.board.board import Board, BoardConfig, BoardTrace, PlateModel
from hapticd.values import Knot, LimitReason, SafeDrive
from hapticd.wire import device

FIRMWARE = Path(__file__).parents[2] / "firmware"
TICK_US = 500


class Bench:
    """A board with a plate that is exactly as the firmware believes it to be, and the host's side of the line."""

    def __init__(self, *, noise_um: float = 0.0, seed: int = 0, t_start_us: int = 0, **config: Any) -> None:
        self.config = BoardConfig(**config)
        modes = len(self.config.w_limit_um)
        model = PlateModel(
            decay_1_s=np.array(self.config.decay_1_s),
            detuning_rad_s=np.array(self.config.detuning_rad_s),
            gain_um_per_v_s=np.diag(self.config.gain_um_per_v_s),
            sensor=np.eye(modes),
            noise_um=noise_um,
            amplifier_limit_v=self.config.v_limit_v,
        )
        self.board = Board(model, config=self.config, seed=seed, boot_id=0x1234, t_start_us=t_start_us)
        self.modes = modes
        self.seq = 0
        self.messages: list[BoardMessage] = []
        self._decoder = device.Decoder()

    def say(self, line: bytes, at_us: int | None = None) -> tuple[BoardMessage, ...]:
        """Bytes to the board, and its answer."""
        self.board.receive(line, at_us)
        return self.listen(at_us)

    def listen(self, at_us: int | None = None) -> tuple[BoardMessage, ...]:
        messages = self._decoder.feed(self.board.transmit(at_us))
        self.messages += messages
        return messages

    def polyline(self, *knots: tuple[float, Sequence[complex]], t_apply_us: int | None = None) -> bytes:
        """The next reference frame: knots as (ms after its start, amplitudes), from now on unless said otherwise."""
        self.seq += 1
        drive = SafeDrive(0, tuple(Knot(round(ms * 1e6), tuple(w)) for ms, w in knots), LimitReason.NONE)
        return device.encode_reference(self.seq, drive, self.board.t_us if t_apply_us is None else t_apply_us)

    def constant(self, *w_um: complex) -> bytes:
        return self.polyline((0.0, w_um))

    def run(self, ticks: int) -> BoardTrace:
        trace = BoardTrace(ticks, self.modes, self.modes)
        nobody = np.zeros((ticks, 0, self.modes)), np.zeros((ticks, 0))
        done = 0
        while done < ticks:
            done += self.board.run(ticks - done, *nobody, trace, done, stop_on_transmit=True)
            self.listen()
        return trace

    def arm(self, *w_um: complex) -> None:
        """Three references at once and the 10 ms of ramp: LIVE at full drive when this returns."""
        w_um = w_um or (0j,) * self.modes
        for _ in range(3):
            self.say(self.constant(*w_um))
        self.run(20)

    def hold(self, ticks: int) -> BoardTrace:
        """Runs with a keep-alive every 20 ms."""
        parts = []
        for start in range(0, ticks, 40):
            self.say(device.encode_keepalive(self.seq))
            parts.append(self.run(min(40, ticks - start)))
        return joined(parts)

    def status(self) -> BoardStatus:
        """What the board says of itself now. (Clearing no fault is the way to ask.)"""
        found = [m for m in self.say(device.encode_clear_fault()) if isinstance(m, BoardStatus)]
        return found[-1]


def joined(parts: Sequence[BoardTrace]) -> BoardTrace:
    trace = BoardTrace(0, parts[0].modes, parts[0].plate_modes)
    for name in BoardTrace.__slots__:
        setattr(trace, name, np.concatenate([getattr(part, name) for part in parts]))
    return trace


@pytest.fixture
def new_bench() -> Callable[..., Bench]:
    return Bench


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The board's program as a process of this computer."""
    if shutil.which("cc") is None:
        pytest.skip("cc is not installed")
    build = tmp_path_factory.mktemp("firmware")
    built = build / "hapticd-board"
    subprocess.run(["make", "-s", "-C", str(FIRMWARE), f"BUILD={build}", str(built)], check=True)
    return built
