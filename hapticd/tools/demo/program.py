"""`hapticd demo`: rig, daemon and client as separate processes in real time, with a score at the end.

    simulated rig (board and trackpad) <-- pseudo-terminal, socket --> daemon <-- ZeroMQ --> this process

The client sets a slippery and a sticky finger on the fingertip plate and prints their amplitudes, and at the end the
plate's true motion is scored, and the same fingers in virtual time, which is the same on each computer: the paper's
scheme on its plate, and hapticd on the wide plate with eight modes.
"""

from __future__ import annotations

import argparse
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import hapticd_client
from hapticd_client import Client, PlateState

from ...errors import HapticdError
from ...sim.fingers.scenarios import SCENARIOS, SPEED_MM_S, with_motion
from ...sim.fingers.scripted import ScriptedClient
from ...sim.rig.process import RigProcess
from ...sim.score import CONTACT_RADIUS_MM
from ...tools import owned_process
from .. import outputs, plotting
from ..arguments import POSITIVE, whole
from ..daemon_process import DaemonProcess
from .columns import COLUMNS, LIVE, MOTION, DemoColumn, virtual_film
from .film import Film
from .picture import draw

DEFAULT_OUT = Path("demo.png")  # written again over that of an earlier demo
SOURCE = "demo, seed "  # in the picture's signature
SCENARIO = "half-strokes"
FINGERS = 2
# A busy computer takes a multiple of the usual seconds; a daemon or a rig that ends is noticed at once.
ATTEMPT_S = 15.0
FINGERS_WITHIN_S = 60.0
STATE_WITHIN_S = 10.0
LINE_S = 1.0
PICTURE_S = 2.5
LEAST_SLIP_FRAC = 0.5  # of the slippery finger's target: a plate that is not driven leaks nothing
COMPARED_S = 6.0  # in virtual time, which takes a second for every two on the fingertip plate without compiled modules
VIRTUAL_START_S = 1.0  # the fingers have landed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=POSITIVE, default=10.0, help="duration (default 10)")
    parser.add_argument("--seed", type=whole(0), default=1, help="of fingers, noise and mode map (default 1)")
    outputs.add_file(parser, "--out", outputs.PICTURE, metavar="F.png", help="the picture (default demo.png)")
    parser.add_argument("--view", action="store_true", help="open the plate's page in the browser meanwhile")
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Run the demo, print the summary and write the picture; the page of `hapticd view` is served meanwhile."""
    out = _picture_file(options)
    try:
        _play(options, out)
    except hapticd_client.HapticdError as error:
        raise HapticdError(f"The demo's client: {error}") from None


def _picture_file(options: argparse.Namespace) -> Path | None:
    """Return the picture's file, None without matplotlib if none was requested. Raises UsageError."""
    if options.out is not None:
        return Path(options.out)
    try:
        outputs.require_matplotlib()
    except HapticdError as error:
        print(f"without a picture: {error}", flush=True)
        return None
    is_own = outputs.has_mark(DEFAULT_OUT, f", {SOURCE}".encode(), plotting.SIGNED_BYTES)
    outputs.check([DEFAULT_OUT], is_forced=options.force or is_own)
    return DEFAULT_OUT


def _play(options: argparse.Namespace, out: Path | None) -> None:
    seed = options.seed
    print("starting the simulated rig, the daemon and a client ...", flush=True)
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, lambda *_: sys.exit(0))  # ends the child processes too
    rig = RigProcess(SCENARIO, seed, motion=MOTION, plate=LIVE.plate.plate, record=True)
    with (
        rig,
        DaemonProcess(f'rig_dir = "{rig.directory}"') as daemon,
        _connected(daemon) as client,
    ):
        user = _ScriptedUser(client, rig, seed)
        with _watched(daemon.runtime_dir, opens=options.view):
            t_asked_s = _wait_for_fingers(client, user)
            status = _watch(client, user, options.seconds)
        if status["board"].get("refused"):
            raise HapticdError(status["board"]["refused"])
    compared_s = min(options.seconds, COMPARED_S)
    print("\nscoring it, and the same fingers in virtual time ...", flush=True)
    ours = Film.between(f"{LIVE.title}, live", LIVE.plate, rig.history.__getitem__, t_asked_s, t_asked_s + compared_s)
    window_s = VIRTUAL_START_S, VIRTUAL_START_S + compared_s
    films = {column: ours if column == LIVE else virtual_film(column, SCENARIO, seed, *window_s) for column in COLUMNS}
    if out is not None:
        draw(list(films.values()), out, seconds=PICTURE_S, source=f"{SOURCE}{seed}")
    print(summary(films, status))
    print("All have a noisy map of the driven modes.")
    if status["board"].get("deadman_trips", 0) > 0:
        print("The board's dead-man timeout tripped: the host is too loaded to emulate it; try again.")
    if out is not None:
        print(f"picture: {out.resolve()}")
    caller = sys.argv[0] if Path(sys.argv[0]).name == "hapticd" else "hapticd"  # `make` calls one off the PATH
    print(f"To touch such a plate yourself, in the browser: {shlex.quote(caller)} view --sim")


