"""The daemon: one asyncio loop that carries bytes between trackpad, board and clients, with `machine` in the middle.

Nothing on the loop blocks or computes for long. One event, one pass: reports, board bytes and client messages are
handled when they come, and a timer keeps the board alive. Each hand-over is timed for `status`. The service manager's
watchdog is fed only while passes succeed. `lifecycle` starts and stops it.
"""

from __future__ import annotations

import asyncio
import dataclasses
import logging
import secrets
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path

from ..board_values import UNCALIBRATED, BoardCalibration
from ..config.person import find
from ..config.sections import Config
from ..core.pipeline import OVERRUN_NS, PassTimes
from ..core.plate.mode_shapes import ModeShapes, ParasiticModes
from ..files.recording.header import Header, utc_now
from ..io.clients.server import ClientServer
from ..io.clients.sockets import Remote
from ..io.devices.serial_link import SerialLink
from ..io.devices.trackpad_source import BATCH, TrackpadSource
from ..io.host import cpu_latency as awake
from ..io.host.realtime import Pauses, PeriodicTimer, collect_when_idle, go_real_time
from ..io.host.runaway import RealtimeThrottle, on_processor_limit
from ..io.host.systemd import Notifier
from ..io.time_budget import TimeBudget
from ..values import RawReport
from ..wire import client as client_wire
from ..wire.trackpad import Pad
from .board_gateway import RUNNING
from .machine import REPORTS_ENDED_NS, TIMER_NS, Machine
from .recorder import Recorders, header_of
from .self_test import SelfTest

log = logging.getLogger("hapticd")

QUIET_WITHIN_S = 0.1  # for the last frame to leave
AT_REST_AFTER_S = 0.01  # the plate, once the board has that frame
KEEP_EVERY_NS = 100_000_000  # what needs no better time than that, such as to find a socket's lost wake-up
COLLECT_EVERY_NS = 1_000_000_000
LOG_LOST_EVERY_NS = 60_000_000_000
REPORTS_SHARE, REPORTS_BURST_NS = 0.75, 20_000_000  # of the loop's time: passes of reports
STALL_NS = 1_000_000_000  # between two events of the loop, whose timer's longest period is less than half of this


now_ns = time.monotonic_ns  # the host's clock: the axis of all `t_..._ns`


