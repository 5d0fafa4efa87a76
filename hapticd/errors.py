"""Errors of hapticd. Every message is one sentence: what is wrong, where, what to do."""

from __future__ import annotations

import re
import shlex
import sys
from enum import IntEnum
from pathlib import Path

CHECKOUT = Path(__file__).parents[1]


class ExitCode(IntEnum):
    """Exit codes of all commands; hapticd/tools/README.md explains them. One mistake has one code everywhere."""

    DONE = 0
    FAILED = 1
    WRONG_CALL = 2  # as argparse exits
    ALREADY_RUNNING = 75  # EX_TEMPFAIL: retry when the other daemon has ended
    WRONG_CONFIG = 78  # EX_CONFIG
    INTERRUPTED = 130  # 128 + SIGINT


class HapticdError(Exception):
    """Base class of all errors reported to the user. `exit_code` is that of the process."""

    exit_code = ExitCode.FAILED


class UsageError(HapticdError):
    """A command has an invalid argument, or an argument names an unusable file."""

    exit_code = ExitCode.WRONG_CALL


class ConfigError(HapticdError):
    """A configuration file has an unknown key, a wrong type, a value out of bounds or a missing file."""

    exit_code = ExitCode.WRONG_CONFIG


class ModesError(HapticdError):
    """A mode map cannot be read or is invalid."""

    exit_code = ExitCode.WRONG_CALL


class DeviceError(HapticdError):
    """The board cannot be opened, or its handshake was refused (version, protocol hash, modes, limits)."""


class SweepEndedError(DeviceError):
    """The board ended a sweep before its last point: it has a fault, or its dead-man timed out."""


class TrackpadError(HapticdError):
    """The trackpad cannot be found, opened or put into multitouch mode."""


class CalibrationError(HapticdError):
    """A measurement cannot be used: its file, arguments or result is invalid."""

    exit_code = ExitCode.WRONG_CALL


class AlreadyRunningError(HapticdError):
    """Another daemon holds the runtime directory."""

    exit_code = ExitCode.ALREADY_RUNNING


class RequestError(HapticdError):
    """A client's message was refused; the text is sent to the client."""


class RecordingError(HapticdError):
    """A recording cannot be read, replayed or written, or lacks the requested data."""

    exit_code = ExitCode.WRONG_CALL


class SimulationError(HapticdError, ValueError):
    """A simulated run has an unknown scenario or setting, or a value out of bounds."""

    exit_code = ExitCode.WRONG_CALL


def missing_library(need: str, extra: str) -> HapticdError:
    """Return the error for a `need` such as "A picture needs matplotlib", met by an extra of pyproject.toml."""
    libraries = requirements(extra)
    return HapticdError(f"{need}: run `{pip_install(*libraries)}`." if libraries else f"{need}.")


def requirements(extra: str = "") -> list[str]:
    """Return what an extra adds to the installation, or what every one has; empty for a copy without metadata.

    The libraries and not `hapticd[extra]`, for which pip would look on an index, and replace a checkout.
    """
    import platform  # not at the start of every command
    from importlib.metadata import PackageNotFoundError, requires

    try:
        split = [requirement.partition(";") for requirement in requires("hapticd") or ()]
    except PackageNotFoundError:
        return []
    here = {"extra": extra, "sys_platform": sys.platform, "platform_machine": platform.machine()}
    return [
        library.strip()
        for library, _, marker in split
        if ("extra" in marker) == bool(extra)
        and all(
            (here.get(name) == value) == (sign == "==")
            for name, sign, value in re.findall(r"(\w+) *([!=]=) *[\"']([^\"']*)", marker)
        )
    ]


def pip_install(*arguments: str) -> str:
    """Return the command that installs into the Python that runs: a bare `pip` may be that of another one."""
    return shlex.join((sys.executable, "-m", "pip", "install", *arguments))


def rebuild() -> str:
    """Return the command that compiles hapticd again: a checkout in place, else from one."""
    is_checkout = (CHECKOUT / "pyproject.toml").exists()
    return pip_install("--no-deps", *(["--editable", str(CHECKOUT)] if is_checkout else ["CHECKOUT_OF_HAPTICD"]))


def reason(error: Exception) -> str:
    """Return the system's message without error number and file name."""
    return str(getattr(error, "strerror", None) or error)
