"""The arguments of `hapticd study`. Light: what they set going is imported when it is called."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

SCHEMES = ("hapticd", "paper")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The actions run and report."""
    parser.epilog = (
        "example: hapticd study run --participant P03 --out answers/\n         hapticd study report answers/"
    )
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
    _add_run(actions)
    _add_report(actions)


def _add_run(actions: Any) -> None:
    parser = actions.add_parser(
        "run",
        help="hold one participant's session, or go on with it",
        description="Hold one participant's session: training, then trials. Left at any time (Ctrl-C), the same "
        "command goes on with it. Until the last answer, neither screen nor file says what was presented.",
        epilog="example: hapticd study run --participant P03 --out answers/ --browser",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--participant", required=True, metavar="NAME", help="letters, digits, - and _, such as P03")
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="the study's folder: a file for each")
    parser.add_argument("--trials", type=int, metavar="N", help="default 20, half of either friction")
    parser.add_argument("--seed", type=int, help="of the trials' order (default: a random one, kept in the file)")
    parser.add_argument("--browser", action="store_true", help="ask on a page in this machine's browser, not here")
    parser.add_argument("--page-port", type=int, default=0, metavar="PORT", help="of that page (default: any free one)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--sim", action="store_true", help="rehearse: on a simulated plate, whose finger moves itself")
    simulated = parser.add_argument_group("a simulated participant")
    simulated.add_argument("--simulate", action="store_true", help="let one answer, in virtual time")
    simulated.add_argument("--scheme", choices=SCHEMES, help="the control that it feels (default hapticd)")
    simulated.add_argument("--speed", type=float, metavar="MM_S", help="of its finger (default 100)")
    parser.set_defaults(command=_run)


def _add_report(actions: Any) -> None:
    parser = actions.add_parser(
        "report",
        help="judge all finished sessions of a folder",
        description="Success rates, their average and standard deviation, tests against guessing. Written beside the "
        "sessions: results.csv, trials.csv, figure-12.png. Sessions that are not finished stay blind.",
        epilog="example: hapticd study report answers/ --json -",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=Path, metavar="DIR", help="the --out of the sessions")
    parser.add_argument("--json", metavar="F", help="write the figures as JSON; - is standard output")
    parser.set_defaults(command=_report)


def _run(options: argparse.Namespace) -> None:
    from . import run

    run.hold(
        run.Wishes(
            participant=options.participant,
            folder=options.out,
            trials=options.trials,
            seed=options.seed,
            endpoint=options.endpoint,
            sim=options.sim,
            browser=options.browser,
            page_port=options.page_port,
            simulate=options.simulate,
            scheme=options.scheme,
            speed_mm_s=options.speed,
        )
    )


def _report(options: argparse.Namespace) -> None:
    from . import report

    report.write(options.folder, options.json)
