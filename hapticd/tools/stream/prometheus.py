"""`hapticd stream prometheus`: each number of the daemon's status as a metric over HTTP, in base units.

Each scrape, and nothing else, requests the status. A metric is named by its path: `board.late_frames` is
`hapticd_board_late_frames`. Which of them only rise is the daemon's matter: they are untyped.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from typing import Any

import zmq
from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import (
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
    StateSetMetricFamily,
    UntypedMetricFamily,
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
NO_METRICS = ("t_ns", "latency_ms", "histograms")  # the histograms have types of their own, and all percentiles
UNITS = {
    "ms": ("seconds", 1e-3),
    "um": ("meters", 1e-6),
    "hz": ("hertz", 1.0),
    "ppm": ("ratio", 1e-6),
    "frac": ("ratio", 1.0),
}


def families(status: _Fields | None) -> Iterator[Metric]:
    """Yield all metrics of one reply; without one, None, only `hapticd_up` 0."""
    yield GaugeMetricFamily("hapticd_up", "1 if the daemon answered", value=float(status is not None))
    if status is None:
        return
    yield StateSetMetricFamily("hapticd_state", "Of the daemon", {one: status.get("state") == one for one in STATES})
    yield from _numbers("", status)
    for key, fields in status.get("timing", {}).get("histograms", {}).items():
        yield histogram(f"hapticd_timing_{key}_seconds", f"timing.histograms.{key}", fields)


def _numbers(path: str, value: Any) -> Iterator[Metric]:
    """Yield the numbers below a path of the status, and the texts that name a device."""
    if isinstance(value, dict):
        for name, part in value.items():
            if name not in NO_METRICS:
                yield from _numbers(f"{path}.{name}".lstrip("."), part)
        return
    head, _, unit = path.rpartition("_")
    base, scale = UNITS.get(unit, ("", 1.0))
    name = f"hapticd_{f'{head}_{base}' if base else path}".replace(".", "_")
    if isinstance(value, (int, float)):
        yield UntypedMetricFamily(name, path, value=value * scale)
    elif unit == "um" and isinstance(value, list) and value:
        metric = UntypedMetricFamily(name, f"{path}, peak to peak", labels=["mode"])
        for mode, amplitude in enumerate(value):
            magnitude = abs(complex(*amplitude)) if isinstance(amplitude, (list, tuple)) else amplitude
            metric.add_metric([str(mode)], magnitude * scale)
        yield metric
    elif path in ("trackpad.model", "board.firmware") and value is not None:
        device, _, label = path.partition(".")
        yield InfoMetricFamily(f"hapticd_{device}", f"Which {device}", {label: str(value)})


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
