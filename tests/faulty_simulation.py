"""Fault injection into a lock-step run: plugs, lines, processes, clocks.

Faults are defined before the run: `line_faults` change what is transferred, `at` schedules an action. Physics,
firmware, machine and idealisations are those of `lockstep`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import numpy.typing as npt

from hapticd.sim.fingers.scenarios import Actor
from hapticd.sim.lockstep import T_START_NS, Simulation
from hapticd.sim.settings import Measured, Settings
from hapticd.values import RawReport

# Maps bytes that would arrive at t_ns to those that do, with their times.
LineFault = Callable[[int, bytes], Iterable[tuple[int, bytes]]]
BOOT_S = 0.03  # a board neither sends nor receives for so long after a reset

_DEVICE_OF = {"board": "board", "host": "board", "report": "trackpad"}  # by kind of event


class FaultySimulation(Simulation):
    """A lock-step run with faults. Instants are seconds of the run.

    `line_faults` may hold a LineFault for "board" (bytes to it), "host" (bytes from it) and "report" (the trackpad's).
    """

    def __init__(
        self, actors: tuple[Actor, ...], settings: Settings, seed: int, measured: Measured | None = None
    ) -> None:
        self.line_faults: dict[str, LineFault] = {}
        self.client_lives = True
        self._actions: list[Callable[[int], None]] = []
        self._carries = {"board": True, "trackpad": True}
        self.daemon_runs = True
        self._waiting: dict[str, list[bytes]] = {}
        self._host_ahead_ns = 0
        self._resets = 0
        super().__init__(actors, settings, seed, measured)

    @property
    def t_ns(self) -> int:
        """The instant of the last event on the machine's clock."""
        return self._t_ns + self._host_ahead_ns

    def at(self, t_s: float, action: Callable[[int], None]) -> None:
        """Schedule `action` at `t_s`; it receives the instant on the machine's clock."""
        self._actions.append(action)
        super()._push(T_START_NS + round(t_s * 1e9), "fault", str(len(self._actions) - 1).encode())

    def level_um(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return times (T,) in s and the largest amplitude of all modes of the plate (T,), parasitic ones included."""
        recording = self.world.recording()
        return recording.t_s, np.abs(recording.plate_um).max(axis=1)

    # --- faults; each is an action for `at` ---

    def pull_board(self, t_ns: int) -> None:
        """Disconnect the serial device: reported to the machine at once, as by the port's error."""
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

    def reset_board(self, _t_ns: int) -> None:
        """Watchdog reset: the port stays open, without a board behind it for BOOT_S."""
        self._resets += 1
        self.world.board.reset(self.seed + 1000 * self._resets)  # each boot has a new id
        self.world._board_start_us = self.world.board.unwrapped_us - round(self.world.t_s * 1e6)
        self._carries["board"] = False
        self.at((self._t_ns - T_START_NS) * 1e-9 + BOOT_S, lambda _: self._carries.update(board=True))

    def stop_client(self, _t_ns: int) -> None:
        """Stop or kill the client: its messages end without notice."""
        self.client_lives = False

    def resume_client(self, _t_ns: int) -> None:
        self.client_lives = True

    def stop_daemon(self, _t_ns: int) -> None:
        """SIGSTOP or SIGKILL: the kernel buffers what arrives."""
        self.daemon_runs = False

    def resume_daemon(self, t_ns: int) -> None:
        """SIGCONT: one loop iteration reads what was buffered, each stream at once and the timer once."""
        self.daemon_runs = True
        waiting, self._waiting = self._waiting, {}
        self.machine.board_bytes(b"".join(waiting.get("host", ())), t_ns)
        reports = waiting.get("report", ())
        if reports:
            self.machine.reports([RawReport(t_ns, report) for report in reports], t_ns)
        self.machine.timer(t_ns)

    def end_daemon(self, t_ns: int) -> None:
        """SIGTERM."""
        self.machine.stop(t_ns)
        self.daemon_runs = False

    def start_daemon(self, t_ns: int) -> None:
        """Start a new daemon process; it finds both devices."""
        self.daemon_runs = True
        self._waiting.clear()
        self.machine = self._new_machine()
        self.machine.trackpad_link(True, "open", t_ns)
        self.machine.board_link(True, "open", t_ns)

    def leap_host_clock(self, seconds: float) -> Callable[[int], None]:
        """Return an action that advances the daemon's clock, as after a suspend that the clock counted."""

        def action(_t_ns: int) -> None:
            self._host_ahead_ns += round(seconds * 1e9)

        return action

    # --- events of a run, where faults apply ---

    def _push(self, t_ns: int, kind: str, data: bytes) -> None:
        fault = self.line_faults.get(kind)
        for t_arrive_ns, piece in fault(t_ns, data) if fault is not None else ((t_ns, data),):
            super()._push(t_arrive_ns, kind, piece)

    def _handle(self, kind: str, data: bytes, t_ns: int) -> None:
        t_machine_ns = t_ns + self._host_ahead_ns
        if kind == "fault":
            self._actions[int(data)](t_machine_ns)
        elif kind in _DEVICE_OF and not self._carries[_DEVICE_OF[kind]]:
            pass  # not connected
        elif kind == "board":
            super()._handle(kind, data, t_ns)
        elif self.daemon_runs:
            super()._handle(kind, data, t_machine_ns)
        else:
            self._waiting.setdefault(kind, []).append(data)

    def _send_targets(self, t_ns: int) -> None:
        if self.client_lives:
            super()._send_targets(t_ns)
