"""`hapticd demo`: rig, daemon and client as separate processes in real time, with a score at the end.

    simulated rig (board and trackpad) <-- pseudo-terminal, socket --> daemon <-- ZeroMQ --> this process

The client sets a slippery and a sticky finger, a live view shows their amplitudes, and at the end the plate's true
motion is scored against the paper's scheme on the same fingers. The board is the firmware's core in the rig, or its
whole program in a process, with a simpler plate inside; the paper's scheme then gets the same plate.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...config.sections import LimitsConfig, SimConfig
from ...errors import HapticdError, UsageError, missing_client
from ...files import outputs, plotting
from ...sim import lockstep
from ...sim.board.emulator import find_program
from ...sim.fingers.scenarios import SCENARIOS, SPEED_MM_S
from ...sim.fingers.scripted import ScriptedClient
from ...sim.picture import Film, draw
from ...sim.plate.ground_truth import PlateSettings
from ...sim.rig.process import RigProcess
from ...sim.score import Score, score
from ...tools import owned_process
from ...values import AmplitudeTarget
from .. import glass
from ..arguments import number, whole
from ..daemon_process import DaemonProcess
from ..progress import Progress
from .live_view import LiveView

if TYPE_CHECKING:
    from hapticd_client import Client, PlateState

DEFAULT_OUT = Path("demo.png")
SCENARIO = "strokes"
FINGERS = 2
DAEMON_WITHIN_S = 15.0
FINGERS_WITHIN_S = 10.0
PICTURE_S = 2.5

BOARD_NAMES = {"library": "hapticd", "host": "hapticd, the board a process"}

# The plate inside another process lacks these effects; the paper's scheme gets the same plate.
BARE_PLATE = PlateSettings(
    finger_decay_1_s=0.0, parasitic_coupling=0.0, parasitic_pickup=0.0, sensor_crosstalk=0.0, sensor_noise_um=0.0
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add duration, seed, board and outputs."""
    parser.add_argument("--seconds", type=number(0.0, is_above=True), default=10.0, help="duration (default 10)")
    parser.add_argument("--seed", type=whole(0), default=1, help="of fingers, noise and mode map (default 1)")
    glass.add_arguments(parser)
    outputs.add_file(parser, "--out", outputs.PICTURE, metavar="F.png", help="the picture (default demo.png)")
    parser.add_argument(
        "--board",
        choices=("library", "host"),
        default="library",
        help="the firmware's core in the rig (default), or its whole program as a process",
    )
    parser.add_argument("--image", type=Path, metavar="FILE", help="that program (default: built by make -C firmware)")
    parser.add_argument("--view", action="store_true", help="open the plate's page in the browser meanwhile")
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Run the demo, print the summary and write the picture; the page of `hapticd view` is served meanwhile."""
    try:
        import hapticd_client
    except ImportError:
        raise missing_client("The demo") from None
    if options.board == "library" and options.image is not None:
        raise UsageError("--image needs a board in another process: give --board host as well.")
    sim = glass.chosen(options)
    if options.board == "host" and sim != SimConfig():
        raise UsageError("--plate and --modes: the board in another process has the reference plate with two modes.")
    program = None if options.board == "library" else find_program(options.image)
    out = _picture_file(options)
    try:
        _play(options, program, out)
    except hapticd_client.HapticdError as error:
        raise HapticdError(f"The demo's client: {error}") from None


def _picture_file(options: argparse.Namespace) -> Path | None:
    """Return the picture's file, None without matplotlib if none was requested. Raises UsageError."""
    if options.out is not None:
        return Path(options.out)
    try:
        plotting.check(DEFAULT_OUT)
    except HapticdError as error:
        print(f"without a picture: {error}", flush=True)
        return None
    outputs.check([DEFAULT_OUT], is_forced=options.force)
    return DEFAULT_OUT


def _play(options: argparse.Namespace, program: Path | None, out: Path | None) -> None:
    import hapticd_client

    board, seed = options.board, options.seed
    print("starting the simulated rig, the daemon and a client ...", flush=True)
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, lambda *_: sys.exit(0))  # ends the child processes too
    sim = glass.chosen(options)
    rig = RigProcess(SCENARIO, seed, plate=sim.plate, modes=sim.modes, record=True, program=program)
    with rig, DaemonProcess(f'rig_dir = "{rig.directory}"') as daemon:
        with hapticd_client.Client(daemon.runtime_dir, name="demo", timeout_s=DAEMON_WITHIN_S) as client:
            user = _ScriptedUser(client, rig, seed)
            with _watched(daemon.runtime_dir, opens=options.view):
                t_asked_s = _wait_for_fingers(client, user)
                status = _watch(client, user, options.seconds)
            if status["board"].get("refused"):
                raise HapticdError(status["board"]["refused"])
        t_end_s = time.monotonic() - rig.t_start_s
    ours = _film(rig.history, BOARD_NAMES[board]).between(t_asked_s, t_end_s)
    print("\nscoring it, and the paper's scheme on the same fingers ...", flush=True)
    same_plate = lockstep.Settings() if board == "library" else lockstep.Settings(plate=BARE_PLATE)
    with Progress("the paper's scheme") as progress:
        settings = lockstep.paper(same_plate)
        paper_run = lockstep.run(SCENARIO, settings=settings, seed=seed, seconds=t_end_s, progress=progress)
    paper = Film.of(paper_run, "the paper's scheme").between(t_asked_s, t_end_s)
    if out is not None:
        limit_um, source = max(LimitsConfig().w_limit_um), f"demo, seed {seed}"
        draw([ours, paper], out, w_limit_um=limit_um, seconds=PICTURE_S, source=source)
    print(summary(ours.score, paper.score, status))
    if board == "library":
        print(
            "Both have a noisy map of the driven modes; hapticd also one of the parasitic modes, which fingers excite."
        )
    else:
        print("Without damping by fingers and parasitic modes, these figures are optimistic for both schemes.")
    if status["board"].get("deadman_trips", 0) > 0:
        print("The board's dead-man timeout tripped: the host is too loaded to emulate it; try again.")
    if out is not None:
        print(f"picture: {out.resolve()}")
    print("To touch such a plate yourself, in the browser: hapticd view --sim")


