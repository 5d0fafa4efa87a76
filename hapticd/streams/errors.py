"""What can be wrong with a stream's arguments."""

from __future__ import annotations

from ..errors import ConfigError


class UsageError(ConfigError):
    """An argument that cannot be, or an address that cannot be had."""

    exit_code = 2