class Daemon:
    """Everything that `hapticd run` opens, from `start` to `stop`."""

    machine: Machine  # from `start` on

    def __init__(
        self,
        config: Config,
        runtime_dir: Path,
        *,
        board_port: str,
        trackpad: TrackpadSource,
        self_test: Sequence[str],
        calibration: BoardCalibration = UNCALIBRATED,
        parasitic_modes: ParasiticModes | None = None,
        notifier: Notifier | None = None,
        remote: Remote | None = None,
    ) -> None:
        self._config = config
        self._notifier = Notifier({}) if notifier is None else notifier
        self._calibration = calibration
        self._parasitic_modes = parasitic_modes
        self.runtime_dir = runtime_dir
        self._server = ClientServer(runtime_dir, remote)
        self._link = SerialLink(board_port, config.device.baud)
        self._self_test = SelfTest(self_test, config.device, board_port) if config.device.calibration_file else None
        self._trackpad = trackpad
        self._waiting: deque[RawReport] = deque(maxlen=BATCH)  # reports that the next pass takes
        self._reports_timer: asyncio.TimerHandle | None = None
        self._reports_budget = TimeBudget(REPORTS_SHARE, REPORTS_BURST_NS)
        self._reports_left_out = 0
        self._timer: PeriodicTimer | None = None
        self._pauses: Pauses | None = None
        self._t_collected_ns = self._t_logged_ns = self._t_kept_ns = 0
        self._t_awake_ns: int | None = None
        self._logged_lost = 0
        self._pass_times = PassTimes()
        self._throttle = RealtimeThrottle()
        self._pad_link: tuple[Pad | None, str] | None = None  # what is connected, and why
        self._board_link: tuple[bool, str] | None = None
        self._recorders: Recorders | None = None
        self._awake: awake.CpuLatencyHold | None = None

    def start(self, loop: asyncio.AbstractEventLoop, modes: ModeShapes) -> None:
        """Serve clients first (this takes the lock that refuses a second daemon), then open the devices."""
        self._loop = loop
        self._modes = modes
        self.machine = self._new_machine(self._config)
        self._server.start(
            loop,
            on_message=self._message,
            on_request=self._request,
            on_listener=self._listener,
            refusal_of_parts=client_wire.REFUSAL_OF_PARTS,
        )
        self._recorders = Recorders(self.machine, self._config.record, self.runtime_dir, _header)
        self._recorders.start(loop)
        self._open_board()
        self._trackpad.start(loop, on_reports=self._reports, on_link=self._on_pad_link)
        self._timer = PeriodicTimer(loop, TIMER_NS, self._on_timer, clock_ns=now_ns)

    def _open_board(self) -> None:
        self._link.start(
            self._loop,
            on_bytes=lambda data: self.machine.board_bytes(data, now_ns()),
            on_link=self._on_board_link,
        )

    def _new_machine(self, config: Config) -> Machine:
        machine = Machine(
            config,
            self._modes,
            write_board=self._write,
            set_baud=self._link.set_baud,
            instance=secrets.randbits(31),
            calibration=self._calibration,
            parasitic_modes=self._parasitic_modes,
        )
        machine.find_person = lambda name: find(name, self._config.plate)  # a file of 1 KB, read within the loop
        machine.status.inputs = self._inputs
        machine.status.lost_messages = lambda: self._server.counters
        return machine

    def _inputs(self) -> dict[str, object]:
        trackpad = {**self._trackpad.counters, "reports_left_out": self._reports_left_out}
        return {"trackpad": trackpad, "board": {"left_out": self._link.left_out}}

    def _restart_core(self, t_now_ns: int) -> None:
        """Replace the idle machine, so that a recorder receives a core from its first instant. Devices and sockets stay
        open; the board's handshake starts again, and clients see another instance."""
        assert self._recorders is not None
        log.info("Recorder attached: restarting the core while idle")
        before = self.machine
        machine = self._new_machine(before.config)
        machine.status.real_time, machine.status.person = before.status.real_time, before.status.person
        self.machine = machine
        self._logged_lost = 0
        self._recorders.begin(machine, t_now_ns)
        machine.budget(self._pass_times.budget_frac, t_now_ns)
        if self._self_test is not None and self._self_test.result is not None:
            machine.self_test(*self._self_test.result, t_now_ns)
        if self._pad_link is not None:
            self._on_pad_link(*self._pad_link)
        if self._board_link is not None:
            self._on_board_link(*self._board_link)
        self._set_pace()

    def _on_pad_link(self, pad: Pad | None, reason: str) -> None:
        self._pad_link = pad, reason
        self._waiting.clear()
        self.machine.trackpad_link(pad is not None, reason, now_ns(), pad=pad)

    def _on_board_link(self, is_up: bool, reason: str) -> None:
        test = self._self_test
        if test is not None and not is_up and test.result is not None and test.result[0] != RUNNING:
            test.forget()
        if test is not None and is_up and test.result is None:
            self._link.close()  # until the test has ended: it needs the port for itself
            test.start(self._loop, self._on_self_test, self._touches)
            is_up, reason = False, f"{self._link.port} is left to the self-test"
        self._board_link = is_up, reason
        self.machine.board_link(is_up, reason, now_ns())

    def _touches(self) -> tuple[int, int]:
        return self.machine.pipeline.newest_finger_id, len(self.machine.pipeline.fingers)

    def _on_self_test(self, outcome: str, text: str) -> None:
        self.machine.self_test(outcome, text, now_ns())
        if outcome != RUNNING:
            self._open_board()

    def go_real_time(self) -> None:
        """Request the configured real-time settings from the kernel, and log what it refuses."""
        requested = self._config.realtime
        granted = go_real_time(fifo_priority=requested.fifo_priority, processor=requested.processor)
        if granted.priority > 0:
            on_processor_limit(log.error)
        refused = list(granted.refused)
        if requested.fifo_priority > 0:
            try:
                self._awake = awake.CpuLatencyHold(awake.LATENCY_FILE)
            except OSError as error:
                refused.append(f"{awake.LATENCY_FILE}: {error.strerror}")
        for refusal in refused:
            log.warning("real time: not granted: %s", refusal)
        extra = {"stays_awake": self._awake is not None, "refused": tuple(refused)}
        self.machine.status.real_time = dataclasses.asdict(granted) | extra

    def ready(self) -> None:
        """End the start: count ticks and pauses from now, and notify the service manager."""
        assert self._timer is not None
        self._pauses = Pauses(lambda span_ns: self.machine.status.loop.paused(span_ns), clock_ns=now_ns)
        self._timer.set_period(TIMER_NS)
        self._t_logged_ns = now_ns()
        self._notifier.notify(ready=1, status=f"serving clients in {self.runtime_dir}")

    async def stop(self) -> None:
        """Silence the plate, then close clients and trackpad, and the board last."""
        for one in (self._timer, self._pauses, self._awake):
            if one is not None:
                one.close()
        if self._self_test is not None:
            await self._self_test.close()
        if self._reports_timer is not None:
            self._reports_timer.cancel()
        has_machine = hasattr(self, "machine")  # else `start` failed
        if has_machine:
            self.machine.stop(now_ns())
            self._log_lost()
        await self._trackpad.close()
        await self._link.drained(QUIET_WITHIN_S)
        if has_machine and self.machine.session.hello is not None:
            await asyncio.sleep(AT_REST_AFTER_S)
            self.machine.disconnect(now_ns())
            await self._link.drained(QUIET_WITHIN_S)
        self._link.close()
        if self._recorders is not None:
            self._recorders.close(now_ns())
        self._server.close()

    def _reports(self, batch: Sequence[RawReport]) -> None:
        """Take reports at once, or with the next ones where passes would have no time for anything else."""
        self._reports_left_out += max(len(self._waiting) + len(batch) - BATCH, 0)
        self._waiting.extend(batch)
        if self._reports_timer is None and self._reports_budget.has_time:
            self._take_reports()
        elif self._reports_timer is None:
            self._reports_timer = self._loop.call_later(self._reports_budget.wait_s, self._take_reports)

    def _take_reports(self) -> None:
        self._reports_timer = None
        batch = tuple(self._waiting)
        self._waiting.clear()
        if batch:
            with self._reports_budget:
                self._pass_reports(batch)

    def _pass_reports(self, batch: Sequence[RawReport]) -> None:
        self._notice_stall(now_ns())
        self._link.read()
        machine, t_begin_ns = self.machine, now_ns()
        begin_ran_ns = time.thread_time_ns()
        t_written_ns = machine.reports(batch, t_begin_ns)
        self._judge_pass(begin_ran_ns)
        tick, loop, t_read_ns = machine.last_tick, machine.status.loop, batch[-1].t_host_ns
        age_ns = tick.age_ns if tick is not None and machine.pipeline.fingers else None
        if t_written_ns is not None:
            loop.wrote(t_read_ns, t_written_ns)
        loop.passed(t_read_ns, t_begin_ns, now_ns(), len(batch), age_ns)
        self._set_pace(after_reports=True)
        if machine.trackpad.needs_enable:
            self._trackpad.request_enable()
        self._housekeep(t_begin_ns)

    def _write(self, line: bytes) -> int | None:
        return now_ns() if self._link.write(line) else None

    def _message(self, payload: bytes, user: str, waited_ns: int) -> None:
        self.machine.targets(payload, now_ns(), user, waited_ns)
        self._set_pace()

    def _request(self, payload: bytes, user: str, waited_ns: int) -> bytes:
        answer = self.machine.request(payload, now_ns(), user, waited_ns)
        self._set_pace()
        return answer

    def _listener(self) -> None:
        """Serve a new subscriber without waiting for a tick."""
        self._update_subscription()
        self.machine.timer(now_ns())
        self._set_pace()

    def _on_timer(self, late_ns: int, missed: int) -> None:
        self._notice_stall(now_ns())
        self._link.read()
        machine, t_now_ns = self.machine, now_ns()
        machine.status.loop.ticked(late_ns, missed)
        begin_ran_ns = time.thread_time_ns()
        machine.timer(t_now_ns)
        self._judge_pass(begin_ran_ns)
        self._set_pace()
        self._housekeep(t_now_ns)

    def _judge_pass(self, begin_ran_ns: int) -> None:
        """Measure the processor time of a pass: long ones lower what passes do, and after one that overran, sleep."""
        machine, ran_ns = self.machine, time.thread_time_ns() - begin_ran_ns
        if self._pass_times.measured(ran_ns):
            machine.budget(self._pass_times.budget_frac, now_ns())
        is_overrun, loop = ran_ns >= OVERRUN_NS, machine.status.loop
        loop.overruns += is_overrun
        self._throttle.look(is_overrun=is_overrun)
        loop.throttled = self._throttle.throttled

    def _notice_stall(self, t_now_ns: int) -> None:
        """After a stall of this process read what the board has sent meanwhile, before its silence is judged."""
        before_ns, self._t_awake_ns = self._t_awake_ns, t_now_ns
        if before_ns is not None and t_now_ns - before_ns > STALL_NS:
            stalled_s = (t_now_ns - before_ns) * 1e-9
            log.warning(
                "this process did not run for %.1f s: it was stopped, or the host was busy or asleep", stalled_s
            )
            self._link.read()

    def _housekeep(self, t_now_ns: int) -> None:
        """Do what is due besides the touch, after timer ticks or reports."""
        assert self._recorders is not None
        if self._awake is not None:
            self._awake.look(not self.machine.is_idle, t_now_ns)
        if t_now_ns - self._t_kept_ns < KEEP_EVERY_NS:
            return
        self._t_kept_ns = t_now_ns
        if not self.machine.is_failing:
            self._notifier.feed_watchdog(t_now_ns)
        self._server.sweep()
        self._recorders.sweep()
        if self._recorders.is_due(t_now_ns) and self.machine.is_unused:
            self._restart_core(t_now_ns)
        self._update_subscription()  # where the last subscriber has gone
        if self.machine.is_idle and t_now_ns - self._t_collected_ns >= COLLECT_EVERY_NS:
            self._t_collected_ns = t_now_ns
            collect_when_idle()
        if t_now_ns - self._t_logged_ns >= LOG_LOST_EVERY_NS:
            self._t_logged_ns = t_now_ns
            self._log_lost()

    def _set_pace(self, *, after_reports: bool = False) -> None:
        """Set the timer to what the machine needs: while reports arrive they replace the ticks. A board on standby is
        read as rarely."""
        self._link.wait(self.machine.session.can_wait)
        if self._timer is None:
            return
        period_ns = self.machine.timer_period_ns
        if after_reports:
            self._timer.set_period(period_ns, max(period_ns, REPORTS_ENDED_NS))
        elif self._timer.period_ns != period_ns:
            self._timer.set_period(period_ns)

    def _log_lost(self) -> None:
        lost = self.machine.status.lost()
        if (count := sum(lost.values())) > self._logged_lost:
            self._logged_lost = count
            what = ", ".join(f"{count} {name}" for name, count in lost.items())
            log.warning("this computer is too busy for the touch: %s since the start (`hapticd status`)", what)

    def _update_subscription(self) -> None:
        """Pass on telemetry only while there is a subscriber."""
        self.machine.watch(self._server.publish if self._server.has_subscribers else None, now_ns())


def _header(machine: Machine, is_whole: bool) -> Header:
    return header_of(machine, t_ns=now_ns(), utc=utc_now(), is_whole=is_whole)
