"""The service's reports of itself: the telemetry message of each pass, and the answers to `status` and `plate`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt
from msgspec.structs import asdict

from hapticd_contract.effects import cause_of
from hapticd_contract.replies import Plate
from hapticd_contract.states import FingerState, Perceived, PlateEvent, PlateState

from .. import board_protocol as protocol
from ..config.sections import Config
from ..core.board.ledger import Histogram
from ..core.board.supervisor import Supervisor
from ..core.pipeline import Pipeline
from ..core.plate.mode_shapes import ModeShapes
from ..core.targets.scene import Scene
from ..values import LedgerLine, Tick, TouchPoint
from ..wire.client import encode_state
from ..wire.trackpad import Decoder
from .board_gateway import BoardGateway
from .client_gateway import ClientGateway
from .loop_timing import LoopTiming

RECENT_NS = 10_000_000_000  # frames older than this do not describe the present
CHANGES_SHOWN = 5
LOOP_PARTS = ("read_age", "wait", "compute", "wire", "tick_late", "pause")
LINK_PARTS = ("age", "link", "horizon", "late")
OF_STATUS = ("fault_code", "saturated", "limited", "deadman_trips", "bad_frames", "late_frames")  # of the board
OF_LOOP = ("joined_reports", "missed_ticks", "pauses", "overruns", "throttled")
MAP_POINTS = 64  # per axis: a dozen for each wave of the reference plate


class Status:
    """Reports on the machine's parts, and the counters that the event loop and the sockets add to it.

    `instance` distinguishes one start of the service from the next. `publish` takes telemetry while there is
    a subscriber.
    """

    def __init__(
        self,
        config: Config,
        modes: ModeShapes,
        *,
        instance: int,
        scene: Scene,
        pipeline: Pipeline,
        supervisor: Supervisor,
        board: BoardGateway,
        clients: ClientGateway,
    ) -> None:
        self.publish: Callable[[bytes], None] | None = None
        self.published = self.failed_passes = 0
        self.person = ""  # the participant who touches the plate, if a client named one
        self.loop = LoopTiming()
        self.real_time: Mapping[str, object] = {}
        self.lost_messages: Callable[[], Mapping[str, int]] = dict  # dropped by the sockets, by cause
        self.inputs: Callable[[], Mapping[str, object]] = dict  # what of each source's was not taken, by cause
        self.recording: Callable[[], Mapping[str, object]] = dict
        self._config = config
        self.modes = modes
        self._instance = instance
        self._scene = scene
        self._pipeline = pipeline
        self._supervisor = supervisor
        self._board = board
        self._clients = clients

    # --- telemetry ---

    def telemetry(self, tick: Tick, perceived: Mapping[int | str, Perceived], events: Sequence[PlateEvent]) -> bytes:
        """Return the message of one pass: every finger seen or virtual with its target and what it gets, and events."""
        self.published += 1
        points = {point.key: point for point in tick.points}
        owner_of, board, loop = self._scene.owner_of, self._board.session.status, self.loop
        modal_um = self._pipeline.modal_um
        measured_um = () if board is None else board.measured_um
        fingers = [
            _finger_state(key, finger.x_mm, finger.y_mm, points.pop(key, None), owner_of(key), perceived.get(key))
            for finger in self._pipeline.fingers
            for key in (finger.finger_id,)
        ]
        fingers += [
            _finger_state(key, point.x_mm, point.y_mm, point, owner_of(key), perceived.get(key))
            for key, point in points.items()
        ]
        return encode_state(
            PlateState(
                instance=self._instance,
                seq=self.published,
                t_ns=tick.t_now_ns,
                state=self._supervisor.state.name,
                fingers=tuple(fingers),
                modal_um=tuple([w_um.real for w_um in modal_um]),
                modal_q_um=tuple([w_um.imag for w_um in modal_um]),
                limited=tick.limited,
                misses_target=any(one.misses_target for one in perceived.values()) if perceived else None,
                age_ms=tick.age_ns * 1e-6,
                horizon_ms=tick.horizon_ns * 1e-6,
                markers=tuple(self._clients.markers),
                measured_d_q_um=tuple([(w_um.real, w_um.imag) for w_um in measured_um]),
                tick_late_ms=loop.last_late_ns * 1e-6,
                missed_ticks=loop.missed_ticks,
                pauses=loop.pauses,
                surfaces_version=self._scene.surfaces.version,
                events=tuple(events),
            )
        )

    def lost(self) -> dict[str, int]:
        """Losses of the touch to a computer that is too busy, since the start. Missed ticks alone cost nothing."""
        ledger, touch = self._board.session.ledger, self._pipeline.counters
        counts = {
            "frames late": ledger.late_frames,
            "frames unanswered": self._board.session.window.unanswered,
            "passes put off": self.loop.throttled,
            "fingers left out of a pass": touch.left_out_fingers,
        }
        return {name: count for name, count in counts.items() if count}

    # --- answers ---

    def plate(self) -> Plate:
        """Data for a picture of the plate: its size, limits and drive, and points of its mode map.

        The map's own points, as many as a wave needs: the daemon evaluates no others for a client.
        """
        config, modes, hello, curve = self._config, self.modes, self._board.session.hello, self._scene.friction_curve
        columns, rows = _spread(modes.x_mm.size), _spread(modes.y_mm.size)
        return Plate(
            size_mm=config.plate.size_mm,
            w_limit_um=config.limits.w_limit_um,
            reference_limit_um=config.reference_limit_um,
            contact_radius_mm=self._pipeline.contact_radius_mm,
            friction_curve=tuple([(um, curve.friction(um)) for _, um in reversed(curve.knots)]),
            friction_speed_mm_s=curve.speed_mm_s if math.isfinite(curve.speed_mm_s) else None,
            drive_hz=None if hello is None else self._board.session.drive_hz,
            x_mm=tuple(modes.x_mm[columns].tolist()),
            y_mm=tuple(modes.y_mm[rows].tolist()),
            modes=modes.M,
            shapes=modes.shapes[:, rows][..., columns].astype("<f4").tobytes(),
            simulated=config.rig_dir or None,
        )

    def collect(self, trackpad: Decoder, t_reports_ns: int | None, t_now_ns: int) -> dict[str, object]:
        """Rates, ages, counters and limits hit, as plain nested maps. `t_reports_ns`: when the last reports came."""
        clients = self._clients
        ledger = self._board.session.ledger
        return {
            "state": self._supervisor.state.name,
            "state_changes": _changes(self._supervisor, t_now_ns),
            "t_ns": t_now_ns,
            "fingers": len(self._pipeline.fingers),
            "virtual_fingers": len(self._scene.virtual_names(t_now_ns)),
            "surfaces": self._surfaces(t_now_ns),
            "assets": self._scene.assets.report(),
            "effects": self._effects(t_now_ns),
            "person": self.person,
            "events": {"count": self._pipeline.events.count, "lost": self._pipeline.events.lost},
            "simulated": self._config.rig_dir or None,
            "touch": {**dataclasses.asdict(self._pipeline.counters), "failed_passes": self.failed_passes},
            "telemetry": {"published": self.published},
            "trackpad": {
                "model": trackpad.pad.model,
                "silent_ms": _ago_ms(t_reports_ns, t_now_ns),
                "reports": dict(trackpad.counters),
            },
            "clients": {
                "refused": clients.refused,
                "last_refusal": clients.last_refusal,
                "overtaken": clients.overtaken,
                **self.lost_messages(),
            },
            "inputs": dict(self.inputs()),
            "board": _board(self._board, self._pipeline.max_knots),
            "recording": dict(self.recording()),
            "real_time": dict(self.real_time),
            "timing": self._timing(),
            "latency_ms": _latency([line for line in ledger.lines if t_now_ns - line.t_sent_ns <= RECENT_NS]),
        }

    def _surfaces(self, t_now_ns: int) -> list[dict[str, object]]:
        """All surfaces, topmost first."""
        return [
            {"client": layer.owner, "name": layer.name, "z": layer.z, "blend": layer.surface.blend}
            for layer in self._scene.surfaces.layers
            if t_now_ns < layer.t_expires_ns
        ]

    def _effects(self, t_now_ns: int) -> dict[str, object]:
        """All effects in force, how many of them play, and how many starts there were and could not be."""
        effects = self._scene.effects
        in_force = [
            {"client": held.owner, "name": held.name, "cause": cause_of(held.effect.start)}
            for held in effects.held
            if t_now_ns < held.t_expires_ns
        ]
        return {
            "in_force": in_force,
            "playing": len(effects.playing),
            "begun": effects.begun,
            "skipped": effects.skipped,
        }

    def _timing(self) -> dict[str, object]:
        """Every report and every frame since the start: histograms of the parts of the path, and what was late."""
        ledger, loop = self._board.session.ledger, self.loop
        histograms: dict[str, Histogram] = {name: getattr(loop, name) for name in LOOP_PARTS}
        histograms |= {name: getattr(ledger, name) for name in LINK_PARTS}
        return {
            **{name: getattr(loop, name) for name in OF_LOOP},
            "budget_frac": self._pipeline.budget_frac,
            "late_frames": ledger.late_frames,
            "unanswered_frames": self._board.session.window.unanswered,
            "histograms": {
                name: histogram_fields(histogram) for name, histogram in histograms.items() if histogram.count
            },
        }


def _finger_state(
    key: int | str,
    x_mm: float,
    y_mm: float,
    point: TouchPoint | None,
    owner: str | None,
    perceived: Perceived | None,
) -> FingerState:
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
        **({} if perceived is None else asdict(perceived)),
    )


def _spread(points: int) -> npt.NDArray[np.intp]:
    """Indices of at most MAP_POINTS evenly spread points of an axis, the first and the last among them."""
    return np.linspace(0, points - 1, min(points, MAP_POINTS)).round().astype(np.intp)


def _changes(supervisor: Supervisor, t_now_ns: int) -> list[dict[str, object]]:
    """The last changes of state, newest first."""
    newest = list(supervisor.history)[: -CHANGES_SHOWN - 1 : -1]
    return [
        {"to": change.after.name, "ago_ms": _ago_ms(change.t_ns, t_now_ns), "why": change.reason or change.event.value}
        for change in newest
    ]


def _ago_ms(t_ns: int | None, t_now_ns: int) -> float | None:
    return None if t_ns is None else (t_now_ns - t_ns) * 1e-6


def _board(board: BoardGateway, max_knots: int) -> dict[str, object]:
    session = board.session
    hello, last = session.hello, session.status
    fields: dict[str, object] = {
        "ready": session.ready,
        "reboots": session.reboots,
        "unsent": board.unsent,
        "held_back": session.held_back,
        "lost_statuses": session.lost_statuses,
        "dropped": dict(board.dropped),
    }
    if board.refused:
        fields |= {"refused": board.refused}
    if board.lacking:
        fields |= {"lacking": board.lacking}
    if board.self_test is not None:
        fields |= {"self_test": dict(zip(("outcome", "text"), board.self_test, strict=True))}
    if hello is not None:
        fields |= {
            "firmware": hello.firmware_version,
            "image_crc": f"{hello.image_crc:08x}" if hello.image_crc else "",
            "has_sync": hello.has_sync,
            "w_limit_um": list(hello.w_limit_um),
            "baud": board.baud,
            "max_knots": max_knots,
        }
    if hello is not None and last is not None and last.drive_hz > 0.0:
        fields |= {"drive_hz": last.drive_hz, "drive_moved_hz": last.drive_hz - session.drive_hz}
    if last is not None:
        fields |= {
            "state": last.state.name,
            **{name: getattr(last, name) for name in OF_STATUS},
            "measured_um": [[w_um.real, w_um.imag] for w_um in last.measured_um],
        }
    if last is not None and last.refusal:
        why = protocol.REFUSALS.get(last.refusal, f"its reason is {last.refusal}")
        fields |= {"refused_reference": f"reference {last.refused_seq}: {why}"}
    if session.clock.ready:
        fields |= {"round_trip_ms": session.clock.rtt_ns * 1e-6, "clock_rate_ppm": session.clock.rate_ppm}
    return fields


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
        **{part: _percentiles([getattr(line, f"{part}_ns") for line in ledger]) for part in LINK_PARTS},
    }


def _percentiles(spans_ns: list[int]) -> dict[str, float]:
    ordered = sorted(spans_ns)
    last = len(ordered) - 1
    return {f"p{percent}": ordered[round(last * percent / 100)] * 1e-6 for percent in (50, 95, 99)}
