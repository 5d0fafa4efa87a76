"""The simulated rig in real time: a process that is the hardware.

    python -m hapticd.sim.rig.program DIRECTORY [--scenario NAME] [--seed N] [--record FILE]
        [--program FILE]

`DIRECTORY/board` is a link to a pseudo-terminal behind which the firmware's C drives the simulated plate: its core in
this process, or with `--program` its whole program in a process of its own (`sim/board/emulator.py`).
`DIRECTORY/trackpad` is a unix SOCK_SEQPACKET endpoint that gives raw reports of the scenario's fingers, one a packet
(`rigplugs.py`).
`DIRECTORY/modes.npz` is the cartography that was made of this plate, `plate.toml` with `neighbours.npz` what was
measured of the modes beside the driven ones. `DIRECTORY/truth` tells the plate's true motion and `DIRECTORY/fingers`
takes the fingers of a person in place of the scenario's (`rigsockets.py`).
The daemon cannot tell it from the real thing but by its file names. Bytes to and from the board take the link's 5 ms,
reports the sensor's 10 ms. It prints `ready T` when both can be opened; T is its time zero on the
host's monotonic clock. SIGTERM ends it and writes the recording, if asked; SIGUSR1 pulls the board's plug or puts it
back, SIGUSR2 the trackpad's.

What it leaves out: the serial line's speed beyond that constant delay, and the pull of a finger on the plate's shape.
With `--program` also the damping of fingers, the neighbouring modes and the sensors' noise: that plate is inside the
other process; up to 2 ms of the link's delay then depend on when this one looks.
"""

from __future__ import annotations

import argparse
import os
import selectors
import shutil
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ...errors import DeviceError
from ..board.outboard import Outboard
from ..fingers.hands import Hands, Yielding
from ..fingers.paths import Path as FingerPath
from ..fingers.sensor import Report, SensorModel, SensorSettings
from ..plate.truth import PlateSettings, PlateTruth
from ..scenarios import SCENARIOS, SPEED_MM_S, paths_of
from ..world import World
from .files import write_measured
from .plugs import READ_SIZE, BoardPlug, TrackpadPlug
from .sockets import RigSockets

STEP_S = 0.002  # the board's clock is looked at so often
CHUNK_TICKS = 16  # 8 ms: so far ahead it is settled what a finger does; half as many cost 3 % more of a processor
MAX_BEHIND_S = 0.5  # after a longer stall time is dropped, as a board that was stopped would


