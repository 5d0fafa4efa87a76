"""`hapticd run`: the service in the foreground, with the arguments that other commands share."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import cast

from ..config import loader as config
from ..config.sections import SIMULATED, Config
from . import glass, simulated_fingers

log = logging.getLogger("hapticd")

OPENSSL = ("_ssl", "_hashlib")  # the modules that load it
STDERR = 2  # the descriptor


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_config_arguments(parser)
    parser.add_argument("--print-config", action="store_true", help="print the active configuration, and exit")
    parser.add_argument("--check", action="store_true", help="read all files it names, report errors, and exit")
    simulated_fingers.add_arguments(parser, "strokes, of two fingers")
    parser.set_defaults(command=_run)


def add_config_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --config and --sim, for the commands that serve devices."""
    parser.add_argument("--config", type=Path, help="the service's configuration (default: the simulated plate)")
    parser.add_argument(
        "--sim", action="store_true", help="serve the simulated plate instead of the configured devices"
    )
    glass.add_arguments(parser)


def configuration(options: argparse.Namespace) -> Config:
    """Read the configuration of --config, --sim and the simulated plate's options. Raises ConfigError, UsageError."""
    loaded = config.load(options.config) if options.config is not None else Config()
    if options.sim:
        loaded = config.simulated(loaded)
    return replace(loaded, sim=glass.chosen(options, loaded.sim, is_simulated=loaded.device.port == SIMULATED))


def _configuration(options: argparse.Namespace) -> Config:
    """Return the same with the fingers of --scenario. Raises ConfigError, UsageError."""
    loaded = configuration(options)
    is_simulated = loaded.trackpad.source == SIMULATED
    return replace(loaded, sim=simulated_fingers.chosen(options, loaded.sim, is_simulated=is_simulated))


def log_to_stderr(level: str) -> None:
    """Log to stderr: lines with the time for a terminal, in the journal's own format for the journal."""
    from ..io.host.journal import JournalHandler
    from ..io.host.systemd import JournalFormatter, is_journal_stream

    handler = JournalHandler()
    plain = logging.Formatter("%(asctime)s %(levelname)s %(message)s", "%H:%M:%S")
    handler.setFormatter(JournalFormatter() if is_journal_stream(STDERR) else plain)
    logging.basicConfig(level=level.upper(), handlers=[handler])


def _run(options: argparse.Namespace) -> None:
    loaded = _configuration(options)
    if options.print_config:
        print(config.render(loaded), end="")
        return
    with without_openssl():
        from . import service
    if options.check:
        service.check(loaded)
        return
    log_to_stderr(loaded.log.level)
    _announce(loaded, is_meant=options.sim)
    service.run(loaded, lambda: _configuration(options), judge=_check_command(options))


def _announce(loaded: Config, *, is_meant: bool) -> None:
    """Log first what is simulated, which takes a second to start; a warning if no one asked for it."""
    found = {"device.port": loaded.device.port, "trackpad.source": loaded.trackpad.source}
    simulated = [key for key, value in found.items() if value == SIMULATED]
    if is_meant:
        log.info("starting the simulated plate")
    elif simulated and not loaded.sim.rig_dir:
        log.warning(
            "SIMULATED: %s not configured, so no hardware is driven. Set %s in a file (`hapticd calibrate` "
            "writes one) and name it with --config; --sim says that the simulation is meant",
            f"{' and '.join(simulated)} {'is' if len(simulated) == 1 else 'are'}",
            "it" if len(simulated) == 1 else "them",
        )


@contextmanager
def without_openssl() -> Iterator[None]:
    """Context in which imports find no OpenSSL: the service uses no TLS, and the library takes 4 MB."""
    hidden = [name for name in OPENSSL if name not in sys.modules]
    modules = cast("dict[str, ModuleType | None]", sys.modules)
    modules.update(dict.fromkeys(hidden))
    try:
        yield
    finally:
        for name in hidden:
            del modules[name]


def _check_command(options: argparse.Namespace) -> list[str]:
    """Return the command `hapticd run --check` with these options."""
    command = [sys.executable, "-P", "-m", "hapticd", "run", "--check", *(["--sim"] if options.sim else [])]
    for name in ("config", "plate", "copy", "modes", "wiring", "scenario"):
        if (value := getattr(options, name)) is not None:
            command += [f"--{name}", str(value)]
    return command
