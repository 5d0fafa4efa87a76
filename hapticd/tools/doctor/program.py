"""`hapticd doctor`: all checks in order, printed as lines or as JSON."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from ...config import loader as configuration
from ...config.sections import Config
from ...errors import HapticdError
from .. import latency, outputs
from ..arguments import add_command
from . import bundle as bundles
from . import devices, files, host, service
from .finding import FAIL, PASS, WARN, CheckResult, System, as_document, has_failed

CHECKS: dict[str, Callable[[System], CheckResult]] = {
    "mode shapes": files.modes,
    "calibration": files.calibrated,
    "recordings": files.recordings,
    "TCP": files.key_ring,
    "simulated board": host.built,
    "daemon": service.daemon,
    "state": service.health,
    "other daemons": service.alone,
    "udev rules": host.rules,
    "groups": host.groups,
    "trackpad": devices.trackpad,
    "report rate": devices.rate,
    "board": devices.board,
    "firmware": devices.firmware,
    "drive": devices.drive,
    "real time": host.real_time,
    "clock": host.clock,
    "processor": host.governor,
}
CONFIGURATION = "configuration"  # the check before all others: without a valid one there is no other
SERVICE_CONFIG = Path("etc/hapticd/hapticd.toml")
SHOW_KEYS = "hapticd run --print-config shows every key; correct the file"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = f"{parser.epilog}\n         hapticd doctor --bundle report.tar.gz"
    parser.add_argument("--config", type=Path, help="the service's configuration (default: the built-in one)")
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    outputs.add_file(
        parser,
        "--bundle",
        bundles.SUFFIX,
        metavar="F.tar.gz",
        help="collect findings, configuration, status, log, versions and 10 s of recording; nothing is sent",
    )
    parser.set_defaults(command=_doctor)
    actions = parser.add_subparsers(title="actions", metavar="ACTION")
    measured = "measure each delay from report to plate on the connected devices"
    latency.add_arguments(add_command(actions, "latency", measured, "--sim --seconds 10 --plot delays.png"))


def _doctor(options: argparse.Namespace) -> int:
    return examine(options.config, as_json=options.json, bundle=options.bundle)


def examine(config_path: Path | None, *, as_json: bool = False, bundle: Path | None = None) -> int:
    """Print the report, and write `bundle` if given. Return 1 if a check fails, else 0."""
    found: list[CheckResult] = []
    system = None
    for finding, system in _findings(config_path):  # noqa: B007 - the last one is used below
        found.append(finding)
        if not as_json:
            print(finding, flush=True)
    if as_json:
        print(as_document(found))
    if bundle is not None:
        print("collecting, with 10 s of recording if a daemon runs ...", file=sys.stderr, flush=True)
        contents = bundles.collect(bundle, system, config_path, found)
        print(contents, file=sys.stderr if as_json else sys.stdout)
    return int(has_failed(found))


def configured(config_path: Path | None, root: Path) -> CheckResult:
    """Report which valid configuration is checked, and whether the service has another."""
    if config_path is not None:
        return CheckResult(PASS, f"{config_path} is valid")
    of_service = root / SERVICE_CONFIG
    if of_service.exists():
        text = f"the built-in one, while the service uses {of_service}"
        return CheckResult(WARN, text, f"hapticd doctor --config {of_service}")
    return CheckResult(PASS, "the built-in one is valid")


def _findings(config_path: Path | None) -> Iterator[tuple[CheckResult, System | None]]:
    try:
        config = configuration.load(config_path) if config_path is not None else Config()
    except HapticdError as error:
        yield CheckResult(FAIL, str(error), SHOW_KEYS, check=CONFIGURATION), None
        return
    system = service.find(config, os.environ)
    yield replace(configured(config_path, system.root), check=CONFIGURATION), system
    for name, check in CHECKS.items():
        yield replace(check(system), check=name), system