def summary(ours: Score, paper: Score, status: dict[str, Any]) -> str:
    """Return the scores and latencies as a few lines."""
    latency = status["latency_ms"]
    lines = [
        "",
        f"{'':<24}{'hapticd':>10}{'the paper':>12}",
        f"{'sticky finger, um RMS':<24}{ours.leak_um:>10.3f}{paper.leak_um:>12.3f}",
        f"{'slippery, um RMS off':<24}{ours.slip_error_um:>10.3f}{paper.slip_error_um:>12.3f}",
        f"{'slippery, of target':<24}{ours.slip_frac:>10.1%}{paper.slip_frac:>12.1%}",
        "",
    ]
    if ours.leak_um > 0:
        ratio = paper.leak_um / ours.leak_um
        lines.append(f"The sticky finger gets {ratio:.1f} times less vibration than under the paper's.")
    if latency:
        lines.append(
            f"{latency['frames_hz']:.0f} frames/s; the sample is {latency['age']['p50']:.1f} ms old, the link takes "
            f"{latency['link']['p50']:.1f} ms: fingers are predicted {latency['horizon']['p50']:.1f} ms ahead."
        )
    return "\n".join(lines)


class _ScriptedUser:
    """Sets the target of each of the scenario's fingers when it lands.

    On a stalled host the pad seems silent, its fingers count as lifted, and land again under other ids.
    """

    def __init__(self, client: Client, rig: RigProcess, seed: int) -> None:
        self._client, self._rig = client, rig
        self._scripted = ScriptedClient(SCENARIOS[SCENARIO].build(seed, SPEED_MM_S))
        self._known: set[int] = set()

    def update(self, state: PlateState) -> None:
        """Set the targets of new fingers."""
        fingers = [(finger.id, finger.x_mm, finger.y_mm) for finger in state.fingers if isinstance(finger.id, int)]
        if all(finger_id in self._known for finger_id, _, _ in fingers):
            return
        t_s = self.t_s()
        targets = self._scripted.message(t_s, t_s - state.age_ms * 1e-3, fingers)
        for finger, target in (targets.targets if targets is not None else {}).items():
            if isinstance(finger, int) and finger not in self._known and isinstance(target, AmplitudeTarget):
                self._client.set(finger, amplitude_um=target.amplitude_um, wait=False)
                self._known.add(finger)

    def t_s(self) -> float:
        """Return the current time of the rig."""
        return time.monotonic() - self._rig.t_start_s


def _wait_for_fingers(client: Client, user: _ScriptedUser) -> float:
    """Wait for the scenario's fingers and set their targets. Return the instant in the rig's time."""
    t_give_up_s = time.monotonic() + FINGERS_WITHIN_S
    for state in client.states(timeout_s=FINGERS_WITHIN_S):
        if len(state.fingers) == FINGERS:
            user.update(state)
            return user.t_s()
        if time.monotonic() > t_give_up_s:
            break
    raise HapticdError("The simulated fingers did not land: try `hapticd run --sim` and read its log.")


@contextmanager
def _watched(runtime_dir: Path, *, opens: bool) -> Iterator[None]:
    """Serve the plate's page and print its address. Without aiohttp it is skipped, unless it is to be opened."""
    if not opens and find_spec("aiohttp") is None:
        yield
        return
    command = ["view", "--endpoint", str(runtime_dir), "--port", "0", *([] if opens else ["--no-browser"])]
    with owned_process.start(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        print(process.stdout.readline(), end="", flush=True)
        try:
            yield
        finally:
            process.terminate()


def _watch(client: Client, user: _ScriptedUser, seconds: float) -> dict[str, Any]:
    """Show the live view for `seconds`; return the daemon's status at its end."""
    view = LiveView(sys.stdout)
    t_end_s = time.monotonic() + seconds
    for state in client.states(timeout_s=2.0):
        t_now_s = time.monotonic()
        user.update(state)
        view.update(state, t_now_s)
        if t_now_s >= t_end_s:
            break
    view.close()
    return client.status()


def _film(arrays: dict[str, Any], title: str) -> Film:
    nothing = np.zeros(len(arrays["t_s"]), dtype=bool)
    return Film(
        title=title,
        t_s=arrays["t_s"],
        target_um=arrays["target_um"],
        reference_um=arrays["reference_um"],
        modal_um=arrays["modal_um"],
        truth_um=arrays["truth_um"],
        score=score(arrays["t_s"], arrays["target_um"], arrays["truth_um"], arrays["reference_um"], nothing),
    )
