"""Reading of JSON documents field by field; what is missing or of another type is one sentence.

Comments and trailing commas, which Apple's own files have, are read too; UTF-8 and UTF-16, with a mark or without.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import sys
from typing import Any

from ..errors import RefusedError
from ..regular_file import read_bounded

MAX_BYTES = 4_000_000  # an empty list in a list takes forty times its text
MAX_ENTRIES = 50_000  # of a list
# Each goes over a text once: what is not closed is one match up to the end, where json finds what is wrong.
_STRING = r'"(?:[^"\\]++|\\.)*+"?'
_COMMENTS = re.compile(rf"{_STRING}|(?P<comment>//[^\n]*+|/\*.*?\*/)|/\*.*+", re.DOTALL)
_COMMAS = re.compile(rf"{_STRING}|[\[{{,:][ \t\r\n]*,|(?P<trailing>,)(?=[ \t\r\n]*[\]}}])", re.DOTALL)


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
            data = read_bounded(path, MAX_BYTES)
            value = _value(data.decode(json.detect_encoding(data)))
        except OSError as error:
            raise RefusedError(f"{file}: cannot be read ({error.strerror or error}).") from None
        except json.JSONDecodeError as error:
            why = f"line {error.lineno}, column {error.colno}: {error.msg}"
        except UnicodeDecodeError as error:
            why = f"byte {error.start + 1} is not {error.encoding.upper()}"
        except RecursionError:
            why = "it is nested too deeply"
        except ValueError as error:  # a number of thousands of digits
            why = str(error)
        else:
            return cls(value, file)
        raise RefusedError(f"{file}: is not JSON ({why}).")

    def __contains__(self, name: str) -> bool:
        return name in self._fields

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

    def objects(self, name: str, most: int = MAX_ENTRIES) -> list[Document]:
        """Return a list of maps, empty if it is missing. Raises RefusedError."""
        values = self._fields.get(name, [])
        if not isinstance(values, list):
            raise RefusedError(f"{self.where}.{name}: must be a list.")
        if len(values) > most:
            raise RefusedError(f"{self.where}.{name}: has {len(values)} entries, at most {most}: divide it.")
        return [Document(value, f"{self.where}.{name}[{index}]") for index, value in enumerate(values)]


def _value(text: str) -> object:
    """Return the value of JSON, in which comments and trailing commas are blank. Raises ValueError."""
    with contextlib.suppress(json.JSONDecodeError):
        return json.loads(text)
    for lenient in (_COMMENTS, _COMMAS):  # each character becomes one, so that lines and columns stay
        text = lenient.sub(lambda found: re.sub(r"[^\n]", " ", found[0]) if found.lastgroup else found[0], text)
    return json.loads(text)
