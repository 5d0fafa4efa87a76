"""`hapticd status`: what the running daemon reports of itself, on one page. What is zero or empty is left out."""

from __future__ import annotations

import argparse
import json
import os
import textwrap
from collections.abc import Mapping
from typing import Any

from hapticd_client.messages import printable

from ..config.sections import Config
from ..errors import ExitCode, HapticdError
from .arguments import add_endpoint

WIDTH, NAME_WIDTH = 110, 16
MOST_ITEMS = 4  # of a list
LEFT_OUT = ("t_ns", "histograms", "measured_um")  # of the present instant, or too long: --json has them
UNITS = {"ms": "ms", "um": "um", "hz": "Hz", "ppm": "ppm"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = f"{parser.description} Exit code 1: none answers, or its output is disabled by a fault."
    add_endpoint(parser)
    parser.add_argument("--json", action="store_true", help="print all of it as JSON")
    parser.set_defaults(command=_status)


def _status(options: argparse.Namespace) -> int:
    from .doctor import service  # late: it loads ZeroMQ

    system = service.find(Config(), os.environ, options.endpoint)
    answer = service.daemon(system)
    if system.status is None:
        raise HapticdError(f"No daemon answers: {printable(answer.text)}. {answer.remedy}")
    if options.json:
        print(json.dumps(system.status, indent=2))
    else:
        health = service.health(system)
        warning = [f"{printable(health.text)}: {health.remedy}"] if health.remedy else []
        print(f"hapticd: {printable(answer.text)}", *warning, *page(system.status), sep="\n")
    return ExitCode.FAILED if system.status.get("state") == "FAULT" else ExitCode.DONE


def page(status: Mapping[str, Any]) -> list[str]:
    """Return the lines: one for each part that has something to report, folded where it is long."""
    lines = []
    for name, value in status.items():
        text = _text(value) or ("0" if value == 0 and not isinstance(value, bool) else "")
        if text and name not in LEFT_OUT:
            head = f"{printable(name).replace('_', ' '):<{NAME_WIDTH}} "
            lines += textwrap.wrap(head + text, WIDTH, subsequent_indent=" " * len(head), drop_whitespace=True)
    return lines


def _text(value: object) -> str:
    """Return what is to be read of a value, "" for one that is zero or empty."""
    if isinstance(value, Mapping):
        parts = [_named(str(name), each) for name, each in value.items() if name not in LEFT_OUT]
        return ", ".join(part for part in parts if part)
    if isinstance(value, list | tuple):
        shown = [text for text in map(_text, value[:MOST_ITEMS]) if text]
        return "; ".join(shown + [f"{len(value) - MOST_ITEMS} more"] * (len(value) > MOST_ITEMS))
    if not value:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else "yes" if value is True else printable(str(value))


def _named(name: str, value: object) -> str:
    text = _text(value)
    head, _, unit = name.rpartition("_")
    if unit in UNITS and head and text:
        name, text = head, f"{text} {UNITS[unit]}"
    name = printable(name).replace("_", " ")
    return f"{name} ({text})" if isinstance(value, Mapping) and text else f"{name} {text}" if text else ""
