"""`hapticd run`."""

from __future__ import annotations

import argparse

from .. import config
from . import configured


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which configuration."""
    configured.add_arguments(parser)
    parser.add_argument("--print-config", action="store_true", help="print the configuration in force, and end")
    parser.set_defaults(command=_run)


def _run(options: argparse.Namespace) -> None:
    loaded = configured.configuration(options)
    if options.print_config:
        print(config.render(loaded), end="")
        return
    from .. import service

    configured.log_to_stderr(loaded.log.level)
    service.run(loaded, lambda: configured.configuration(options))
