"""The simulated rig in real time: a process that simulates the hardware.

    python -P -m hapticd.sim.rig.program DIRECTORY SETTINGS    (`process.RigSettings`, as JSON)

Files in DIRECTORY:

    board                        link to a pseudo-terminal: the firmware's C with the simulated plate
    trackpad                     unix SOCK_SEQPACKET endpoint: raw reports of the scenario's fingers (`plugs.py`)
    modes.npz                    measured mode map of this plate
    plate.toml, neighbours.npz   its size and limits, and measurements of its parasitic modes
    truth, fingers               sockets: the plate's ground truth out, a user's fingers in (`sockets.py`)

Bytes to and from the board are delayed by 5 ms, reports by the sensor's 10 ms. It prints `ready T` when the devices can
be opened; T is its time zero on the host's monotonic clock. SIGTERM stops it and writes the recording, if requested.

Not modelled: the serial line's speed beyond the constant delay, and the detuning of the plate by fingers.
"""

from __future__ import annotations

import json
import os
import selectors
import shutil
import signal
import sys
import time
from collections import deque
from pathlib import Path

import numpy as np

from ...errors import DeviceError, UsageError
from ..fingers.fingertip import USUAL
from ..fingers.hands import Hands, YieldingPath
from ..fingers.paths import Path as FingerPath
from ..fingers.pressing import Tip
from ..fingers.scenarios import SCENARIOS, SPEED_MM_S, Actor, paths_of, with_motion
from ..fingers.sensor import Report, SensorModel
from ..fingers.trajectories import read_repeated
from ..plate.glasses import driven_modes, find_glass
from ..plate.ground_truth import GroundTruth, PlateSettings
from ..world import World
from .files import write_measured
from .plugs import READ_SIZE, BoardPlug, TrackpadPlug
from .process import HISTORY_FILE, RigSettings
from .sockets import RigSockets

STEP_S = 0.002  # longest interval between two steps of the board
CHUNK_TICKS = 16  # 8 ms, the lead of computed finger positions; half as many cost 3 % more of a processor
# A computer too busy to simulate as fast as time passes leaves out what it is behind, so that the board's clock stays
# the host's. Below the board's dead-man timeout of 50 ms: frames that wait on the line are read before it would end.
MAX_BEHIND_S = 0.03
MOST_AT_ONCE_S = 0.004  # simulated between two looks at clock and line


