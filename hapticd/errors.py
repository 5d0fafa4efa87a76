"""Errors of hapticd. Every message is one sentence: what is wrong, where, what to do."""

from __future__ import annotations

from enum import IntEnum


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
    return HapticdError(f'{need}: run `pip install ".[{extra}]"` in the checkout of hapticd.')


def missing_client(need: str) -> HapticdError:
    """Return the error for what needs the client library."""
    return HapticdError(
        f"{need} needs the client library: run `pip install clients/python` in the checkout of hapticd."
    )


def reason(error: Exception) -> str:
    """Return the system's message without error number and file name."""
    return str(getattr(error, "strerror", None) or error)