def summary(films: Mapping[DemoColumn, Film], status: dict[str, Any]) -> str:
    """Return the scores and latencies as a few lines."""
    latency, scores, ours = status["latency_ms"], [film.score for film in films.values()], films[LIVE]

    def row(name: str, cells: Iterable[str]) -> str:
        return f"{name:<27}" + "".join(f"{cell:>16}" for cell in cells)

    def errors(finger: int) -> list[str]:
        found = [score.fingers[finger] for score in scores]
        return [f"{one.bias_jnd:.1f}, {one.median_jnd:.1f}, {one.error_95_jnd:.1f}" for one in found]

    lines = [
        "",
        row("", [column.scheme for column in films]),
        row("plate", [column.plate.plate for column in films]),
        row("", [f"{column.plate.driven_modes} modes" for column in films]),
        row("", ["live" if column == LIVE else "" for column in films]),
        row("both felt as asked", [f"{score.felt_frac:.0%}" for score in scores]),
        row("both within two JND", [f"{score.within_two_frac:.0%}" for score in scores]),
        row("slippery error, JND", errors(0)),
        row("sticky error, JND", errors(1)),
        row("sticky contact, um RMS", [f"{score.contact_leak_um:.3f}" for score in scores]),
        row("slippery contact, um RMS", [f"{score.contact_slip_um:.3f}" for score in scores]),
        row("contrast of the two", [f"{score.contrast:.1f}" for score in scores]),
        row("sticky centre, um RMS", [f"{score.leak_um:.3f}" for score in scores]),
        row("slippery centre, of target", [f"{score.slip_frac:.1%}" for score in scores]),
        f"Over {ours.seconds:.0f} s of strokes as of recorded hands; a contact is a disc of {CONTACT_RADIUS_MM:g} mm "
        "radius; targets are 0 and 0.5 um. A JND is 11 % of friction; errors: bias, median, 95 %.",
        "",
    ]
    if ours.score.leak_um > 0 and ours.score.slip_frac > LEAST_SLIP_FRAC:
        contact, centre = scores[0].contact_leak_um / ours.score.contact_leak_um, scores[0].leak_um / ours.score.leak_um
        lines.append(
            f"The sticky finger gets {centre:.1f} times less vibration at its centre than under the paper's scheme, "
            f"{contact:.1f} times less over its contact."
        )
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
        self._scripted = ScriptedClient(with_motion(SCENARIOS[SCENARIO].build(seed, SPEED_MM_S), MOTION))
        self._known: set[int] = set()

    def update(self, state: PlateState) -> None:
        """Set the targets of new fingers. Raises DeviceError if the rig has ended."""
        self._rig.check()
        fingers = [(finger.id, finger.x_mm, finger.y_mm) for finger in state.fingers if isinstance(finger.id, int)]
        if all(finger_id in self._known for finger_id, _, _ in fingers):
            return
        t_s = self.t_s()
        targets = self._scripted.message(t_s, t_s - state.age_ms * 1e-3, fingers)
        for target in () if targets is None else targets.targets:
            if isinstance(target.finger, int) and target.finger not in self._known:
                self._client.set(target.finger, amplitude_um=target.amplitude_um, wait=False)
                self._known.add(target.finger)

    def t_s(self) -> float:
        """Return the current time of the rig."""
        return time.monotonic() - self._rig.t_start_s


def _connected(daemon: DaemonProcess) -> Client:
    """Return a client of the daemon, however long that takes to start. Raises HapticdError if it ends."""
    while daemon.process.poll() is None:
        with suppress(hapticd_client.DaemonGoneError):
            return Client(daemon.runtime_dir, name="demo", timeout_s=ATTEMPT_S)
    raise HapticdError("The daemon has ended: see its message above.")


def _wait_for_fingers(client: Client, user: _ScriptedUser) -> float:
    """Wait for the scenario's fingers and set their targets. Return the instant in the rig's time."""
    t_give_up_s = time.monotonic() + FINGERS_WITHIN_S
    for state in client.states(timeout_s=FINGERS_WITHIN_S):
        user.update(state)
        if len(state.fingers) == FINGERS:
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
    """Print a line a second for `seconds`; return the daemon's status at its end."""
    t_next_s = time.monotonic()
    t_end_s = t_next_s + seconds
    for state in client.states(STATE_WITHIN_S):
        t_now_s = time.monotonic()
        user.update(state)
        if t_now_s >= t_next_s:
            print(line(state), flush=True)
            t_next_s += LINE_S
        if t_now_s >= t_end_s:
            break
    return client.status()


def line(state: PlateState) -> str:
    """Return what a state has of each finger: its target, and what it gets."""
    fingers = "  ".join(
        f"{finger.id}: {finger.target_um:.2f} -> {finger.achieved_um:.2f} um"
        for finger in state.fingers
        if finger.target_um is not None and finger.achieved_um is not None
    )
    flag = "  limited" if state.limited else ""
    return f"{state.state:<7} horizon {state.horizon_ms:4.1f} ms  {fingers}{flag}"
