"""`hapticd record | replay | export | plot`. Light: what they set going is imported when it is called."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

MakeCommand = Callable[[Any, str, str, str], argparse.ArgumentParser]


def add(commands: Any, command: MakeCommand) -> None:
    """The four commands; `command` adds one with its summary and example."""
    _add_record(commands, command)
    _add_replay(commands, command)
    _add_export(commands, command)
    _add_plot(commands, command)


def _add_record(commands: Any, command: MakeCommand) -> None:
    parser = command(
        commands,
        "record",
        "record a running daemon: all that it hears, decides and writes",
        "hapticd record session.hrec --seconds 60",
    )
    parser.add_argument("out", type=Path, metavar="OUT", help="file to write, such as session.hrec; it must not exist")
    parser.add_argument("--seconds", type=float, help="how long (default: until Ctrl-C)")
    parser.add_argument("--runtime-dir", type=Path, metavar="DIR", help="the daemon's (default: as clients find it)")
    parser.set_defaults(command=_record)


def _record(options: argparse.Namespace) -> None:
    from .attach import record

    print(record(options.out, options.runtime_dir, options.seconds))


def _add_replay(commands: Any, command: MakeCommand) -> None:
    parser = command(
        commands,
        "replay",
        "feed a recording through the same core: bit-identical, or the first difference",
        "hapticd replay session.hrec\n"
        "         hapticd replay session.hrec --set prediction.name=linear --set solver.fade=0",
    )
    _add_files(parser)
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="show what this would have changed, such as prediction.name=linear; may be given again",
    )
    parser.set_defaults(command=_replay)


def _replay(options: argparse.Namespace) -> int:
    from .reader import open_recording
    from .replay import replay, report

    logging.getLogger("hapticd").addHandler(logging.NullHandler())  # its lines were said when it was recorded
    recording = open_recording(options.files)
    if options.set:
        from .whatif import compare, table

        print(table(*compare(recording, options.set)))
        return 0
    outcome = replay(recording)
    print(report(recording, outcome))
    return 0 if outcome.is_identical else 1


def _add_export(commands: Any, command: MakeCommand) -> None:
    parser = command(
        commands,
        "export",
        "turn a recording into tables for pandas, MATLAB and others",
        "hapticd export session.hrec --hdf5 session.h5",
    )
    _add_files(parser)
    forms = parser.add_mutually_exclusive_group(required=True)
    forms.add_argument("--csv", type=Path, metavar="DIR", help="a folder with one CSV file for each table")
    forms.add_argument("--hdf5", type=Path, metavar="F.h5", help="one HDF5 file with all tables")
    forms.add_argument("--parquet", type=Path, metavar="DIR", help="a folder with one Parquet file for each table")
    parser.set_defaults(command=_export)


def _export(options: argparse.Namespace) -> None:
    from . import export
    from .reader import open_recording
    from .tables import tables

    recording = open_recording(options.files)
    found, beside = tables(recording), export.described(recording)
    if options.csv is not None:
        written = export.to_csv(found, beside, options.csv)
    elif options.hdf5 is not None:
        written = export.to_hdf5(found, beside, options.hdf5)
    else:
        written = export.to_parquet(found, beside, options.parquet)
    for name, table in found.items():
        print(f"{name:<12} {len(table['t_ns']):>9} rows: {', '.join(table)}")
    print(f"written: {', '.join(map(str, written))}")
    _say_losses(recording.losses.told())


def _add_plot(commands: Any, command: MakeCommand) -> None:
    parser = command(
        commands,
        "plot",
        "draw a recording in the manner of the paper's figures",
        "hapticd plot session.hrec session.png --from 2 --to 6",
    )
    parser.add_argument("files", nargs=1, type=Path, metavar="F.hrec", help="the recording")
    parser.add_argument("out", type=Path, metavar="OUT.png", help="the picture")
    parser.add_argument("--from", dest="start_s", type=float, default=0.0, metavar="S", help="in s from its begin")
    parser.add_argument("--to", dest="end_s", type=float, metavar="S", help="default: its end")
    parser.set_defaults(command=_plot)


def _plot(options: argparse.Namespace) -> None:
    from .picture import draw
    from .reader import open_recording
    from .tables import tables

    recording = open_recording(options.files)
    draw(tables(recording), options.out, title=options.files[0].name, start_s=options.start_s, end_s=options.end_s)
    _say_losses(recording.losses.told())


def _add_files(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files", nargs="+", type=Path, metavar="F.hrec", help="the recording; of one in parts all of them, in order"
    )


def _say_losses(told: str) -> None:
    if told:
        print(f"not whole: {told}")
