"""A lock-step run in which things go wrong on purpose: plugs, lines, processes, clocks.

What happens is said before the run: `ways` changes what travels, `at` does something at an instant. The physics, the
firmware and the machine are those of `lockstep`; so is what that leaves out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import numpy.typing as npt

from ..values import RawReport
from .fingers.scenarios import Actor
from .lockstep import T_START_NS, Settings, Simulation

# What would arrive at t_ns, to what does, and when.
Way = Callable[[int, bytes], Iterable[tuple[int, bytes]]]
BOOT_S = 0.03  # a board that was reset says and hears nothing for so long

_DEVICE_OF = {"board": "board", "host": "board", "report": "trackpad"}  # by kind of event


class FaultySimulation(Simulation):
    """A run in the making, with faults. Instants are seconds of the run.

    `ways` may hold a Way for "board" (bytes to it), "host" (bytes from it) and "report" (the trackpad's).
    """

    def __init__(self, actors: tuple[Actor, ...], settings: Settings, seed: int) -> None:
        self.ways: dict[str, Way] = {}
        self.client_lives = True
        self._acts: list[Callable[[int], None]] = []
        self._carries = {"board": True, "trackpad": True}
        self._daemon_runs = True
        self._waiting: dict[str, list[bytes]] = {}
        self._host_ahead_ns = 0
        self._resets = 0
        super().__init__(actors, settings, seed)

    @property
    def t_ns(self) -> int:
        """The instant of the last event, as the machine has it."""
        return self._t_ns + self._host_ahead_ns

    def at(self, t_s: float, act: Callable[[int], None]) -> None:
        """Do it at `t_s`; it gets the instant, as the machine has it."""
        self._acts.append(act)
        super()._push(T_START_NS + round(t_s * 1e9), "fault", str(len(self._acts) - 1).encode())

    def level_um(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Times (T,) in s and the largest amplitude of all modes of the true plate (T,), neighbours included."""
        recording = self.world.recording()
        return recording.t_s, np.abs(recording.plate_um).max(axis=1)

    # --- what may go wrong; each is an act for `at` ---

    def pull_board(self, t_ns: int) -> None:
        """The serial device is gone: the machine is told as the port's own error would tell it, at once."""
        self._carries["board"] = False
        self.machine.board_link(False, "the port is lost", t_ns)

    def plug_board(self, t_ns: int) -> None:
        self._carries["board"] = True
        self.machine.board_link(True, "open", t_ns)

    def pull_trackpad(self, t_ns: int) -> None:
        self._carries["trackpad"] = False
        self.machine.trackpad_link(False, "lost", t_ns)

    def plug_trackpad(self, t_ns: int) -> None:
        self._carries["trackpad"] = True
        self.machine.trackpad_link(True, "open", t_ns)

    def reset_board(self, t_ns: int) -> None:
        """Its watchdog bites; the port stays, and for BOOT_S nobody is behind it."""
        del t_ns
        self._resets += 1
        self.world.reset_board(self.seed + 1000 * self._resets)  # each boot has an id of its own
        self._carries["board"] = False
        self.at((self._t_ns - T_START_NS) * 1e-9 + BOOT_S, lambda _: self._carries.update(board=True))

    def stop_client(self, t_ns: int) -> None:
        """Killed or stopped: the daemon hears no more of it, and nobody says so."""
        del t_ns
        self.client_lives = False

    def resume_client(self, t_ns: int) -> None:
        del t_ns
        self.client_lives = True

    def stop_daemon(self, t_ns: int) -> None:
        """SIGSTOP or SIGKILL: what arrives, the kernel keeps."""
        del t_ns
        self._daemon_runs = False

    def resume_daemon(self, t_ns: int) -> None:
        """SIGCONT: one turn of its loop takes what has arrived, each stream at once and the timer once."""
        self._daemon_runs = True
        waiting, self._waiting = self._waiting, {}
        self.machine.board_bytes(b"".join(waiting.get("host", ())), t_ns)
        reports = waiting.get("report", ())
        if reports:
            self.machine.reports([RawReport(t_ns, report) for report in reports], t_ns)
        self.machine.timer(t_ns)

    def end_daemon(self, t_ns: int) -> None:
        """SIGTERM."""
        self.machine.stop(t_ns)
        self._daemon_runs = False

    def start_daemon(self, t_ns: int) -> None:
        """Another process in a dead one's place; it finds both devices."""
        self._daemon_runs = True
        self._waiting.clear()
        self.machine = self._new_machine()
        self.machine.trackpad_link(True, "open", t_ns)
        self.machine.board_link(True, "open", t_ns)

    def leap_host_clock(self, seconds: float) -> Callable[[int], None]:
        """From now on the daemon's clock is so far ahead, as after a suspend that the clock counted."""

        def act(t_ns: int) -> None:
            del t_ns
            self._host_ahead_ns += round(seconds * 1e9)

        return act

    # --- the events of a run, where faults get between ---

    def _push(self, t_ns: int, kind: str, data: bytes) -> None:
        way = self.ways.get(kind)
        for t_arrive_ns, piece in way(t_ns, data) if way is not None else ((t_ns, data),):
            super()._push(t_arrive_ns, kind, piece)

    def _handle(self, kind: str, data: bytes, t_ns: int) -> None:
        t_machine_ns = t_ns + self._host_ahead_ns
        if kind == "fault":
            self._acts[int(data)](t_machine_ns)
        elif kind in _DEVICE_OF and not self._carries[_DEVICE_OF[kind]]:
            pass  # nobody is there
        elif kind == "board":
            super()._handle(kind, data, t_ns)
        elif self._daemon_runs:
            super()._handle(kind, data, t_machine_ns)
        else:
            self._waiting.setdefault(kind, []).append(data)

    def _ask(self, t_ns: int) -> None:
        if self.client_lives:
            super()._ask(t_ns)
