"""NPZ archives from outside: arrays of plain numbers or texts, each of a bounded size, whatever the archive claims."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

MAX_MEMBERS = 100  # of an archive: their list is read before any of them
_MEMBER = b"PK\x01\x02"  # begins each entry of the list


def arrays_of(data: bytes, choices: Sequence[Sequence[str]], max_bytes: int) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of the first of `choices`, sets of names, that the archive holds in full; empty for none.

    Raises ValueError, and OverflowError for an array of more than `max_bytes`.
    """
    if data.count(_MEMBER) > MAX_MEMBERS:
        raise ValueError(f"has more than {MAX_MEMBERS} arrays")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            present = {entry.filename for entry in archive.infolist()}
            names = next((names for names in choices if present.issuperset(f"{name}.npy" for name in names)), ())
            return {name: _member(archive, f"{name}.npy", max_bytes) for name in names}
    except OverflowError:
        raise
    except Exception as error:  # a damaged archive fails in any of zipfile's, zlib's and numpy's ways
        raise ValueError("is not a readable NPZ archive") from error


def _member(archive: zipfile.ZipFile, name: str, max_bytes: int) -> npt.NDArray[Any]:
    """Return one array. Neither a bomb of packed zeros nor a header that claims too much can exceed the bound."""
    if archive.getinfo(name).compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError("numpy uses no other compression, and others cannot be unpacked in pieces")
    with archive.open(name) as file:
        npy = file.read(max_bytes + 1)
    if len(npy) > max_bytes:
        raise OverflowError(f"an array of more than {max_bytes} bytes")
    head = io.BytesIO(npy)
    if np.lib.format.read_magic(head) != (1, 0):
        raise ValueError("an array of plain numbers has this version")
    shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(head)
    values: npt.NDArray[Any] = np.frombuffer(npy, dtype, offset=head.tell())
    return values.reshape(shape, order="F" if is_fortran else "C")
