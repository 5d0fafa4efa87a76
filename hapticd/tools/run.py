"""`hapticd run`."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import cast

from ..config import loader as config
from . import configured

OPENSSL = ("_ssl", "_hashlib")  # what loads it


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which configuration, and whether it shall run."""
    configured.add_arguments(parser)
    parser.add_argument("--print-config", action="store_true", help="print the configuration in force, and end")
    parser.add_argument("--check", action="store_true", help="read all that it names, say what is wrong, and end")
    parser.set_defaults(command=_run)


def _run(options: argparse.Namespace) -> None:
    loaded = configured.configuration(options)
    if options.print_config:
        print(config.render(loaded), end="")
        return
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # nothing here is large enough for numpy's threads
    with without_openssl():
        from ..daemon import service
    if options.check:
        service.check(loaded)
        return
    configured.log_to_stderr(loaded.log.level)
    service.run(loaded, lambda: configured.configuration(options), judge=_check_command(options))


@contextmanager
def without_openssl() -> Iterator[None]:
    """Import as if Python had been built without it: nobody speaks TLS here, and it takes 4 MB."""
    hidden = [name for name in OPENSSL if name not in sys.modules]
    modules = cast("dict[str, ModuleType | None]", sys.modules)
    modules.update(dict.fromkeys(hidden))
    try:
        yield
    finally:
        for name in hidden:
            del modules[name]


def _check_command(options: argparse.Namespace) -> list[str]:
    """`hapticd run --check` on what these options name."""
    config_file = [] if options.config is None else ["--config", str(options.config)]
    return [sys.executable, "-m", "hapticd", "run", "--check", *config_file, *(["--sim"] if options.sim else [])]
