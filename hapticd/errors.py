"""What can go wrong, named by what happened. Every message is one sentence: what, where, what to do."""


class HapticdError(Exception):
    """Root of all errors that hapticd raises for its user. `exit_code` is the process's (sysexits.h)."""

    exit_code = 1


class UsageError(HapticdError):
    """An argument of a command cannot be."""

    exit_code = 2


class ConfigError(HapticdError):
    """A configuration file has an unknown key, a wrong type, a value out of bounds or names a missing file."""

    exit_code = 78  # EX_CONFIG


class ModesError(HapticdError):
    """A mode-shape file cannot be read or does not describe mode shapes."""


class DeviceError(HapticdError):
    """The board cannot be opened, or its handshake was refused (version, protocol hash, modes, limits)."""


class SweepEndedError(DeviceError):
    """The board ended a sweep before its last point: it has a fault, or did not hear from us for too long."""


class TrackpadError(HapticdError):
    """The trackpad cannot be found, opened or put into multitouch mode."""


class CalibrationError(HapticdError):
    """A measurement cannot be used as it is: its file, its arguments or what it shows."""

    exit_code = 2


class AlreadyRunningError(HapticdError):
    """Another daemon holds the runtime directory."""

    exit_code = 75  # EX_TEMPFAIL: try again when the other one has ended


class RequestError(HapticdError):
    """A client's message was refused; the text is sent back to it."""


class RecordingError(HapticdError):
    """A recording cannot be read, replayed or written, or is asked for what it does not hold."""

    exit_code = 2


class SimulationError(HapticdError, ValueError):
    """A simulated run is asked for that cannot be: unknown scenario or setting, or a value out of bounds."""

    exit_code = 64  # EX_USAGE


def reason(error: Exception) -> str:
    """What the system says of it; number and file are left to the sentence around it."""
    return str(getattr(error, "strerror", None) or error)
