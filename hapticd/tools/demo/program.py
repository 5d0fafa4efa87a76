"""The demo: everything of hapticd at once, in real time and in separate processes, watched from a client.

    simulated rig (board and trackpad) <-- pseudo-terminal, socket --> daemon <-- ZeroMQ --> this process

The client asks for a slippery and a sticky finger, a live view shows what they get, and at the end the plate's true
motion is judged beside the paper's scheme on the same fingers. The board is the firmware's core within the rig, or
its whole program in a process of its own, with a simpler plate inside: then the paper's scheme gets that too.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...config.sections import LimitsConfig
from ...errors import HapticdError, UsageError
from ...files.outputs import check_writable
from ...io import owned_process as ownedprocess
from ...sim import lockstep
from ...sim.board.emulator import find_program
from ...sim.fingers.scripted import ScriptedClient
from ...sim.picture import Film, draw
from ...sim.plate.truth import PlateSettings
from ...sim.rig.process import RigProcess
from ...sim.scenarios import SCENARIOS, SPEED_MM_S
from ...sim.score import Score, score
from ...values import AmplitudeTarget
from ..daemon_process import DaemonProcess
from .live_view import LiveView

if TYPE_CHECKING:
    from hapticd_client import Client, PlateState

SCENARIO = "strokes"
FINGERS = 2
DAEMON_WITHIN_S = 15.0
FINGERS_WITHIN_S = 10.0
PICTURE_S = 2.5

BOARD_NAMES = {"library": "hapticd", "host": "hapticd, the board a process"}

# What the plate inside another process leaves out, left out for the paper's scheme as well.
BARE_PLATE = PlateSettings(
    finger_decay_1_s=0.0, neighbour_coupling=0.0, neighbour_pickup=0.0, sensor_crosstalk=0.0, sensor_noise_um=0.0
)


def show(
    seconds: float,
    seed: int,
    out: Path,
    *,
    board: str = "library",
    image: Path | None = None,
    in_browser: bool = False,
) -> int:
    """Run the demo for `seconds`, print the summary and write the picture. Returns the exit code.

    `board` is "library" or "host"; `image` the program for the latter, if not the source checkout's. `in_browser` opens
    a page (`viewer`) where the plate can be watched meanwhile.
    """
    try:
        import hapticd_client
    except ImportError:
        raise HapticdError("The demo is a client too: install it with `pip install clients/python`.") from None
    if not seconds > 0:
        raise UsageError(f"--seconds: {seconds:g} is too short, the fingers must move for some time.")
    check_writable(out)
    if board == "library" and image is not None:
        raise UsageError("--image is for a board in another process: give --board host as well.")
    program = None if board == "library" else find_program(image)
    try:
        return _play(seconds, seed, out, board, program, in_browser=in_browser)
    except hapticd_client.HapticdError as error:
        raise HapticdError(f"The demo's client: {error}") from None


def _play(seconds: float, seed: int, out: Path, board: str, program: Path | None, *, in_browser: bool) -> int:
    import hapticd_client

    print("starting the simulated rig, the daemon and a client ...", flush=True)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # what was started ends too
    with tempfile.TemporaryDirectory(prefix="hapticd-demo-") as folder:
        record = Path(folder, "plate.npz")
        rig = RigProcess(SCENARIO, seed, record=record, program=program)
        with rig, DaemonProcess(f'rig_dir = "{rig.directory}"') as daemon:
            with hapticd_client.Client(daemon.runtime_dir, name="demo", timeout_s=DAEMON_WITHIN_S) as client:
                person = _Person(client, rig, seed)
                with _watched(daemon.runtime_dir, opens=in_browser):
                    t_asked_s = _ask(client, person)
                    status = _watch(client, person, seconds)
                if status["board"].get("refused"):
                    raise HapticdError(status["board"]["refused"])
            t_end_s = time.monotonic() - rig.t_start_s
        with np.load(record) as arrays:
            ours = _film(dict(arrays), BOARD_NAMES[board]).between(t_asked_s, t_end_s)
    print("\njudging it, and the paper's scheme on the same fingers ...", flush=True)
    same_plate = lockstep.Settings() if board == "library" else lockstep.Settings(plate=BARE_PLATE)
    played = lockstep.run(SCENARIO, settings=lockstep.paper(same_plate), seed=seed, seconds=t_end_s)
    paper = Film.of(played, "the paper's scheme").between(t_asked_s, t_end_s)
    draw([ours, paper], out, w_limit_um=max(LimitsConfig().w_limit_um), seconds=PICTURE_S)
    print(summary(ours.score, paper.score, status))
    if board == "library":
        print(
            "Both know a noisy map of the driven modes; hapticd also one of the two beside them, which fingers drive."
        )
    else:
        print("Both plates here feel no fingers and have no neighbouring modes: these figures flatter both schemes.")
    if status["board"].get("deadman_trips", 0) > 0:
        print("The board fell silent for want of frames in time: this computer is too busy to emulate it; try again.")
    print(f"picture: {out.resolve()}")
    print("To touch such a plate yourself, in the browser: hapticd view --sim")
    return 0


def summary(ours: Score, paper: Score, status: dict[str, Any]) -> str:
    """What the demo showed, in a few lines."""
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


class _Person:
    """Whose fingers the scenario plays: asks for what each should feel, whenever one lands.

    On a computer that stalls the pad seems silent, its fingers count as lifted, and land anew under other ids.
    """

    def __init__(self, client: Client, rig: RigProcess, seed: int) -> None:
        self._client, self._rig = client, rig
        self._scripted = ScriptedClient(SCENARIOS[SCENARIO].build(seed, SPEED_MM_S))
        self._asked: set[int] = set()

    def see(self, state: PlateState) -> None:
        """Ask for what the fingers that are new shall feel."""
        fingers = [(finger.id, finger.x_mm, finger.y_mm) for finger in state.fingers if isinstance(finger.id, int)]
        if all(finger_id in self._asked for finger_id, _, _ in fingers):
            return
        t_s = self.t_s()
        wanted = self._scripted.wants(t_s, t_s - state.age_ms * 1e-3, fingers)
        for finger, target in (wanted.targets if wanted is not None else {}).items():
            if isinstance(finger, int) and finger not in self._asked and isinstance(target, AmplitudeTarget):
                self._client.set(finger, amplitude_um=target.amplitude_um, wait=False)
                self._asked.add(finger)

    def t_s(self) -> float:
        """Now, in the rig's time."""
        return time.monotonic() - self._rig.t_start_s


