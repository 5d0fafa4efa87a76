"""Errors of this library. Every message is one sentence."""

from __future__ import annotations

import re
import shlex
import sys
from types import TracebackType
from typing import Any


class HapticdError(Exception):
    """Base class of all errors of this library."""


class RefusedError(HapticdError, ValueError):
    """The daemon or this library refused a request; the message is the reason."""


class DaemonGoneError(HapticdError, ConnectionError):
    """No daemon answers. A program that does not catch it ends in its sentence, without a traceback."""


def _show_uncaught(
    kind: type[BaseException], error: BaseException, traceback: TracebackType | None, show: Any = sys.excepthook
) -> None:
    """Print the sentence alone where no line of the program is wrong."""
    if isinstance(error, DaemonGoneError):
        print(error, file=sys.stderr)
    else:
        show(kind, error, traceback)


sys.excepthook = _show_uncaught


def missing_library(need: str, extra: str) -> HapticdError:
    """Return the error for a `need` such as "Pictures need Pillow", with the command that meets it.

    It names what the extra adds, and not the extra: that of a checkout pip would replace. A bare `pip` may be another
    Python's.
    """
    from importlib.metadata import PackageNotFoundError, requires

    for distribution in ("hapticd-client", "hapticd"):  # either contains this library, and both have the extra
        try:
            split = [requirement.partition(";") for requirement in requires(distribution) or ()]
        except PackageNotFoundError:
            continue
        libraries = [name.strip() for name, _, marker in split if re.sub(r"[\s\"']", "", marker) == f"extra=={extra}"]
        if libraries:
            command = shlex.join([sys.executable, "-m", "pip", "install", *libraries])
            return HapticdError(f"{need}: run `{command}`.")
    return HapticdError(f"{need}.")