class Rig:
    """Board and trackpad of one scenario, served in `directory` until `stop`; its time starts at construction."""

    def __init__(self, directory: Path, settings: RigSettings) -> None:
        driven = driven_modes(settings.plate, settings.modes)
        self.plate = GroundTruth(PlateSettings.of(settings.plate, driven, settings.wiring))
        self.actors: tuple[Actor, ...] = (
            read_repeated(Path(settings.fingers), find_glass(settings.plate).size_mm)
            if settings.fingers
            else with_motion(SCENARIOS[settings.scenario].build(settings.seed, SPEED_MM_S), settings.motion)
        )
        self.hands = Hands()
        self._files = write_measured(self.plate, settings.seed, directory)
        paths: list[FingerPath] = [
            *(YieldingPath(path, self.hands) for path in paths_of(self.actors)),
            *self.hands.fingers,
        ]
        self.world = World(
            paths,
            self.plate,
            w_limit_um=self.plate.w_limit_um,
            seed=settings.seed,
            boot_id=os.getpid() & 0x7FFFFFFF,
            keep=settings.record,
            chunk_ticks=CHUNK_TICKS,
        )
        tips: list[Tip] = [actor.fingertip or USUAL for actor in self.actors if actor.path is not None]
        self._scans = SensorModel(seed=settings.seed, block=1).scans(paths, [*tips, *self.hands.fingers])
        self._sockets = RigSockets(directory)
        self._reports: deque[Report] = deque()
        self._t_scan_s = 0.0
        self._selector = selectors.DefaultSelector()
        self._stopping = False
        self.is_orphaned = False
        self.t_start_s = time.monotonic()
        self._board = BoardPlug(directory / "board", self._selector, self._now_s)
        self._pad = TrackpadPlug(directory / "trackpad", self._selector)

    def stop(self) -> None:
        """Make `serve` return; safe in a signal's handler."""
        self._stopping = True

    def serve(self, owner: int | None = None) -> None:
        """Run the hardware until `stop` or the end of the file `owner`."""
        if owner is not None:
            self._selector.register(owner, selectors.EVENT_READ, lambda: self._check_owner(owner))
        while not self._stopping:
            for key, _ in self._selector.select(self._wait_s()):
                key.data()
            self._keep_up(self._now_s())

    def close(self) -> None:
        """Close all endpoints."""
        self._board.close()
        self._pad.close()
        self._selector.close()
        self._sockets.close()
        for file in self._files:
            file.unlink(missing_ok=True)

    def _check_owner(self, owner: int) -> None:
        if not os.read(owner, READ_SIZE):
            self.is_orphaned = not self._stopping  # after `stop` the owner lives, and needs the recording
            self.stop()

    def _now_s(self) -> float:
        return time.monotonic() - self.t_start_s

    def _wait_s(self) -> float:
        due_s = [self.world.t_s + STEP_S, *self._board.due_s(), *(report.t_arrive_s for report in self._reports)]
        return max(min(due_s) - self._now_s(), 0.0)

    def _keep_up(self, now_s: float) -> None:
        if now_s - self.world.t_s > MAX_BEHIND_S:
            self.world.skip(now_s)
        self._advance(min(now_s, self.world.t_s + MOST_AT_ONCE_S))

    def _advance(self, now_s: float) -> None:
        self._hold()
        for t_s, data in self._board.arrived(now_s):
            self._run_to(t_s)
            self.world.receive(data, t_s)
        self._run_to(now_s)
        self._board.deliver(now_s)
        self._scan(now_s)
        while self._reports and self._reports[0].t_arrive_s <= now_s:
            self._pad.send(self._reports.popleft().data)
        if self._sockets.is_truth_due(now_s):
            self._publish_truth()

    def _hold(self) -> None:
        """Apply the positions of a user's fingers, from the first time not yet computed."""
        t_s = self.world.t_ahead_s
        for touches in self._sockets.held():
            if touches.fingers is None:
                self.hands.lift_scripted(t_s)
            else:
                self.hands.hold(touches.fingers, t_s, touches.sender)
        self.hands.expire(t_s)

    def _publish_truth(self) -> None:
        now = self.world.now()
        shapes = self.plate.shapes(now.finger_mm)
        t_s = self.world.t_s
        self._sockets.publish(t_s, round((self.t_start_s + t_s) * 1e9), now, shapes @ now.plate_um)

    def _scan(self, now_s: float) -> None:
        """Sample up to now; reports wait in `_reports` for the sensor's latency."""
        while self._t_scan_s <= now_s:
            report = next(self._scans)
            self._t_scan_s = report.t_sample_s
            if report.data:
                self._reports.append(report)

    def _run_to(self, t_s: float) -> None:
        while output := self.world.advance(t_s):
            self._board.send(output, self.world.t_s)

    def save(self, path: Path) -> None:
        """Write the history of plate and fingers as the arrays of `sim.run`; a user's fingers follow the scenario's."""
        recording = self.world.recording()
        targets_um = [actor.target_um(recording.t_s) for actor in self.actors if actor.path is not None]
        scripted = len(targets_um)
        used = np.isfinite(recording.finger_mm[..., 0]).any(axis=0) | (
            np.arange(recording.finger_mm.shape[1]) < scripted
        )
        finger_mm = recording.finger_mm[:, used]
        target_um = np.full(finger_mm.shape[:2], np.nan)  # the targets of a user's fingers are not known here
        target_um[:, :scripted] = np.reshape(targets_um, (scripted, len(recording.t_s))).T
        absent = ~np.isfinite(finger_mm[..., 0])
        target_um[absent] = np.nan
        truth_um = np.einsum("tnp,tp->tn", self.plate.shapes(finger_mm), recording.plate_um)
        truth_um[absent] = np.nan
        np.savez_compressed(
            path,
            t_s=recording.t_s,
            finger_true_mm=finger_mm,
            target_um=target_um,
            reference_um=recording.reference_um,
            modal_um=recording.plate_um[:, : recording.reference_um.shape[1]],
            plate_um=recording.plate_um,
            truth_um=truth_um,
        )


def main() -> None:
    """Run the process until SIGTERM, SIGINT or the end of its standard input, with which its directory goes."""
    directory, settings = Path(sys.argv[1]), RigSettings(**json.loads(sys.argv[2]))
    try:
        rig = Rig(directory, settings)
    except (DeviceError, UsageError, ValueError) as error:
        sys.exit(f"hapticd.sim.rig.program: {error}")
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: rig.stop())
    try:
        print(f"ready {rig.t_start_s}", flush=True)
        rig.serve(sys.stdin.fileno())
    except BrokenPipeError:  # the owner has died
        rig.is_orphaned = True
    finally:
        rig.close()
    if rig.is_orphaned:
        shutil.rmtree(directory, ignore_errors=True)  # the owner, who has died, would have deleted it
    elif settings.record:
        rig.save(directory / HISTORY_FILE)


if __name__ == "__main__":
    main()
