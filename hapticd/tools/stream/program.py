"""`hapticd stream`: arguments, and checks of the libraries that the streams need."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any

import hapticd_client
from hapticd_client.endpoint import find

from ...errors import HapticdError, UsageError, missing_library
from ..arguments import PORT_NUMBER, add_command, add_endpoint

PROMETHEUS_PORT = 9873
FINGERS = 5  # with channels of their own


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = f"example: hapticd stream prometheus --port {PROMETHEUS_PORT}\n         hapticd stream lsl"
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
    prometheus = _action(actions, "prometheus", "serve the daemon's status as metrics over HTTP", "--port 9100")
    prometheus.add_argument("--host", default="127.0.0.1", help="address to serve at (default 127.0.0.1)")
    prometheus.add_argument(
        "--port", type=PORT_NUMBER, default=PROMETHEUS_PORT, help=f"0: any free one (default {PROMETHEUS_PORT})"
    )
    prometheus.set_defaults(command=_prometheus)

    lsl = _action(actions, "lsl", "offer fingers, modes and markers as Lab Streaming Layer outlets", "")
    lsl.set_defaults(command=_lsl)


def _action(actions: Any, name: str, summary: str, example: str) -> argparse.ArgumentParser:
    parser = add_command(actions, name, summary, example)
    add_endpoint(parser)
    return parser


def _prometheus(options: argparse.Namespace) -> None:
    try:
        import prometheus_client  # noqa: F401
    except ImportError:
        raise missing_library("Metrics need prometheus-client", "streams") from None
    from .prometheus import run

    _streaming(options.endpoint, lambda: run(options.endpoint, options.host, options.port, threading.Event().wait))


def _lsl(options: argparse.Namespace) -> None:
    from ..record.inlets import pylsl
    from .lsl import run

    lsl = pylsl()
    _streaming(options.endpoint, lambda: run(lsl, options.endpoint, FINGERS))


def _streaming(endpoint: str | None, run: Callable[[], None]) -> None:
    """Run until Ctrl-C or SIGTERM. Raises UsageError for an unusable --endpoint, HapticdError for a daemon's reply."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        find(endpoint, os.environ)
    except hapticd_client.HapticdError as error:
        raise UsageError(str(error)) from None
    try:
        run()
    except hapticd_client.HapticdError as error:
        raise HapticdError(str(error)) from None
