"""Recordings for other programs: CSV, HDF5 and Parquet, with the same tables and the header's texts in each."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import missing_library
from ...regular_file import opened
from ..outputs import write_json
from .tables import Column

HEADER = "header.json"
Tables = Mapping[str, Mapping[str, Column]]
MOST_FIXED_BYTES = 1 << 24  # of a column of texts, with all as long as the longest


def require(library: str) -> None:
    """Raise HapticdError without a library, before a recording is read for nothing."""
    try:
        import_module(library)
    except ImportError:
        raise missing_library(f"This format needs {library}", "export") from None


def csv_files(tables: Tables, folder: Path) -> list[Path]:
    """The files that `to_csv` writes."""
    return [*(folder / f"{name}.csv" for name in tables), folder / HEADER]


def parquet_files(tables: Tables, folder: Path) -> list[Path]:
    """The files that `to_parquet` writes."""
    return [folder / f"{name}.parquet" for name in tables]


def to_csv(tables: Tables, texts: Mapping[str, str], folder: Path) -> None:
    """One file for each table, and header.json. Raises HapticdError."""
    for name, table in tables.items():
        with opened(folder / f"{name}.csv") as file, io.TextIOWrapper(file, "utf-8", newline="") as text:
            lines = csv.writer(text)
            lines.writerow(table)
            lines.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
    write_json(dict(texts), folder / HEADER)


def to_parquet(tables: Tables, texts: Mapping[str, str], folder: Path) -> None:
    """One file for each table, each with the header in its metadata. Raises HapticdError."""
    import pyarrow
    from pyarrow import parquet

    for name, table in tables.items():
        made = pyarrow.table({column: values.tolist() for column, values in table.items()})
        with opened(folder / f"{name}.parquet") as file:
            parquet.write_table(made.replace_schema_metadata(dict(texts)), file)


def to_hdf5(tables: Tables, texts: Mapping[str, str], path: Path) -> None:
    """One file; each table a data set of its name, each row a compound, and the header as attributes of the file.

    Raises HapticdError.
    """
    import h5py

    made = io.BytesIO()  # the library also reads what it writes, which a device does not give back
    with h5py.File(made, "w") as file:
        for name, value in texts.items():
            file.attrs[name] = value
        for name, table in tables.items():
            columns = {column: _storable(values, h5py.string_dtype()) for column, values in table.items()}
            rows = np.empty(len(next(iter(columns.values()))), [(name, each.dtype) for name, each in columns.items()])
            for column, values in columns.items():
                rows[column] = values
            file.create_dataset(name, data=rows, compression="gzip", shuffle=True)
    with opened(path) as output:
        output.write(made.getbuffer())


def _storable(values: Column, text: np.dtype[Any]) -> Column:
    """Texts as UTF-8 of one length, which every reader of HDF5 knows; where that takes too much, as `text`."""
    if values.dtype != object:
        return values
    encoded = [value.encode() for value in values]
    is_short = max(map(len, encoded)) * len(encoded) <= MOST_FIXED_BYTES
    return np.array(encoded) if is_short else values.astype(text)
