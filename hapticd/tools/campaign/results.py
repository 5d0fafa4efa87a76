"""Results of a campaign on disk: each is appended when it comes, and found by its task and by the code that gave it.

A result has the type that the task's function is annotated with, so no file can make this process run anything.
"""

from __future__ import annotations

import fcntl
import io
import pickle
import struct
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import cache
from hashlib import blake2b
from importlib import import_module
from pathlib import Path
from platform import python_version
from typing import Any, BinaryIO, get_type_hints
from zlib import crc32

import msgspec
import numpy as np

from ... import __version__
from ...errors import HapticdError, UsageError, reason
from ...regular_file import open_regular, read_rest

HEADING = b"hapticd results 1\n"
MAX_BYTES = 1 << 30
KEY_BYTES = 16
_RECORD = struct.Struct(f"<{KEY_BYTES}sII")  # key, length and CRC-32 of the result that follows

SOURCES, BUILT = (".py",), (".py", ".so")

Play = Callable[[Any], Any]  # a function of a module, with annotations: from a task to its result


class Results:
    """Results by key, in a file if there is one. Raises HapticdError."""

    def __init__(self, path: Path | None = None) -> None:
        self._path = path
        self._by_key: dict[bytes, bytes] = {}
        self._file = None
        with ExitStack() as after_an_error:
            if path is not None:
                self._file = after_an_error.enter_context(_opened(path))
                self._load(self._file, path)
            after_an_error.pop_all()

    def _load(self, file: BinaryIO, path: Path) -> None:
        """Take what is whole; a campaign that was killed may have left a part of a result at the end."""
        try:
            data = read_rest(file, path, MAX_BYTES)
            if not HEADING.startswith(data[: len(HEADING)]):
                raise UsageError(f"{path}: has no results of a campaign: name another file.")
            self._by_key = dict(_records(data))
            if len(data) < len(HEADING):
                file.truncate(0)
                file.write(HEADING)
                file.flush()
            else:
                file.truncate(len(HEADING) + sum(_RECORD.size + len(result) for _, result in _records(data)))
        except OSError as error:
            raise _unusable(path, error) from None

    def __contains__(self, key: bytes) -> bool:
        return key in self._by_key

    def __getitem__(self, key: bytes) -> bytes:
        return self._by_key[key]

    def add(self, key: bytes, result: bytes) -> None:
        """Keep a result. Raises HapticdError."""
        self._by_key[key] = result
        if self._file is None:
            return
        try:
            self._file.write(_RECORD.pack(key, len(result), crc32(result)) + result)
            self._file.flush()
        except OSError as error:
            raise HapticdError(f"{self._path}: cannot keep results ({reason(error)}).") from None

    @property
    def are_kept(self) -> bool:
        """Whether there is a file."""
        return self._file is not None

    def close(self) -> None:
        """Close the file, if there is one."""
        if self._file is not None:
            self._file.close()


def _opened(path: Path) -> BinaryIO:
    try:
        file = open_regular(path, to_append=True)
    except OSError as error:
        raise _unusable(path, error) from None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise UsageError(f"{path}: another campaign writes its results there: name another file.") from None
    file.seek(0)
    return file


def _unusable(path: Path, error: OSError) -> UsageError:
    return UsageError(f"{path}: cannot keep results ({reason(error)}): name another file.")


def _records(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield key and result of each record, up to the first that is not whole."""
    start = len(HEADING)
    while start + _RECORD.size <= len(data):
        key, length, checksum = _RECORD.unpack_from(data, start)
        start += _RECORD.size + length
        result = data[start - length : start]
        if len(result) != length or crc32(result) != checksum:
            return
        yield key, result


def encode(result: object) -> bytes:
    """Return a result as bytes; every number keeps its last bit."""
    return msgspec.msgpack.encode(result, enc_hook=_plain)


def decoder(play: Play) -> Callable[[bytes], Any]:
    """Return what makes results of bytes: of the type that `play` returns. It raises HapticdError."""
    known = msgspec.msgpack.Decoder(get_type_hints(play)["return"], dec_hook=_array)

    def decode(data: bytes) -> Any:
        try:
            return known.decode(data)
        except (msgspec.MsgspecError, TypeError, ValueError) as error:
            raise HapticdError(f"A kept result is not of its task ({error}): delete the file of results.") from None

    return decode


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray) and value.dtype.hasobject is False:
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a result has a {type(value).__name__}")


def _array(_: type, value: Any) -> Any:
    dtype, shape, data = msgspec.convert(value, tuple[str, tuple[int, ...], bytes])
    return np.frombuffer(data, np.dtype(dtype)).reshape(shape)


def key_of(play: Play, task: object) -> bytes:
    """Return the key of a task's result: other code, another Python or NumPy and another task have another one.

    Pickles without memo are the same for equal values, however these are shared.
    """
    text = io.BytesIO()
    pickler = pickle.Pickler(text, 5)
    pickler.fast = True
    pickler.dump((code_of(play, BUILT), __version__, python_version(), np.__version__, play, task))
    return blake2b(text.getbuffer(), digest_size=KEY_BYTES).digest()


def code_of(play: Play, suffixes: tuple[str, ...] = SOURCES) -> str:
    """Return a digest of hapticd's files with these suffixes, and of those of the package that `play` is from."""
    packages = {"hapticd", play.__module__.partition(".")[0]}
    return " ".join(_digest(package, suffixes) for package in sorted(packages))


@cache
def _digest(package: str, suffixes: tuple[str, ...]) -> str:
    module = import_module(package)
    digest = blake2b(digest_size=KEY_BYTES)
    for folder in map(Path, getattr(module, "__path__", ())):
        for path in sorted(path for path in folder.rglob("*") if path.suffix in suffixes):
            digest.update(f"{path.relative_to(folder)}\0".encode() + path.read_bytes())
    if module.__file__ is not None:
        digest.update(Path(module.__file__).read_bytes())
    return digest.hexdigest()
