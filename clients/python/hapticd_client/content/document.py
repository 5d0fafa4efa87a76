"""Reading of JSON documents field by field; what is missing or of another type is one sentence."""

from __future__ import annotations

import json
import os
import sys
from typing import Any

from ..errors import RefusedError
from ..regular_file import read_bounded

MAX_BYTES = 4_000_000  # an empty list in a list takes forty times its text
MAX_ENTRIES = 50_000  # of a list


class Document:
    """A map of a JSON file. `where` is its place in the file, for errors."""

    def __init__(self, value: object, where: str) -> None:
        if not isinstance(value, dict):
            raise RefusedError(f"{where}: must be an object.")
        self._fields: dict[str, Any] = value
        self.where = where

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Document:
        """Read a file. Raises RefusedError."""
        file = os.fspath(path)
        try:
            value = json.loads(read_bounded(path, MAX_BYTES).decode("utf-8-sig"))
        except OSError as error:
            raise RefusedError(f"{file}: cannot be read ({error.strerror or error}).") from None
        except (ValueError, RecursionError):
            raise RefusedError(f"{file}: is not JSON.") from None
        return cls(value, file)

    def __contains__(self, name: str) -> bool:
        return name in self._fields

    @property
    def names(self) -> set[str]:
        """The names of all fields."""
        return set(self._fields)

    def number(self, name: str, default: float | None = None) -> float:
        """Return a finite number; `default` if it is missing. Raises RefusedError."""
        value = self._fields.get(name, default)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= sys.float_info.max:
            raise RefusedError(f"{self.where}.{name}: must be a number.")
        return float(value)

    def text(self, name: str, default: str = "") -> str:
        """Return a text; `default` if it is missing. Raises RefusedError."""
        value = self._fields.get(name, default)
        if not isinstance(value, str):
            raise RefusedError(f"{self.where}.{name}: must be a text.")
        return value

    def count(self, name: str) -> int:
        """Return the length of a list, 0 if it is none."""
        values = self._fields.get(name)
        return len(values) if isinstance(values, list) else 0

    def object(self, name: str) -> Document:
        """Return a map. Raises RefusedError."""
        return Document(self._fields.get(name), f"{self.where}.{name}")

    def objects(self, name: str) -> list[Document]:
        """Return a list of maps, empty if it is missing. Raises RefusedError."""
        values = self._fields.get(name, [])
        if not isinstance(values, list):
            raise RefusedError(f"{self.where}.{name}: must be a list.")
        if len(values) > MAX_ENTRIES:
            raise RefusedError(f"{self.where}.{name}: has {len(values)} entries, at most {MAX_ENTRIES}: divide it.")
        return [Document(value, f"{self.where}.{name}[{index}]") for index, value in enumerate(values)]
