"""TOML reader with bounds: at most 64 KiB, integers of 64 bits, printable one-line strings.

The parser accepts numbers of any length, and its memory grows with the square of a dotted key's parts: both are refused
before parsing.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from ..errors import ConfigError, reason
from ..regular_file import read_bounded

MAX_BYTES = 65536  # the complete commented configuration has 5000
MAX_TEXT = 4096  # characters of a key or a string: the longest path
_MAX_KEY_PARTS = 16  # parts.of.a.dotted.key; hapticd's have two
_NOT_IN_KEYS = re.compile(r"[=,{\n]")
_SHOWN = 60  # characters of a value in an error's sentence


def read_table(path: Path, hint: str) -> dict[str, Any]:
    """Return the table in the file. Raises ConfigError; for an unreadable file it ends with `hint`."""
    try:
        text = read_bounded(path, MAX_BYTES).decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read ({reason(error)}): {hint}.") from None
    return parse(text, str(path))


def shown(value: object) -> str:
    """Return a value for an error message, shortened if long."""
    text = repr(value)
    return text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."


def parse(text: str, where: str) -> dict[str, Any]:
    """Parse the text; `where` names it in errors. Raises ConfigError."""
    if max(part.count(".") for part in _NOT_IN_KEYS.split(text)) >= _MAX_KEY_PARTS:
        raise ConfigError(f"{where}: holds a name with {_MAX_KEY_PARTS} dots or more: write [section] and key = value.")
    try:
        table = tomllib.loads(text)
        is_plain = _is_plain(table)
    except RecursionError:
        raise ConfigError(f"{where}: nests too deeply: write [section] and key = value.") from None
    except ValueError as error:  # TOMLDecodeError is one, and so is a number of too many digits
        raise ConfigError(f"{where}: is not valid TOML: {str(error).rstrip('.')}.") from None
    if not is_plain:
        raise ConfigError(f"{where}: holds a number beyond 64 bits, or a name or text that is not one printable line.")
    return table


def _is_plain(value: object) -> bool:
    if isinstance(value, dict):
        return all(_is_plain(name) and _is_plain(item) for name, item in value.items())
    if isinstance(value, list):
        return all(map(_is_plain, value))
    if isinstance(value, str):
        return len(value) <= MAX_TEXT and value.isprintable()
    return not isinstance(value, int) or -(1 << 63) <= value < 1 << 63
