"""What commands that take the service's configuration have in common."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

from ..config import loader as config
from ..config.sections import Config

STDERR = 2  # the descriptor


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """--config and --sim."""
    parser.add_argument("--config", type=Path, help="the service's configuration (default: the simulated plate)")
    parser.add_argument("--sim", action="store_true", help="take the simulated plate, whatever the configuration says")


def configuration(options: argparse.Namespace) -> Config:
    """What --config and --sim say; read anew at each call. Raises ConfigError."""
    loaded = config.load(options.config) if options.config is not None else Config()
    return config.simulated(loaded) if options.sim else loaded


def log_to_stderr(level: str) -> None:
    """Lines for a person at a terminal, with the time; for the journal with what it asks for."""
    from ..io.host.journal import JournalHandler
    from ..io.host.systemd import JournalFormatter, is_journal_stream

    handler = JournalHandler()
    plain = logging.Formatter("%(asctime)s %(levelname)s %(message)s", "%H:%M:%S")
    handler.setFormatter(JournalFormatter() if is_journal_stream(STDERR) else plain)
    logging.basicConfig(level=level.upper(), handlers=[handler])
