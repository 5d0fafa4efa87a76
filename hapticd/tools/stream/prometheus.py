"""`hapticd stream prometheus`: metrics over HTTP. The daemon is asked for its status at each scrape, and only then."""

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

ANSWER_S = 1.0  # of the ten seconds that Prometheus waits by default


class Status:
    """Asks one daemon for its status, from any thread; None where nobody answers."""

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
    """What a scrape collects: the answer to `ask`, at that moment."""

    def __init__(self, ask: Callable[[], Fields | None]) -> None:
        self._ask = ask

    def describe(self) -> Iterator[Metric]:
        """Nothing: to be registered is no reason to ask the daemon."""
        return iter(())

    def collect(self) -> Iterator[Metric]:
        return families(self._ask())


def run(
    endpoint: str | None,
    host: str,
    port: int,
    wait: Callable[[], object],
    tell: Callable[[str], object] = lambda address: print(f"metrics: {address}\n(Ctrl-C ends)", flush=True),
) -> None:
    """Serve until `wait` returns or is interrupted; `tell` hears the address. Raises HapticdError,
    hapticd_client.HapticdError."""
    context: Any = zmq.Context()
    status = Status(context, find(endpoint, os.environ))
    try:
        registry = CollectorRegistry()
        registry.register(StatusCollector(status))
        server, thread = _server(host, port, registry)
        try:
            tell(f"http://{host}:{server.server_port}/metrics")
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
            f"--host {host} --port {port}: cannot be had ({getattr(error, 'strerror', error)}): choose another."
        ) from None
