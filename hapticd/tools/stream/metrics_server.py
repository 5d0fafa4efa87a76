"""HTTP server of `hapticd stream prometheus`, bounded: each connection has a thread, and any process may open one."""

from __future__ import annotations

import contextlib
import socket
import sys
import threading
from socketserver import ThreadingMixIn
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

from prometheus_client import CollectorRegistry, make_wsgi_app

MAX_CONNECTIONS = 16  # then the one that came first is closed; a scrape takes milliseconds
READ_WITHIN_S = 5.0


class _Handler(WSGIRequestHandler):
    timeout = READ_WITHIN_S

    def log_message(self, *_: object) -> None:
        """Log nothing."""


class MetricsServer(ThreadingMixIn, WSGIServer):
    """A WSGI server with a thread for each of at most MAX_CONNECTIONS connections."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, *arguments: Any) -> None:
        self._open: dict[socket.socket, None] = {}  # in the order in which they came
        self._lock = threading.Lock()
        super().__init__(*arguments)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in a thread."""
        with self._lock:
            while len(self._open) >= MAX_CONNECTIONS:
                first = next(iter(self._open))
                del self._open[first]
                _end(first)
            self._open[request] = None
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """Close a connection."""
        with self._lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Report a defect; what a peer does, such as sending nothing, is none."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Server6(MetricsServer):
    address_family = socket.AF_INET6


def serving(host: str, port: int, registry: CollectorRegistry) -> tuple[MetricsServer, threading.Thread]:
    """Serve a registry's metrics from a thread. Raises OSError, OverflowError where the port cannot be bound."""
    family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
    server = make_server(
        str(address[0]),
        port,
        make_wsgi_app(registry),
        _Server6 if family == socket.AF_INET6 else MetricsServer,
        handler_class=_Handler,
    )
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    return server, thread


def _end(connection: socket.socket) -> None:
    """End what its thread waits for."""
    with contextlib.suppress(OSError):  # it is closed already
        connection.shutdown(socket.SHUT_RDWR)
