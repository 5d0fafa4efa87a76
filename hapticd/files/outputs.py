"""The files that a command shall write: looked at before it works for them, and written."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from ..errors import HapticdError, UsageError, reason


def check_writable(*paths: Path | str | None) -> None:
    """Raises UsageError for the first that cannot be written; None is not asked for, "-" is standard output."""
    for path in (Path(path) for path in paths if path not in (None, "-")):
        folder = path.absolute().parent
        if not folder.is_dir():
            raise UsageError(f"{path}: its directory is missing, so it could not be written: create it first.")
        if path.is_dir():
            raise UsageError(f"{path}: is a directory: name a file in it.")
        if not os.access(path if path.exists() else folder, os.W_OK):
            raise UsageError(f"{path}: may not be written by this user: choose another place.")


def write_text(text: str, file: str) -> None:
    """To the file, or for "-" to standard output. Raises HapticdError in one sentence, such as for a full disk."""
    if file == "-":
        sys.stdout.write(text)
        return
    try:
        Path(file).write_text(text, encoding="utf-8")
    except OSError as error:
        raise HapticdError(f"{file}: cannot be written ({reason(error)}); choose another place.") from None
