"""`hapticd study`: the distribution of clients/study, where it is installed."""

from __future__ import annotations

import argparse

from ..errors import CHECKOUT, HapticdError, pip_install

PARTS = ("clients/python", "clients/study")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    try:
        from hapticd_study import program
    except ModuleNotFoundError as error:
        if error.name != "hapticd_study":
            raise
        parser.add_argument("arguments", nargs=argparse.REMAINDER, help="those of hapticd-study")
        parser.set_defaults(command=_missing)
    else:
        program.add_arguments(parser)


def _missing(_: argparse.Namespace) -> None:
    folder = CHECKOUT if (CHECKOUT / "clients").is_dir() else "CHECKOUT_OF_HAPTICD"
    command = pip_install(*(f"{folder}/{part}" for part in PARTS))
    raise HapticdError(f"`hapticd study` is a distribution of its own, which is not installed: run `{command}`.")
