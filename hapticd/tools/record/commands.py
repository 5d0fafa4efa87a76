"""`hapticd record | replay | export`: arguments and calls; their modules are imported when they run."""

from __future__ import annotations

import argparse
import logging
import select
import sys
from pathlib import Path
from typing import TextIO

from ...errors import UsageError
from .. import outputs
from ..arguments import POSITIVE, add_endpoint
from ..progress import progress_bar


def add_record_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "out", type=Path, metavar="OUT", help="file to write, such as session.mcap; where it exists, session-2.mcap"
    )
    parser.add_argument("--seconds", type=POSITIVE, help="how long (default: until Ctrl-C)")
    parser.add_argument(
        "--now", action="store_true", help="begin at once, in mid-session: such a file cannot be replayed"
    )
    add_endpoint(parser, type=Path)
    parser.add_argument(
        "--lsl",
        action="append",
        default=[],
        metavar="NAME",
        help="record this stream of the Lab Streaming Layer too, on the daemon's clock; may be given again",
    )
    parser.add_argument("--owned", action="store_true", help=argparse.SUPPRESS)  # ends with standard input too
    parser.set_defaults(command=_record)


def _record(options: argparse.Namespace) -> None:
    from .attach import record, until_signal
    from .inlets import Inlets

    with until_signal() as is_signalled, Inlets.opened(options.lsl) as inlets:

        def is_ended() -> bool:
            return is_signalled() or (options.owned and _is_closed(sys.stdin))

        print(
            record(
                *(options.out, options.endpoint, options.seconds),
                is_now=options.now,
                is_ended=is_ended,
                inlets=inlets,
            )
        )


def _is_closed(pipe: TextIO) -> bool:
    """Return whether the owner at the other end has gone, without waiting."""
    ready, _, _ = select.select([pipe], [], [], 0)
    return bool(ready) and not pipe.read(1)


def add_replay_arguments(parser: argparse.ArgumentParser) -> None:
    _add_files(parser)
    parser.set_defaults(command=_replay)


def _replay(options: argparse.Namespace) -> int:
    from ...files.recording.mcap_reader import open_recording
    from .replay import replay, report

    logging.getLogger("hapticd").addHandler(logging.NullHandler())  # the recorded daemon logged them
    recording = open_recording(options.files)
    with progress_bar("replaying") as recording.progress:
        outcome = replay(recording)
    print(report(recording, outcome))
    return 0 if outcome.is_identical else 1


def add_export_arguments(parser: argparse.ArgumentParser) -> None:
    _add_files(parser)
    forms = parser.add_argument_group("formats, one or more")
    forms.add_argument("--csv", type=Path, metavar="DIR", help="a folder with one CSV file for each table")
    outputs.add_file(parser, "--hdf5", outputs.HDF5, group=forms, metavar="F.h5", help="one HDF5 file with all tables")
    forms.add_argument("--parquet", type=Path, metavar="DIR", help="a folder with one Parquet file for each table")
    outputs.add_file(parser, "--plot", outputs.PICTURE, group=forms, metavar="F.png", help="the paper's figures of it")
    parser.add_argument("--from", dest="start_s", type=float, default=0.0, metavar="S", help="of --plot (default 0)")
    parser.add_argument("--to", dest="end_s", type=float, metavar="S", help="of --plot (default: its end)")
    parser.set_defaults(command=_export)


def _export(options: argparse.Namespace) -> None:
    from ...files.recording.header import texts_of
    from ...files.recording.mcap_reader import open_recording
    from . import export
    from .picture import draw
    from .tables import tables

    if options.csv is options.hdf5 is options.parquet is options.plot is None:
        raise UsageError("No format is given: add --csv DIR, --hdf5 F.h5, --parquet DIR or --plot F.png, or several.")
    if options.hdf5 is not None:
        export.require("h5py")
    if options.parquet is not None:
        export.require("pyarrow")
    recording = open_recording(options.files)
    with progress_bar("reading") as recording.progress:
        found, texts = tables(recording), texts_of(recording.header)
    csv = options.csv, export.csv_files, export.to_csv
    parquet = options.parquet, export.parquet_files, export.to_parquet
    folders = [form for form in (csv, parquet) if form[0] is not None]
    written = [] if options.hdf5 is None else [options.hdf5]
    for folder, files_of, _ in folders:
        outputs.create_folder(folder)
        outputs.check(files_of(found, folder), inputs=options.files, is_forced=options.force)
        written += files_of(found, folder)
    if options.hdf5 is not None:
        export.to_hdf5(found, texts, options.hdf5)
    for folder, _, write in folders:
        write(found, texts, folder)
    if options.plot is not None:
        draw(found, options.plot, title=options.files[0].name, start_s=options.start_s, end_s=options.end_s)
        written.append(options.plot)
    for name, table in found.items():
        print(f"{name:<12} {len(table['t_ns']):>9} rows: {', '.join(table)}")
    print(f"written: {', '.join(map(str, written))}")
    _print_losses(recording.losses.report())


def _add_files(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files", nargs="+", type=Path, metavar="F.mcap", help="the recording; of one in parts all of them, in order"
    )


def _print_losses(losses: str) -> None:
    if losses:
        print(f"not whole: {losses}")
