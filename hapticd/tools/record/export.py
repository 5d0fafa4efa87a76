"""Recordings for other programs: CSV, HDF5 and Parquet, with the same tables and the header's texts in each."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import RecordingError
from .tables import Column

Tables = Mapping[str, Mapping[str, Column]]
MOST_FIXED_BYTES = 1 << 24  # of a column of texts, with all as long as the longest


def to_csv(tables: Tables, texts: Mapping[str, str], folder: Path) -> list[Path]:
    """One file for each table, and header.json; what was written. Raises RecordingError."""
    with _Writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        written = [folder / f"{name}.csv" for name in tables]
        for path, table in zip(written, tables.values(), strict=True):
            with path.open("w", encoding="utf-8", newline="") as file:
                lines = csv.writer(file)
                lines.writerow(table)
                lines.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
        header = folder / "header.json"
        header.write_text(json.dumps(dict(texts), indent=2) + "\n", encoding="utf-8")
        return [*written, header]


def to_parquet(tables: Tables, texts: Mapping[str, str], folder: Path) -> list[Path]:
    """One file for each table, each with the header in its metadata. Raises RecordingError."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise _missing("pyarrow") from None
    with _Writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, table in tables.items():
            made = pyarrow.table({column: values.tolist() for column, values in table.items()})
            parquet.write_table(made.replace_schema_metadata(dict(texts)), folder / f"{name}.parquet")
        return [folder / f"{name}.parquet" for name in tables]


def to_hdf5(tables: Tables, texts: Mapping[str, str], path: Path) -> list[Path]:
    """One file; each table a data set of its name, each row a compound, and the header as attributes of the file.

    Raises RecordingError.
    """
    try:
        import h5py
    except ImportError:
        raise _missing("h5py") from None
    with _Writing(path), h5py.File(path, "w") as file:
        for name, value in texts.items():
            file.attrs[name] = value
        for name, table in tables.items():
            columns = {column: _storable(values, h5py.string_dtype()) for column, values in table.items()}
            rows = np.empty(len(next(iter(columns.values()))), [(name, each.dtype) for name, each in columns.items()])
            for column, values in columns.items():
                rows[column] = values
            file.create_dataset(name, data=rows, compression="gzip", shuffle=True)
    return [path]


def _storable(values: Column, text: np.dtype[Any]) -> Column:
    """Texts as UTF-8 of one length, which every reader of HDF5 knows; where that takes too much, as `text`."""
    if values.dtype != object:
        return values
    encoded = [value.encode() for value in values]
    is_short = max(map(len, encoded)) * len(encoded) <= MOST_FIXED_BYTES
    return np.array(encoded) if is_short else values.astype(text)


def _reason(error: OSError) -> str:
    """The system's reason, which HDF5 puts among addresses and sizes."""
    inner = re.search(r"error message = '([^']*)'", str(error))
    return inner[1] if inner is not None else error.strerror or str(error)


class _Writing:
    """Turns an OSError into one sentence that names the file."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, error: BaseException | None, traceback: Any) -> None:
        if isinstance(error, OSError):
            raise RecordingError(f"{self._path}: cannot be written ({_reason(error)}).") from None


def _missing(library: str) -> RecordingError:
    return RecordingError(f'This format needs {library}: install it with `pip install "hapticd[export]"`.')
