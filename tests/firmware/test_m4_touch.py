"""One touch from the pad's report to the glass, by the real image for four modes: pipeline and session of the daemon,
frames on the emulated UART, the program's own interrupts, converters at 1 MHz and a plate behind them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.board_protocol import BoardState, BoardTime, BoardVerdict
from hapticd.board_values import (
    UNCALIBRATED,
    BoardCommand,
    BoardHello,
    BoardMessage,
    BoardStatus,
)
from hapticd.core.board.session import BoardSession
from hapticd.core.pipeline import Pipeline
from hapticd.core.pipeline_settings import PipelineSettings
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.prediction.motion import AdaptivePredictor
from hapticd.core.targets.scene import Scene
from hapticd.values import Contact, LinkTiming, TouchFrame
from hapticd.wire.commands import encode
from hapticd_contract.contents import Amplitude
from hapticd_contract.targets import ClientTargets

from .m4.bench import Bench
from .m4.boards import G474, needs_compiler

pytestmark = [pytest.mark.long, needs_compiler]

MS_NS = 1_000_000
REPORT_MS = 11
START_NS = 77_000_000_000
ASKED, STILL = (-30.2, 5.1), (21.3, -14.9)


def four_waves() -> ModeShapes:
    axis_mm = np.linspace(-68.75, 68.75, 111)
    sine, cosine = np.sin(2 * np.pi * axis_mm / 27.0), np.cos(2 * np.pi * axis_mm / 31.0)
    along_x = [np.tile(wave, (111, 1)) for wave in (sine, cosine)]
    return ModeShapes.from_grid(axis_mm, axis_mm, np.stack([*along_x, *(wave.T for wave in along_x)]))


class Rig:
    """The daemon's part in the board's time, without its event loop."""

    def __init__(self) -> None:
        self.modes = four_waves()
        self.scene = Scene(w_limit_um=4.0)
        limits = (4.0,) * 4
        self.pipeline = Pipeline(
            self.modes, self.scene, PipelineSettings(w_limit_um=limits, make_predictor=AdaptivePredictor)
        )
        self.bench = Bench(G474, G474.image(5000))
        self.session = BoardSession(link_start_ns=MS_NS, controller="deadbeat", calibration=UNCALIBRATED)
        self._heard = 0
        self.say(self.session.link_up(self.now_ns))

    @property
    def now_ns(self) -> int:
        return START_NS + 1000 * self.bench.registers.now_us

    def say(self, commands: Sequence[BoardCommand]) -> None:
        self.bench.to_board += b"".join(map(encode, commands))

    def hear(self, message: BoardMessage) -> None:
        match message:
            case BoardHello():
                self.say(self.session.receive_hello(message, self.now_ns))
            case BoardVerdict():
                self.say(self.session.receive_answer(self.now_ns))
            case BoardTime():
                self.session.receive_time(message, self.now_ns)
            case BoardStatus():
                self.session.receive_status(message, self.now_ns)

    def run(self, ms: int) -> None:
        for _ in range(ms):
            self.say(self.session.timer(self.now_ns))
            self.bench.run(1)
            for message in self.bench.messages[self._heard :]:
                self.hear(message)
            self._heard = len(self.bench.messages)

    def report(self, *positions_mm: tuple[float, float]) -> None:
        """The pad's, and what the daemon does at it."""
        contacts = tuple(
            Contact(n + 1, x_mm, y_mm, 8.0, 7.0, 0.0, 0.2, True, 4, 0, 0) for n, (x_mm, y_mm) in enumerate(positions_mm)
        )
        self.pipeline.touch(TouchFrame(self.now_ns - 10 * MS_NS, contacts, False), self.now_ns)
        tick = self.pipeline.drive(self.now_ns, LinkTiming(5 * MS_NS, is_followed=self.session.holds(self.now_ns)))
        if tick.drive is not None:  # else the board has it
            self.say(self.session.reference(tick.drive, tick, self.now_ns))
        self.run(REPORT_MS)

    def felt_um(self, at_mm: tuple[float, float], ms: int) -> npt.NDArray[np.float64]:
        """What the glass does under a place, sample by sample over the last `ms`."""
        motion_um = np.concatenate(self.bench.motion_um[-20 * ms :])
        return np.abs(motion_um @ np.array(self.modes.at(*at_mm)))


def test_a_finger_gets_its_amplitude_and_another_stays_still_until_both_are_lifted() -> None:
    rig = Rig()
    while not rig.session.ready:
        rig.run(1)
    targets = {1: Amplitude(1.0), 2: Amplitude(0.0)}
    for n in range(20):
        rig.report(ASKED, STILL)
        if n == 0:
            assert rig.scene.set_targets(ClientTargets.of("test", 10**15, targets, {}), rig.now_ns) == ()
    asked_um, still_um = rig.felt_um(ASKED, 30), rig.felt_um(STILL, 30)
    print(f"asked 1 um: {asked_um.min():.3f} .. {asked_um.max():.3f}; still: {1e3 * still_um.max():.1f} nm")
    assert rig.bench.status.state is BoardState.LIVE
    assert np.abs(asked_um - 1.0).max() <= 0.05
    assert still_um.max() <= 0.03
    for _ in range(8):
        rig.report()
    assert rig.felt_um(ASKED, 5).max() <= 0.01
    assert rig.bench.status.fault_code == 0
