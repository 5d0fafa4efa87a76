"""The arguments of `hapticd view`. Light: what they set going is imported when it is called."""

from __future__ import annotations

import argparse

PORT = 8017


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Whose plate, and where its page is."""
    parser.add_argument("--sim", action="store_true", help="start a simulated plate and a service for it as well")
    parser.add_argument(
        "--scenario", metavar="NAME", help="what its fingers do until you touch it (default hands: nothing)"
    )
    parser.add_argument("--seed", type=int, default=1, help="of its fingers, noise and cartography (default 1)")
    parser.add_argument("--endpoint", metavar="DIR", help="the service's runtime directory (default: found)")
    parser.add_argument("--port", type=int, default=PORT, help=f"of the page on this computer, 0: any (default {PORT})")
    parser.add_argument("--no-browser", action="store_true", help="print the page's address, and open nothing")
    parser.set_defaults(command=_view)


def _view(options: argparse.Namespace) -> None:
    from . import program

    program.run(
        simulate=options.sim,
        scenario=options.scenario,
        seed=options.seed,
        endpoint=options.endpoint,
        port=options.port,
        open_browser=not options.no_browser,
    )
