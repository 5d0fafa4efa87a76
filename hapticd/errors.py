"""Errors of hapticd. Every message is one sentence: what is wrong, where, what to do."""


class HapticdError(Exception):
    """Base class of all errors reported to the user. `exit_code` is that of the process (hapticd/tools/README.md)."""

    exit_code = 1


class UsageError(HapticdError):
    """A command has an invalid argument, or an argument names an unusable file."""

    exit_code = 2


class ConfigError(HapticdError):
    """A configuration file has an unknown key, a wrong type, a value out of bounds or a missing file."""

    exit_code = 78  # EX_CONFIG


class ModesError(HapticdError):
    """A mode map cannot be read or is invalid."""

    exit_code = 2


class DeviceError(HapticdError):
    """The board cannot be opened, or its handshake was refused (version, protocol hash, modes, limits)."""


class SweepEndedError(DeviceError):
    """The board ended a sweep before its last point: it has a fault, or its dead-man timed out."""


class TrackpadError(HapticdError):
    """The trackpad cannot be found, opened or put into multitouch mode."""


class CalibrationError(HapticdError):
    """A measurement cannot be used: its file, arguments or result is invalid."""

    exit_code = 2


class AlreadyRunningError(HapticdError):
    """Another daemon holds the runtime directory."""

    exit_code = 75  # EX_TEMPFAIL: retry when the other daemon has ended


class RequestError(HapticdError):
    """A client's message was refused; the text is sent to the client."""


class RecordingError(HapticdError):
    """A recording cannot be read, replayed or written, or lacks the requested data."""

    exit_code = 2


class SimulationError(HapticdError, ValueError):
    """A simulated run has an unknown scenario or setting, or a value out of bounds."""

    exit_code = 2


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
