"""`hapticd install-service`."""

from __future__ import annotations

import argparse
from pathlib import Path

from . import installation


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Where to."""
    parser.add_argument("--print", action="store_true", help="show the files and where they go, and change nothing")
    parser.add_argument("--root", type=Path, default=Path("/"), help="install below this directory (default /)")
    parser.set_defaults(command=_install_service)


def _install_service(options: argparse.Namespace) -> None:
    files = installation.service_files()
    print(installation.listing(files) if options.print else installation.install(files, options.root), end="")
