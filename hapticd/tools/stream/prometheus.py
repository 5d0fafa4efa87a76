"""`hapticd stream prometheus`: metrics over HTTP. Each scrape, and nothing else, requests the daemon's status."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from typing import Any

import zmq
from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import Metric
from prometheus_client.registry import Collector

import hapticd_client
from hapticd_client.control import Control
from hapticd_client.endpoint import Endpoint, find

from ...errors import UsageError
from .metrics import Fields, families

ANSWER_S = 1.0  # of Prometheus' default scrape timeout of ten seconds


class Status:
    """Requests one daemon's status, from any thread; None without a reply."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], endpoint: Endpoint) -> None:
        self._control = Control(context, endpoint)
        self._one_at_a_time = threading.Lock()  # two scrapes share the socket

    def __call__(self) -> Fields | None:
        with self._one_at_a_time:
            try:
                return self._control.request("status", timeout_s=ANSWER_S)
            except hapticd_client.HapticdError:
                return None

    def close(self) -> None:
        """Close the socket."""
        with self._one_at_a_time:
            self._control.close()


class StatusCollector(Collector):
    """Collector of a scrape: the metrics of `request`'s reply."""

    def __init__(self, request: Callable[[], Fields | None]) -> None:
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
    context: Any = zmq.Context()
    status = Status(context, find(endpoint, os.environ))
    try:
        registry = CollectorRegistry()
        registry.register(StatusCollector(status))
        server, thread = _server(host, port, registry)
        try:
            announce(f"http://{host}:{server.server_port}/metrics")
            wait()
        except KeyboardInterrupt:
            pass
        finally:
            server.shutdown()
            server.server_close()
            thread.join()
    finally:
        status.close()
        context.term()


def _server(host: str, port: int, registry: CollectorRegistry) -> tuple[Any, threading.Thread]:
    try:
        return start_http_server(port, host, registry)
    except (OSError, OverflowError) as error:
        raise UsageError(
            f"--host {host} --port {port}: cannot be bound ({getattr(error, 'strerror', error)}): choose another."
        ) from None