def _ask(client: Client, person: _Person) -> float:
    """Wait for the scenario's fingers and ask for what each should feel. Returns when, in the rig's time."""
    t_give_up_s = time.monotonic() + FINGERS_WITHIN_S
    for state in client.states(timeout_s=FINGERS_WITHIN_S):
        if len(state.fingers) == FINGERS:
            person.see(state)
            return person.t_s()
        if time.monotonic() > t_give_up_s:
            break
    raise HapticdError("The simulated fingers did not land: try `hapticd run --sim` and read what it says.")


@contextmanager
def _watched(runtime_dir: Path, *, opens: bool) -> Iterator[None]:
    """The plate's page is served as well, and its address told. Where it cannot be, who wants it opened hears why."""
    if not opens and find_spec("aiohttp") is None:
        yield
        return
    command = ["view", "--endpoint", str(runtime_dir), "--port", "0", *([] if opens else ["--no-browser"])]
    with ownedprocess.start(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        print(process.stdout.readline(), end="", flush=True)
        try:
            yield
        finally:
            process.terminate()


def _watch(client: Client, person: _Person, seconds: float) -> dict[str, Any]:
    """Show the live view for `seconds`; returns the daemon's status at its end."""
    view = LiveView(sys.stdout)
    t_end_s = time.monotonic() + seconds
    for state in client.states(timeout_s=2.0):
        t_now_s = time.monotonic()
        person.see(state)
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
