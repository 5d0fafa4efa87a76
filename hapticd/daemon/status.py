"""What the daemon tells of itself: the telemetry message of each pass, and the answers to `status` and `plate`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..config.sections import SIMULATED
from ..values import Tick, TouchPoint
from ..wire.client import FingerState, PlateState, encode_state

if TYPE_CHECKING:
    from ..core.board.ledger import Histogram, LedgerLine
    from ..core.board.supervisor import Supervisor
    from .machine import Machine

RECENT_NS = 10_000_000_000  # frames older than this say nothing of now
CHANGES_SHOWN = 5
MAP_POINTS = 64  # per axis: a dozen for each wave of the reference plate


def telemetry(machine: Machine, tick: Tick) -> bytes:
    """The telemetry message of one pass: every finger seen or virtual, with what it should get and gets."""
    points = {point.key: point for point in tick.points}
    owner_of, board = machine.scene.owner_of, machine.session.status
    fingers = [
        _finger_state(key, finger.x_mm, finger.y_mm, points.pop(key, None), owner_of(key))
        for finger in machine.pipeline.fingers
        for key in (finger.finger_id,)
    ]
    fingers += [_finger_state(key, point.x_mm, point.y_mm, point, owner_of(key)) for key, point in points.items()]
    return encode_state(
        PlateState(
            instance=machine.instance,
            seq=machine.published,
            t_ns=tick.t_now_ns,
            state=machine.supervisor.state.name,
            fingers=tuple(fingers),
            modal_um=machine.pipeline.modal_um,
            limited=tick.limited,
            condition=None,
            age_ms=tick.age_ns * 1e-6,
            horizon_ms=tick.horizon_ns * 1e-6,
            markers=tuple(machine.clients.markers),
            measured_um=() if board is None else board.measured_um,
            tick_late_ms=machine.loop.last_late_ns * 1e-6,
            missed_ticks=machine.loop.missed_ticks,
            pauses=machine.loop.pauses,
        )
    )


def _finger_state(key: int | str, x_mm: float, y_mm: float, point: TouchPoint | None, owner: str | None) -> FingerState:
    return FingerState(
        id=key,
        x_mm=x_mm,
        y_mm=y_mm,
        predicted_x_mm=None if point is None else point.x_mm,
        predicted_y_mm=None if point is None else point.y_mm,
        target_um=None if point is None else point.target_um,
        achieved_um=None if point is None else point.achieved_um,
        virtual=isinstance(key, str),
        owner=owner,
    )


def plate(machine: Machine) -> dict[str, object]:
    """What a picture of the plate needs: its size, limits and drive, and points of its modes' maps.

    `shapes` are float32, little-endian, by mode and then by rows along `y_mm`: (M, ny, nx). They are the map's own
    points, as many as a wave needs: to evaluate others is not the daemon's work.
    """
    modes, hello = machine.modes, machine.session.hello
    columns, rows = _spread(modes.x_mm.size), _spread(modes.y_mm.size)
    return {
        "size_mm": list(machine.config.plate.size_mm),
        "w_limit_um": list(machine.config.limits.w_limit_um),
        "reference_limit_um": list(machine.config.limits.reference_limit_um),
        "drive_hz": None if hello is None else hello.drive_hz,
        "x_mm": modes.x_mm[columns].tolist(),
        "y_mm": modes.y_mm[rows].tolist(),
        "modes": modes.M,
        "shapes": modes.shapes[:, rows][..., columns].astype("<f4").tobytes(),
        "simulated": _rig_directory(machine),
    }


def _spread(points: int) -> npt.NDArray[np.intp]:
    """Which of an axis' points are told: evenly spread ones, with the first and the last."""
    return np.linspace(0, points - 1, min(points, MAP_POINTS)).round().astype(np.intp)


def _rig_directory(machine: Machine) -> str | None:
    """Where the simulated rig is, if the trackpad is its."""
    config = machine.config
    return config.sim.rig_dir or None if config.trackpad.source == SIMULATED else None


def collect(machine: Machine, t_now_ns: int) -> dict[str, object]:
    """Rates, ages, counters and limits hit, as plain nested maps."""
    session, supervisor = machine.session, machine.supervisor
    return {
        "state": supervisor.state.name,
        "state_changes": _changes(supervisor, t_now_ns),
        "t_ns": t_now_ns,
        "fingers": len(machine.pipeline.fingers),
        "virtual_fingers": len(machine.scene.virtual_names(t_now_ns)),
        "simulated": _rig_directory(machine),
        "touch": dataclasses.asdict(machine.pipeline.counters),
        "telemetry": {"published": machine.published, "skipped_no_subscriber": machine.skipped_no_subscriber},
        "trackpad": {
            "model": machine.trackpad.model,
            "silent_ms": _ago_ms(machine.t_reports_ns, t_now_ns),
            "reports": dict(machine.trackpad.counters),
        },
        "clients": {
            "refused": machine.clients.refused,
            "last_refusal": machine.clients.last_refusal,
            "overtaken": machine.clients.overtaken,
            **machine.lost_messages(),
        },
        "board": _board(machine),
        "recording": dict(machine.recording()),
        "real_time": dict(machine.real_time),
        "timing": _timing(machine),
        "latency_ms": _latency([line for line in session.ledger if t_now_ns - line.t_sent_ns <= RECENT_NS]),
    }


