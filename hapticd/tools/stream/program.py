"""`hapticd stream`: arguments, and the check of the library that the stream needs."""

from __future__ import annotations

import argparse
import os
import signal
import sys

import hapticd_client
from hapticd_client.endpoint import find

from ...errors import HapticdError, UsageError
from ..arguments import add_command, add_endpoint

FINGERS = 5  # with channels of their own


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
    summary = "offer fingers, modes and markers as Lab Streaming Layer outlets"
    lsl = add_command(actions, "lsl", summary, "")
    add_endpoint(lsl)
    lsl.set_defaults(command=_lsl)


def _lsl(options: argparse.Namespace) -> None:
    """Run until Ctrl-C or SIGTERM. Raises UsageError for an unusable --endpoint, HapticdError for a daemon's reply."""
    from ..record.inlets import pylsl
    from .lsl import run

    lsl = pylsl()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        find(options.endpoint, os.environ)
    except hapticd_client.HapticdError as error:
        raise UsageError(str(error)) from None
    try:
        run(lsl, options.endpoint, FINGERS)
    except hapticd_client.HapticdError as error:
        raise HapticdError(str(error)) from None
