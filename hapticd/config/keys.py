"""One configuration key: default, bounds and meaning, and the validation of its value."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import Field, field
from typing import Any

from ..errors import ConfigError
from ..formats.toml_file import shown


def key(
    default: Any, doc: str, *, low: float = -math.inf, high: float = math.inf, choices: tuple[str, ...] = ()
) -> Any:
    """Define a configuration key. `low` and `high` bound a number, or each number of a list."""
    return field(default=default, metadata={"doc": doc, "low": low, "high": high, "choices": choices})


def checked(entry: Field[Any], value: Any, where: str) -> Any:
    """Validate a value of the file against its key. Raises ConfigError."""
    default = entry.default
    if isinstance(default, tuple):
        if not isinstance(value, list) or not all(_is_number(item) for item in value):
            example = toml(default or (0.0, 1.0))
            raise ConfigError(f"{where}: must be a list of numbers, such as {example}, not {shown(value)}.")
        return tuple(_bounded(entry, float(item), where) for item in value)
    if isinstance(default, str):
        if not isinstance(value, str):
            raise ConfigError(f"{where}: must be a text in quotes, not {shown(value)}.")
        if entry.metadata["choices"] and value not in entry.metadata["choices"]:
            raise ConfigError(f"{where}: {shown(value)} is not one of {', '.join(entry.metadata['choices'])}.")
        return value
    if isinstance(default, int) and not (isinstance(value, int) and not isinstance(value, bool)):
        raise ConfigError(f"{where}: must be a whole number, not {shown(value)}.")
    if not _is_number(value):
        raise ConfigError(f"{where}: must be a number, not {shown(value)}.")
    return _bounded(entry, value if isinstance(default, int) else float(value), where)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _bounded(entry: Field[Any], value: float, where: str) -> float:
    if entry.metadata["low"] <= value <= entry.metadata["high"]:  # False for NaN
        return value
    raise ConfigError(f"{where}: {value:g} is out of bounds, it must be {bounds_text(entry)}.")


def bounds_text(entry: Field[Any]) -> str:
    """Describe the valid values of a key; empty if any are."""
    if entry.metadata["choices"]:
        return " | ".join(entry.metadata["choices"])
    low, high = entry.metadata["low"], entry.metadata["high"]
    return "" if math.isinf(low) and math.isinf(high) else f"{low:.10g} .. {high:.10g}"


def nearest(name: str, valid: Mapping[str, Any]) -> str:
    """End of the error message about an unknown name: the closest valid name, or all of them."""
    close = difflib.get_close_matches(name, valid, n=1, cutoff=0.5)
    return f", did you mean {close[0]}?" if close else f", valid are {', '.join(valid)}."


def toml(value: Any) -> str:
    """Format a value as TOML."""
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, tuple):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    return repr(value)
