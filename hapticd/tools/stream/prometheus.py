"""`hapticd stream prometheus`: metrics over HTTP, in base units; counters end in _total.

Each scrape, and nothing else, requests the daemon's status. Values missing from it (of an older daemon, or before the
board answered) are left out.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from typing import Any, NamedTuple

import zmq
from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
    StateSetMetricFamily,
)
from prometheus_client.registry import Collector

import hapticd_client
from hapticd_client.control import Control
from hapticd_client.endpoint import find

from ...errors import UsageError

_Fields = Mapping[str, Any]

ANSWER_S = 1.0  # of Prometheus' default scrape timeout of ten seconds
EDGES_LOG2_NS = range(13, 31)  # 8 us .. 1.07 s: the daemon's buckets are sixteenths of these octaves
SUB_BITS = 4
STATES = ("IDLE", "ARMED", "ACTIVE", "FAULT", "STOPPED")


class Export(NamedTuple):
    """One number of `status`: its path, its name as a metric, its help text, and its scale to base units."""

    path: str
    name: str
    text: str
    scale: float = 1.0


GAUGES = (
    Export("fingers", "fingers", "Fingers on the plate"),
    Export("virtual_fingers", "virtual_fingers", "Virtual fingers of clients"),
    Export("assets.count", "assets", "Uploaded assets of clients"),
    Export("assets.uploads", "asset_uploads", "Assets of which parts are still to come"),
    Export("assets.bytes", "asset_bytes", "Of all assets, and of those to come"),
    Export("effects.playing", "effects_playing", "Effects that play"),
    Export("trackpad.silent_ms", "trackpad_silent_seconds", "Since the trackpad's last report", 1e-3),
    Export("board.ready", "board_ready", "1 while the board answers and its clock is known"),
    Export("board.fault_code", "board_fault_code", "The board's fault, 0 for none"),
    Export("board.saturated", "board_saturated", "1 while the board's voltage is at its limit"),
    Export("board.limited", "board_limited", "1 while an amplitude is at the board's limit"),
    Export("board.has_sync", "board_has_sync", "1 where the board has a sync output"),
    Export("board.baud", "board_line_speed_baud", "Speed of the board's line"),
    Export("board.max_knots", "reference_frame_knots_max", "Knots of a reference frame that the board's line carries"),
    Export("board.drive_hz", "board_drive_hertz", "The board's drive"),
    Export("board.drive_moved_hz", "board_drive_moved_hertz", "How far the drive has followed the plate"),
    Export("board.round_trip_ms", "board_round_trip_seconds", "To the board and back", 1e-3),
    Export("board.clock_rate_ppm", "board_clock_deviation_ratio", "How much faster the board's clock runs", 1e-6),
    Export("latency_ms.frames_hz", "reference_frame_rate_hertz", "Frames applied by the board, of the last 10 s"),
    Export("timing.budget_frac", "pass_budget_ratio", "Share of their time budget that passes may use on this machine"),
    Export("real_time.priority", "real_time_priority", "SCHED_FIFO priority, 0 for ordinary scheduling"),
    Export("real_time.memory_locked", "real_time_memory_locked", "1 where the daemon's memory is not paged out"),
)
COUNTERS = (
    Export("effects.begun", "effects_begun", "Effects that began to play"),
    Export("effects.skipped", "effects_skipped", "Starts of effects for which there was no room"),
    Export("events.count", "events", "Events of fingers and effects"),
    Export("events.lost", "events_lost", "Events that no state had room for"),
    Export("telemetry.published", "states_published", "States sent to subscribers"),
    Export("telemetry.skipped_no_subscriber", "states_skipped", "States not built, for want of subscribers"),
    Export("clients.refused", "client_messages_refused", "Messages refused with an error"),
    Export("clients.overtaken", "client_messages_overtaken", "Messages overtaken by a newer one"),
    Export("board.reboots", "board_reboots", "Detected boots of the board"),
    Export("board.unsent", "board_frames_unsent", "Frames dropped because the serial line was full"),
    Export("board.held_back", "board_frames_held_back", "Frames withheld from a board that did not answer"),
    Export("board.lost_statuses", "board_statuses_lost", "Statuses that the board sent and the line lost"),
    Export("board.deadman_trips", "board_deadman_trips", "Times that the board's dead-man timeout tripped"),
    Export("board.bad_frames", "board_bad_frames", "Frames refused by the board"),
    Export("board.late_frames", "board_late_frames", "Frames that arrived at the board too late"),
    Export("timing.joined_reports", "reports_joined", "Reports merged into a pass with a newer one"),
    Export("timing.missed_ticks", "ticks_missed", "Timer ticks skipped because the loop was busy"),
    Export("timing.pauses", "collector_pauses", "Garbage collections of more than 1 ms"),
    Export("timing.overruns", "passes_overrun", "Passes that took the processor for more than 8 ms"),
    Export("timing.throttled", "loop_throttled", "Sleeps of a loop that was too busy"),
    Export("timing.late_frames", "frames_late", "Frames applied more than 1 ms late"),
    Export("timing.unanswered_frames", "frames_unanswered", "Frames never acknowledged by the board"),
)
COUNTED = (  # maps of counters: one metric with a label
    ("touch", "touch_events", "event", "Work done or avoided by passes"),
    ("trackpad.reports", "trackpad_reports", "kind", "Reports of the trackpad: frames, refused by reason, clock steps"),
    ("board.dropped", "board_messages_dropped", "reason", "Damaged messages from the board"),
)
LOST_MESSAGES = ("too_fast", "misshapen", "denied")
SPANS = {  # histograms of `status`: name and help text of the metric
    "read_age": ("read_age", "Age of a report's sample when it was read"),
    "wait": ("report_wait", "From reading a report to its pass"),
    "wire": ("report_to_wire", "From reading a report to its frame's writing"),
    "compute": ("pass", "Duration of a pass, including its outputs"),
    "tick_late": ("tick_late", "Delay of the loop's timer"),
    "pause": ("collector_pause", "Duration of a garbage collection"),
    "age": ("sample_age", "Age of the sample when a frame's pass began"),
    "link": ("link", "From sending a frame to its effect on the plate"),
    "horizon": ("horizon", "Prediction horizon of a frame, from its sample"),
    "late": ("frame_late", "Delay of a frame's effect against its plan"),
}


def families(status: _Fields | None) -> Iterator[Metric]:
    """Yield all metrics of one reply; without one, None, only `hapticd_up` 0."""
    yield GaugeMetricFamily("hapticd_up", "1 if the daemon answered", value=float(status is not None))
    if status is None:
        return
    yield StateSetMetricFamily("hapticd_state", "Of the daemon", {one: status.get("state") == one for one in STATES})
    yield from _devices(status)
    for figure in GAUGES:
        if (value := _number(_at(status, figure.path))) is not None:
            yield GaugeMetricFamily(f"hapticd_{figure.name}", figure.text, value=value * figure.scale)
    for figure in COUNTERS:
        if (value := _number(_at(status, figure.path))) is not None:
            yield CounterMetricFamily(f"hapticd_{figure.name}", figure.text, value=value)
    for path, name, label, text in COUNTED:
        yield from _counted(f"hapticd_{name}", text, label, _map(_at(status, path)))
    clients = _map(status.get("clients"))
    lost = {why: clients[why] for why in LOST_MESSAGES if why in clients}
    yield from _counted("hapticd_client_messages_lost", "Messages dropped", "reason", lost)
    yield from _amplitudes(_map(status.get("board")))
    histograms = _map(_at(status, "timing.histograms"))
    for key, (name, text) in SPANS.items():
        if isinstance(histograms.get(key), dict):
            yield histogram(f"hapticd_{name}_seconds", text, histograms[key])


def histogram(name: str, text: str, fields: _Fields) -> HistogramMetricFamily:
    """Convert a histogram to octaves. Counts are exact; the sum uses the middles of the fine buckets, to 3 %."""
    fine = [(round(float(below_ms) * 1e6), int(count)) for below_ms, count in fields.get("buckets", ())]
    buckets = [
        (repr((1 << log2_ns) * 1e-9), float(sum(count for below_ns, count in fine if below_ns <= 1 << log2_ns)))
        for log2_ns in EDGES_LOG2_NS
    ]
    buckets.append(("+Inf", float(sum(count for _, count in fine))))
    total_s = sum(_middle_ns(below_ns) * count for below_ns, count in fine) * 1e-9
    return HistogramMetricFamily(name, text, buckets=buckets, sum_value=total_s)


def _middle_ns(below_ns: int) -> float:
    width_ns = 1 << max((below_ns - 1).bit_length() - SUB_BITS - 1, 0)
    return below_ns - width_ns / 2


def _devices(status: _Fields) -> Iterator[Metric]:
    for path, name, label in (("trackpad.model", "trackpad", "model"), ("board.firmware", "board", "firmware")):
        value = _at(status, path)
        if value is not None:
            yield InfoMetricFamily(f"hapticd_{name}", f"Which {name}", {label: str(value)})


def _counted(name: str, text: str, label: str, counts: _Fields) -> Iterator[Metric]:
    metric = CounterMetricFamily(name, text, labels=[label])
    for key, count in counts.items():
        if (value := _number(count)) is not None:
            metric.add_metric([str(key)], value)
    if metric.samples:
        yield metric


def _amplitudes(board: _Fields) -> Iterator[Metric]:
    """Yield limits and displacements of the modes, peak to peak in metres."""
    limits_um = [_number(limit_um) for limit_um in _list(board.get("w_limit_um"))]
    moved_um = [abs(complex(*w_um)) for w_um in _list(board.get("measured_um")) if len(w_um) == 2]
    for name, text, values_um in (
        ("mode_limit_meters", "The board's limit of a mode, peak to peak", limits_um),
        ("mode_displacement_meters", "Last measured amplitude of a mode, peak to peak", moved_um),
    ):
        metric = GaugeMetricFamily(f"hapticd_{name}", text, labels=["mode"])
        for mode, value_um in enumerate(values_um):
            if value_um is not None:
                metric.add_metric([str(mode)], value_um * 1e-6)
        if metric.samples:
            yield metric


def _at(fields: _Fields, path: str) -> Any:
    value: Any = fields
    for key in path.split("."):
        value = _map(value).get(key)
    return value


def _map(value: Any) -> _Fields:
    return value if isinstance(value, dict) else {}


def _list(value: Any) -> Sequence[Any]:
    return value if isinstance(value, list) else []


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, (int, float)) else None


class StatusCollector(Collector):
    """Collector of a scrape: the metrics of `request`'s reply."""

    def __init__(self, request: Callable[[], _Fields | None]) -> None:
        self._request = request

    def describe(self) -> Iterator[Metric]:
        """Yield nothing, so that registration requests no status."""
        return iter(())

    def collect(self) -> Iterator[Metric]:
        return families(self._request())