def _changes(supervisor: Supervisor, t_now_ns: int) -> list[dict[str, object]]:
    """How the state came to be, newest first."""
    newest = list(supervisor.history)[: -CHANGES_SHOWN - 1 : -1]
    return [
        {"to": change.after.name, "ago_ms": _ago_ms(change.t_ns, t_now_ns), "why": change.reason or change.event.value}
        for change in newest
    ]


def _ago_ms(t_ns: int | None, t_now_ns: int) -> float | None:
    return None if t_ns is None else (t_now_ns - t_ns) * 1e-6


def _board(machine: Machine) -> dict[str, object]:
    session = machine.session
    hello, last = session.hello, session.status
    said: dict[str, object] = {
        "ready": session.ready,
        "reboots": session.reboots,
        "unsent": machine.board.unsent,
        "held_back": session.held_back,
        "dropped": dict(machine.board.dropped),
    }
    if machine.board.refused:
        said |= {"refused": machine.board.refused}
    if hello is not None:
        said |= {"firmware": hello.firmware_version, "w_limit_um": list(hello.w_limit_um)}
    if last is not None:
        said |= {
            "state": last.state.name,
            "fault_code": last.fault_code,
            "saturated": last.saturated,
            "limited": last.limited,
            "deadman_trips": last.deadman_trips,
            "bad_frames": last.bad_frames,
            "late_frames": last.late_frames,
            "measured_um": [[w_um.real, w_um.imag] for w_um in last.measured_um],
        }
    if session.clock.ready:
        said |= {"round_trip_ms": session.clock.rtt_ns * 1e-6, "clock_rate_ppm": session.clock.rate_ppm}
    return said


def _timing(machine: Machine) -> dict[str, object]:
    """Every report and every frame since the start: histograms of the parts of the way, and what was late or missed."""
    ledger, loop = machine.session.ledger, machine.loop
    histograms: Mapping[str, Histogram] = {
        "read_age": loop.read_age,
        "wait": loop.wait,
        "compute": loop.compute,
        "wire": loop.wire,
        "tick_late": loop.tick_late,
        "pause": loop.pause,
        "age": ledger.age,
        "link": ledger.link,
        "horizon": ledger.horizon,
        "late": ledger.late,
    }
    return {
        "joined_reports": loop.joined_reports,
        "missed_ticks": loop.missed_ticks,
        "pauses": loop.pauses,
        "late_frames": ledger.late_frames,
        "unanswered_frames": ledger.unanswered,
        "histograms": {name: histogram_fields(histogram) for name, histogram in histograms.items() if histogram.count},
    }


def histogram_fields(histogram: Histogram) -> dict[str, object]:
    """`buckets` are pairs of an upper edge in ms and the count below it (and from the bucket before)."""
    return {
        "count": histogram.count,
        **{f"p{percent}_ms": histogram.percentile_ns(percent) * 1e-6 for percent in (50, 95, 99)},
        "max_ms": histogram.longest_ns * 1e-6,
        "buckets": [[below_ns * 1e-6, count] for _, below_ns, count in histogram.buckets()],
    }


def _latency(ledger: Sequence[LedgerLine]) -> dict[str, object]:
    """Percentiles over the newest frames: sample age, link, horizon, and how late frames took effect."""
    if not ledger:
        return {}
    seconds = (ledger[-1].t_sent_ns - ledger[0].t_sent_ns) * 1e-9
    return {
        "frames": len(ledger),
        "frames_hz": (len(ledger) - 1) / seconds if seconds > 0 else 0.0,
        "age": _percentiles([line.age_ns for line in ledger]),
        "link": _percentiles([line.link_ns for line in ledger]),
        "horizon": _percentiles([line.horizon_ns for line in ledger]),
        "late": _percentiles([line.late_ns for line in ledger]),
    }


def _percentiles(spans_ns: list[int]) -> dict[str, float]:
    ordered = sorted(spans_ns)
    last = len(ordered) - 1
    return {f"p{percent}": ordered[round(last * percent / 100)] * 1e-6 for percent in (50, 95, 99)}
