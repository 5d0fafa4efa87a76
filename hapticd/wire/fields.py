"""Validation of untrusted MessagePack: unpack, then read field by field within bounds; unknown fields are refused.

Every defect raises RequestError with one sentence that names the field. Received values are never printed whole: a
hostile one may be deep, long or unprintable.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from enum import Enum
from typing import TypeVar

import msgpack

from ..errors import RequestError

MAX_PAYLOAD_BYTES = 65536
MAX_BINARY_BYTES = 128 * 128  # an amplitude map
MAX_SHOWN_BITS = 64

_KINDS = {dict: "a map", list: "a list", str: "a text", bytes: "bytes", bool: "a truth value", int: "a whole number"}
_KINDS |= {float: "a number", type(None): "nil"}

Key = TypeVar("Key", int, str, int | str)
Value = TypeVar("Value")
Choice = TypeVar("Choice", bound=Enum)


def unpack(payload: bytes) -> object:
    """Unpack one MessagePack value, whose maps have distinct keys.

    No text, list or map is longer than the message: each field's reader has its bound, and can name it.
    """
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise RequestError(f"The message has {len(payload)} bytes, the limit is {MAX_PAYLOAD_BYTES}.")
    try:
        return msgpack.unpackb(
            payload,
            raw=False,
            strict_map_key=True,
            object_pairs_hook=_distinct,
            max_ext_len=0,
        )
    except RequestError:
        raise
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as error:
        reason = str(error).rstrip(".") or type(error).__name__
        raise RequestError(f"The message ({len(payload)} bytes) is not valid MessagePack: {reason}.") from None


def peek_whole(payload: bytes, name: str) -> int | None:
    """Return a whole number of a message that `unpack` refuses, so that its sender gets an answer; None without one."""
    unpacker = msgpack.Unpacker(raw=False, strict_map_key=True, max_buffer_size=MAX_PAYLOAD_BYTES, max_ext_len=0)
    try:
        unpacker.feed(payload)
        for _ in range(unpacker.read_map_header()):
            if unpacker.unpack() == name:
                value = unpacker.unpack()
                return value if type(value) is int else None
            unpacker.skip()
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException):
        pass
    return None


def _distinct(pairs: list[tuple[object, object]]) -> dict[object, object]:
    """Build a map; refuse duplicate keys, which two readers may resolve differently."""
    table = dict(pairs)
    if len(table) != len(pairs):
        raise RequestError("The message contains a map with the same key twice.")
    return table


class Fields:
    """The fields of one received map, read one by one; `end` refuses those that were not read.

    `where` is the map's place in the message, for error messages: "" is the message itself.
    """

    __slots__ = ("_left", "where")

    def __init__(self, value: object, where: str = "") -> None:
        if not isinstance(value, dict):
            raise RequestError(f"{where or 'The message'}: must be a map, not {_kind(value)}.")
        self._left: dict[object, object] = value.copy()
        self.where = where

    def __contains__(self, name: str) -> bool:
        return name in self._left

    def place(self, name: str) -> str:
        """Return the field's place in the message, such as `targets[2].grating.period_mm`."""
        return f"{self.where}.{name}" if self.where else name

    def end(self) -> None:
        """Refuse fields that were not read: a misspelt one would otherwise be ignored."""
        for name in self._left:
            raise RequestError(f"{self.place(str(name)[:32])!r}: unknown field, see clients/PROTOCOL.md.")

    def take(self, name: str) -> object:
        """Take the field as received; refused if it is missing."""
        if name not in self._left:
            raise RequestError(f"{self.place(name)}: is missing.")
        return self._left.pop(name)

    def number(self, name: str, low: float, high: float, default: float | None = None) -> float:
        """Read a finite number within low .. high; `default` if it is missing."""
        if default is not None and name not in self._left:
            return default
        return bounded(self.take(name), low, high, self.place(name))

    def whole(self, name: str, low: int, high: int) -> int:
        """A whole number within low .. high."""
        return whole(self.take(name), low, high, self.place(name))

    def boolean(self, name: str, default: bool) -> bool:
        """Read true or false; `default` if it is missing."""
        value = self._left.pop(name, default)
        if not isinstance(value, bool):
            raise RequestError(f"{self.place(name)}: must be true or false, not {_kind(value)}.")
        return value

    def label(self, name: str) -> str:
        """A name of 1 .. 32 printable characters."""
        return label(self.take(name), self.place(name))

    def text(self, name: str, longest: int) -> str:
        """Read 1 .. `longest` printable characters."""
        value = self.take(name)
        if not isinstance(value, str):
            raise RequestError(f"{self.place(name)}: must be a text, not {_kind(value)}.")
        if not (1 <= len(value) <= longest and value.isprintable()):
            raise RequestError(f"{self.place(name)}: must have 1 .. {longest} printable characters.")
        return value

    def binary(self, name: str, length: int) -> bytes:
        """Read exactly `length` bytes."""
        value = self._bytes(name)
        if len(value) != length:
            raise RequestError(f"{self.place(name)}: has {len(value)} bytes, it must have {length}.")
        return value

    def some_binary(self, name: str, longest: int) -> bytes:
        """Read 1 .. `longest` bytes."""
        value = self._bytes(name)
        if not 1 <= len(value) <= longest:
            raise RequestError(f"{self.place(name)}: has {len(value)} bytes, it must have 1 .. {longest}.")
        return value

    def _bytes(self, name: str) -> bytes:
        value = self.take(name)
        if not isinstance(value, bytes):
            raise RequestError(f"{self.place(name)}: must be bytes, not {_kind(value)}.")
        return value

    def choice(self, name: str, kind: type[Choice]) -> Choice:
        """Read a member of an Enum by its value."""
        value, known = self.label(name), [member.value for member in kind]
        if value not in known:
            raise RequestError(f"{self.place(name)}: must be one of {', '.join(known)}.")
        return kind(value)

    def only(self, names: Collection[str]) -> str:
        """Return which one of these fields the map has; refused without one, and with several."""
        given = [name for name in names if name in self._left]
        if len(given) != 1:
            raise RequestError(f"{self.where}: needs exactly one of {', '.join(names)}.")
        return given[0]

    def inner(self, name: str, read: Callable[[Fields], Value]) -> Value:
        """Read a map by `read`, which reads all of its fields."""
        fields = Fields(self.take(name), self.place(name))
        value = read(fields)
        fields.end()
        return value

    def table(
        self, name: str, longest: int, read: Callable[[Fields], tuple[Key, Value]], key_field: str = "name"
    ) -> dict[Key, Value]:
        """Read a list of at most `longest` maps, each by `read` to its key and value; empty if it is missing."""
        table: dict[Key, Value] = {}
        for index, item in enumerate(items(self._left.pop(name, []), longest, self.place(name))):
            fields = Fields(item, self.place(f"{name}[{index}]"))
            key, value = read(fields)
            fields.end()
            if key in table:
                raise RequestError(f"{fields.place(key_field)}: {key!r} is listed twice.")
            table[key] = value
        return table