class Rig:
    """Board and trackpad of one scenario, served in `directory` until told to stop; its time starts when it is made."""

    def __init__(
        self,
        directory: Path,
        scenario: str,
        seed: int,
        *,
        keep: bool,
        program: Path | None = None,
    ) -> None:
        self.actors = SCENARIOS[scenario].build(seed, SPEED_MM_S)
        self.hands = Hands()
        self.plate = PlateTruth(PlateSettings())
        self._files = write_measured(self.plate, seed, directory, with_neighbours=program is None)
        boot_id = os.getpid() & 0x7FFFFFFF
        paths: list[FingerPath] = [*(Yielding(path, self.hands) for path in paths_of(self.actors)), *self.hands.fingers]
        self.world: World | Outboard
        if program is not None:
            self.world = Outboard(paths, program, boot_id=boot_id, keep=keep)
        else:
            self.world = World(
                paths,
                self.plate,
                w_limit_um=(self.plate.settings.w_limit_um,) * 2,
                seed=seed,
                boot_id=boot_id,
                keep=keep,
                chunk_ticks=CHUNK_TICKS,
            )
        self._scans = SensorModel(SensorSettings(), seed, block=1).scans(paths)
        self._sockets = RigSockets(directory)
        self._reports: deque[Report] = deque()
        self._t_scan_s = 0.0
        self._selector = selectors.DefaultSelector()
        self._stopping = False
        self.is_orphaned = False
        self.t_start_s = time.monotonic()
        self._board = BoardPlug(directory / "board", self._selector, self._now_s)
        self._pad = TrackpadPlug(directory / "trackpad", self._selector)
        self._replugs: deque[Callable[[], None]] = deque()

    # What a signal handler may call: the change itself is made between two steps.

    def stop(self) -> None:
        """Leave `serve` soon."""
        self._stopping = True

    def replug_board(self) -> None:
        """Pull the board's plug soon, or put it back. Its firmware goes on."""
        self._replugs.append(self._board.replug)

    def replug_trackpad(self) -> None:
        """Pull the trackpad's plug soon, or put it back."""
        self._replugs.append(self._pad.replug)

    def serve(self, owner: int | None = None) -> None:
        """Be the hardware, until `stop` or the end of the file `owner`."""
        if owner is not None:
            self._selector.register(owner, selectors.EVENT_READ, lambda: self._hear_owner(owner))
        while not self._stopping:
            for key, _ in self._selector.select(self._wait_s()):
                key.data()
            while self._replugs:
                self._replugs.popleft()()
            self._advance(self._now_s())

    def close(self) -> None:
        """Pull both plugs, and end a board that is another process."""
        self._board.close()
        self._pad.close()
        self._selector.close()
        self._sockets.close()
        for file in self._files:
            file.unlink(missing_ok=True)
        if isinstance(self.world, Outboard):
            self.world.close()

    def _hear_owner(self, owner: int) -> None:
        if not os.read(owner, READ_SIZE):
            self.is_orphaned = not self._stopping  # who asked for the end first lives, and wants the recording
            self.stop()

    def _now_s(self) -> float:
        now_s = time.monotonic() - self.t_start_s
        if now_s - self.world.t_s > MAX_BEHIND_S and isinstance(self.world, World):
            self.t_start_s += now_s - self.world.t_s
            now_s = self.world.t_s
        return now_s

    def _wait_s(self) -> float:
        due_s = [self.world.t_s + STEP_S, *self._board.due_s(), *(report.t_arrive_s for report in self._reports)]
        return max(min(due_s) - self._now_s(), 0.0)

    def _advance(self, now_s: float) -> None:
        self._hold()
        for t_s, data in self._board.arrived(now_s):
            self._run_to(t_s)
            self.world.receive(data, t_s)
        self._run_to(now_s)
        self._board.deliver(now_s)
        self._scan(now_s)
        while self._reports and self._reports[0].t_arrive_s <= now_s:
            self._pad.tell(self._reports.popleft().data)
        if self._sockets.wants_truth(now_s):
            self._tell_truth()

    def _hold(self) -> None:
        """Take what a person's fingers do; it begins where the plate has not gone on yet."""
        t_s = self.world.t_ahead_s
        for points_mm in self._sockets.held():
            self.hands.hold(points_mm, t_s)
        self.hands.expire(t_s)

    def _tell_truth(self) -> None:
        now = self.world.now()
        shapes = self.plate.shapes(now.finger_mm)[:, : len(now.plate_um)]
        t_s = self.world.t_s
        self._sockets.tell(t_s, round((self.t_start_s + t_s) * 1e9), now, shapes @ now.plate_um)

    def _scan(self, now_s: float) -> None:
        """Sense up to now: reports wait in `_reports` for as long as the pad takes to send them."""
        while self._t_scan_s <= now_s:
            scan = next(self._scans)
            self._t_scan_s = scan.t_sample_s
            self._reports += scan.reports

    def _run_to(self, t_s: float) -> None:
        while said := self.world.advance(t_s):
            self._board.say(said, self.world.t_s)

    def save(self, path: Path) -> None:
        """Write what the plate did, and what each finger that touched it got, as the arrays of `sim.run`; a person's
        fingers follow the scenario's."""
        recording = self.world.recording()
        wants_um = [actor.target_um(recording.t_s) for actor in self.actors if actor.path is not None]
        scripted = len(wants_um)
        used = np.isfinite(recording.finger_mm[..., 0]).any(axis=0) | (
            np.arange(recording.finger_mm.shape[1]) < scripted
        )
        finger_mm = recording.finger_mm[:, used]
        target_um = np.full(finger_mm.shape[:2], np.nan)  # what a person wants of theirs is not known here
        target_um[:, :scripted] = np.reshape(wants_um, (scripted, len(recording.t_s))).T
        absent = ~np.isfinite(finger_mm[..., 0])
        target_um[absent] = np.nan
        shapes = self.plate.shapes(finger_mm)[..., : recording.plate_um.shape[1]]
        truth_um = np.einsum("tnp,tp->tn", shapes, recording.plate_um)
        truth_um[absent] = np.nan
        np.savez_compressed(
            path,
            t_s=recording.t_s,
            finger_true_mm=finger_mm,
            target_um=target_um,
            reference_um=recording.reference_um,
            modal_um=recording.plate_um[:, : recording.reference_um.shape[1]],
            truth_um=truth_um,
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """The process: serve until SIGTERM or SIGINT."""
    parser = argparse.ArgumentParser(prog="hapticd.sim.rig.program", description="The simulated rig in real time.")
    parser.add_argument("directory", type=Path, help="where board and trackpad appear")
    parser.add_argument("--scenario", default="strokes", choices=sorted(SCENARIOS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--record", type=Path, help="write what the plate did (NPZ) at the end")
    parser.add_argument("--program", type=Path, help="run the board in another process: this program")
    parser.add_argument("--owned", action="store_true", help="end with standard input too, and delete the directory")
    options = parser.parse_args(arguments)
    try:
        _be_the_rig(options)
    except DeviceError as error:
        sys.exit(f"hapticd.sim.rig.program: {error}")


def _be_the_rig(options: argparse.Namespace) -> None:
    rig = Rig(
        options.directory,
        options.scenario,
        options.seed,
        keep=options.record is not None,
        program=options.program,
    )
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: rig.stop())
    signal.signal(signal.SIGUSR1, lambda *_: rig.replug_board())
    signal.signal(signal.SIGUSR2, lambda *_: rig.replug_trackpad())
    try:
        print(f"ready {rig.t_start_s}", flush=True)
        rig.serve(sys.stdin.fileno() if options.owned else None)
    except BrokenPipeError:  # who started it has died since
        rig.is_orphaned = True
    finally:
        rig.close()
    if rig.is_orphaned:
        shutil.rmtree(options.directory, ignore_errors=True)  # its owner's, who cannot any more
    elif options.record is not None:
        rig.save(options.record)


if __name__ == "__main__":
    main()
