"""`hapticd demo`."""

from __future__ import annotations

import argparse
from pathlib import Path

from . import program as demo


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """How long, which fingers, which board."""
    parser.add_argument("--seconds", type=float, default=10.0, help="how long the fingers move (default 10)")
    parser.add_argument("--seed", type=int, default=1, help="of fingers, noise and cartography (default 1)")
    parser.add_argument("--out", type=Path, default=Path("demo.png"), help="where the picture goes (default demo.png)")
    parser.add_argument(
        "--board",
        choices=("library", "host"),
        default="library",
        help="the firmware's core within the rig (default), or its whole program as a process",
    )
    parser.add_argument("--image", type=Path, metavar="FILE", help="that program (default: built by make -C firmware)")
    parser.add_argument("--view", action="store_true", help="open the plate's page in the browser meanwhile")
    parser.set_defaults(command=_demo)


def _demo(options: argparse.Namespace) -> int:
    return demo.show(
        options.seconds,
        options.seed,
        options.out,
        board=options.board,
        image=options.image,
        in_browser=options.view,
    )
