"""Output files of commands: checks before the work, and writing of text."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from ..errors import HapticdError, UsageError, reason


def check_writable(*paths: Path | str | None) -> None:
    """Raise UsageError for the first path that cannot be written; None is skipped, "-" is standard output."""
    for path in (Path(path) for path in paths if path not in (None, "-")):
        folder = path.absolute().parent
        if not folder.is_dir():
            raise UsageError(f"{path}: its directory is missing: create it first.")
        if path.is_dir():
            raise UsageError(f"{path}: is a directory: name a file in it.")
        if not os.access(path if path.exists() else folder, os.W_OK):
            raise UsageError(f"{path}: is not writable by this user: choose another place.")


def write_text(text: str, file: str) -> None:
    """Write to the file, or for "-" to standard output. Raises HapticdError, such as for a full disk."""
    if file == "-":
        sys.stdout.write(text)
        return
    try:
        Path(file).write_text(text, encoding="utf-8")
    except OSError as error:
        raise HapticdError(f"{file}: cannot be written ({reason(error)}); choose another place.") from None
