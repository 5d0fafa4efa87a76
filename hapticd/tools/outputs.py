"""Output files of commands: the arguments that name them, and the check before the work.

One rule for all: the suffix is that of what is written; the folder of a file exists, a folder of results is created;
an existing file is refused without --force; what the command reads and its other outputs are never overwritten.
Devices and pipes (/dev/stdout, a shell's `>(gzip)`) are written as they are; "-" is standard output where offered.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TextIO

from ..errors import UsageError, missing_library, reason
from ..regular_file import is_special, open_regular, opened

PICTURE = (".png", ".pdf", ".svg")
JSON, NPZ, HDF5, RECORDING = (".json",), (".npz",), (".h5", ".hdf5"), (".mcap",)
STDOUT = "-"
Suffixes = tuple[str, ...]


def add_file(
    parser: argparse.ArgumentParser, name: str, suffixes: Suffixes, *, group: Any = None, **options: Any
) -> None:
    """Add an argument that names an output file with one of `suffixes`, and --force; `options` as `add_argument`."""
    if "--force" not in parser._option_string_actions:
        parser.add_argument("--force", action="store_true", help="overwrite existing output files")
    argument = (group or parser).add_argument(name, **{"type": Path, **options})
    parser.set_defaults(outputs={**(parser.get_default("outputs") or {}), argument.dest: suffixes})


def add_json(parser: argparse.ArgumentParser, what: str = "the figures") -> None:
    """Add --json F, which may be standard output."""
    add_file(parser, "--json", JSON, type=str, metavar="F", help=f"write {what} as JSON; - is standard output")


def check_arguments(options: argparse.Namespace) -> None:
    """Check all outputs that the arguments name, before the work.

    Raises UsageError, HapticdError for a picture without matplotlib.
    """
    named: dict[str, Suffixes] = getattr(options, "outputs", {})
    paths = []
    for argument, suffixes in named.items():
        path = getattr(options, argument)
        if path is not None and not (suffixes == JSON and path == STDOUT):
            check_suffix(Path(path), suffixes)
            if suffixes == PICTURE:
                require_matplotlib()
            paths.append(Path(path))
    given = [value for argument, value in vars(options).items() if argument not in named]
    check(paths, inputs=_paths(given), is_forced=getattr(options, "force", False))


def check_suffix(path: Path, suffixes: Suffixes) -> None:
    """Raise UsageError for a file whose name does not end in one of `suffixes`; devices and pipes have any name."""
    if not ((path.suffix and path.name.lower().endswith(suffixes)) or is_special(path)):
        raise UsageError(f"{path}: has the name of another kind of file: end it in {' or '.join(suffixes)}.")


def require_matplotlib() -> None:
    """Raise HapticdError where it is not installed: before the work, so that none is lost for want of its picture."""
    if find_spec("matplotlib") is None:
        raise missing_library("A picture needs matplotlib", "plot")


def check(paths: Sequence[Path], *, inputs: Iterable[Path] = (), is_forced: bool = False) -> None:
    """Raise UsageError for the first of `paths` that must not or cannot be written."""
    for place, path in enumerate(paths):
        folder = path.absolute().parent
        if not folder.is_dir():
            raise UsageError(f"{path}: its directory is missing: create it first.")
        if path.is_dir():
            raise UsageError(f"{path}: is a directory: name a file in it.")
        if any(_is_same(path, other) for other in paths[:place]):
            raise UsageError(f"{path}: is named for two outputs: give each a file of its own.")
        if any(_is_same(path, other) for other in inputs):
            raise UsageError(f"{path}: is an input of this command: name another file for the output.")
        if path.is_file() and not is_forced:
            raise UsageError(f"{path}: exists already: name another file, or add --force to overwrite it.")
        if not os.access(path if path.exists() else folder, os.W_OK):
            raise UsageError(f"{path}: is not writable by this user: choose another place.")


def has_mark(path: Path, mark: bytes, within: int = 0) -> bool:
    """Return whether a file has `mark` at its beginning, or within its first bytes: a command's own earlier output."""
    try:
        with open_regular(path) as file:
            return mark in file.read(max(within, len(mark)))
    except OSError:
        return False


def create_folder(folder: Path) -> None:
    """Create a folder of results, with those above it. Raises UsageError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{folder}: cannot be created as a folder ({reason(error)}): choose another place.") from None


def write_text(text: str, file: Path | str) -> None:
    """Write to the file, or for "-" to standard output. Raises HapticdError, such as for a full disk."""
    if file == STDOUT:
        sys.stdout.write(text)
        return
    with opened(Path(file)) as output:
        output.write(text.encode())


def write_json(value: object, file: Path | str) -> None:
    """Write plain data as JSON, as `write_text` does."""
    write_text(json.dumps(value, indent=2) + "\n", file)


def table_stream(json_file: str | None) -> TextIO:
    """Return where tables go: standard output, or standard error where that is taken by the JSON."""
    return sys.stderr if json_file == STDOUT else sys.stdout


def _paths(values: Iterable[Any]) -> Iterator[Path]:
    for value in values:
        if isinstance(value, Path):
            yield value
        elif isinstance(value, (list, tuple)):
            yield from _paths(value)


def _is_same(path: Path, other: Path) -> bool:
    try:
        return path.samefile(other)
    except OSError:  # one of them does not exist
        return path.absolute() == other.absolute()