def run(
    endpoint: str | None,
    host: str,
    port: int,
    wait: Callable[[], object],
    announce: Callable[[str], object] = lambda address: print(f"metrics: {address}\n(Ctrl-C ends)", flush=True),
) -> None:
    """Serve until `wait` returns or is interrupted; `announce` gets the address. Raises HapticdError,
    hapticd_client.HapticdError."""
    place, registry, one_at_a_time = find(endpoint, os.environ), CollectorRegistry(), threading.Lock()

    def request() -> _Fields | None:
        with one_at_a_time, suppress(hapticd_client.HapticdError):  # two scrapes share the socket
            return control.request("status", timeout_s=ANSWER_S)
        return None

    registry.register(StatusCollector(request))
    with ExitStack() as stack:
        control = Control(stack.enter_context(zmq.Context()), place)
        stack.callback(control.close)
        stack.callback(one_at_a_time.acquire)  # a scrape that is being answered
        try:
            server, _ = start_http_server(port, host, registry)
        except OSError as error:
            raise UsageError(
                f"--host {host} --port {port}: cannot be bound ({error.strerror}): choose another."
            ) from None
        stack.enter_context(server)
        stack.callback(server.shutdown)
        with suppress(KeyboardInterrupt):
            announce(f"http://{host}:{server.server_port}/metrics")
            wait()
