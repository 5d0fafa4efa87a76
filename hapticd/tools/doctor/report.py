"""All checks in their order, told as lines for people or as JSON for programs."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from ...config import loader as configuration
from ...config.sections import Config
from ...errors import HapticdError
from . import devices, files, host, service
from .finding import FAIL, PASS, WARN, Finding, Patient

CHECKS: tuple[Callable[[Patient], Finding], ...] = (
    files.modes,
    files.calibrated,
    files.recordings,
    files.key_ring,
    host.built,
    host.client_library,
    service.daemon,
    service.health,
    service.alone,
    host.rules,
    host.groups,
    devices.trackpad,
    devices.rate,
    devices.board,
    devices.firmware,
    host.real_time,
    host.clock,
    host.governor,
)
SERVICE_CONFIG = Path("etc/hapticd/hapticd.toml")
SHOW_KEYS = "hapticd run --print-config shows every key; mend the file"


def examine(config_path: Path | None, *, as_json: bool = False, bundle: Path | None = None) -> int:
    """Print the report, and write `bundle` where one is asked for. Returns 1 if something fails, else 0."""
    if bundle is not None:
        from .bundle import check_name

        check_name(bundle)
    found: list[Finding] = []
    patient = None
    for finding, patient in _findings(config_path):  # noqa: B007 - the last one is asked for below
        found.append(finding)
        if not as_json:
            print(finding, flush=True)
    if as_json:
        print(as_document(found))
    if bundle is not None:
        from .bundle import collect

        told = sys.stderr if as_json else sys.stdout
        print("collecting, with 10 s of recording if a daemon runs ...", file=sys.stderr, flush=True)
        print(collect(bundle, patient, config_path, found), file=told)
    return int(has_failed(found))


def as_document(found: Sequence[Finding]) -> str:
    """The report as JSON: the findings in order, and whether one of them failed."""
    return json.dumps({"failed": has_failed(found), "findings": [asdict(one) for one in found]}, indent=2)


def has_failed(found: Sequence[Finding]) -> bool:
    """Whether one finding is a failure."""
    return any(one.verdict == FAIL for one in found)


def configured(config_path: Path | None, root: Path) -> Finding:
    """Of a valid configuration: which one it is, and whether the service has another."""
    if config_path is not None:
        return Finding(PASS, "configuration", f"{config_path} is valid")
    of_service = root / SERVICE_CONFIG
    if of_service.exists():
        said = f"the built-in one, while the service has {of_service}"
        return Finding(WARN, "configuration", said, f"hapticd doctor --config {of_service}")
    return Finding(PASS, "configuration", "the built-in one is valid")


def _findings(config_path: Path | None) -> Iterator[tuple[Finding, Patient | None]]:
    try:
        config = configuration.load(config_path) if config_path is not None else Config()
    except HapticdError as error:
        yield Finding(FAIL, "configuration", str(error), SHOW_KEYS), None
        return
    patient = service.met(config, os.environ)
    yield configured(config_path, patient.root), patient
    for check in CHECKS:
        yield check(patient), patient