def items(value: object, longest: int, where: str) -> Sequence[object]:
    """A list of at most `longest` items."""
    if not isinstance(value, list):
        raise RequestError(f"{where}: must be a list, not {_kind(value)}.")
    if len(value) > longest:
        raise RequestError(f"{where}: has {len(value)} items, at most {longest} are allowed.")
    return value


def bounded(value: object, low: float, high: float, where: str) -> float:
    """A number within low .. high; NaN and infinities are outside, whatever the bounds."""
    if type(value) is not float and type(value) is not int:
        raise RequestError(f"{where}: must be a number, not {_kind(value)}.")
    if not low <= value <= high:
        raise RequestError(f"{where}: {_shown(value)} is out of bounds, it must be {low:g} .. {high:g}.")
    return float(value)


def pair(value: object, most: float, where: str) -> tuple[float, float]:
    """Two numbers x and y, within -`most` .. `most`."""
    numbers = items(value, 2, where)
    if len(numbers) != 2:
        raise RequestError(f"{where}: a point has two numbers, x and y.")
    return bounded(numbers[0], -most, most, where), bounded(numbers[1], -most, most, where)


def points(value: object, longest: int, most: float, where: str) -> tuple[tuple[float, float], ...]:
    """At most `longest` points, each as `pair`."""
    found: list[tuple[float, float]] = []
    for index, item in enumerate(items(value, longest, where)):
        if type(item) is list and len(item) == 2:  # a sound point, in a fifth of the time
            x, y = item
            if type(x) is float and type(y) is float and -most <= x <= most and -most <= y <= most:
                found.append((x, y))
                continue
        found.append(pair(item, most, f"{where}[{index}]"))
    return tuple(found)


def whole(value: object, low: int, high: int, where: str) -> int:
    """A whole number within low .. high."""
    if type(value) is not int:
        raise RequestError(f"{where}: must be a whole number, not {_kind(value)}.")
    if not low <= value <= high:
        raise RequestError(f"{where}: {_shown(value)} is out of bounds, it must be {low} .. {high}.")
    return value


def label(value: object, where: str) -> str:
    """A name of 1 .. 32 printable characters."""
    if not isinstance(value, str):
        raise RequestError(f"{where}: must be a name, not {_kind(value)}.")
    if not (1 <= len(value) <= 32 and value.isprintable()):
        raise RequestError(f"{where}: a name has 1 .. 32 printable characters.")
    return value


def _shown(value: float) -> str:
    """Return a received number for an error message: JSON has whole numbers that neither a float nor a line holds."""
    if type(value) is int:
        return str(value) if value.bit_length() <= MAX_SHOWN_BITS else f"a whole number of {value.bit_length()} bits"
    return f"{value:g}"


def _kind(value: object) -> str:
    return _KINDS.get(type(value), "a MessagePack extension")
