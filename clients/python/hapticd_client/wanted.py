"""All that one client wants: one message, which replaces the client's message before."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import msgpack

from .errors import RefusedError
from .messages import PROTOCOL_VERSION
from .targets import Fields

Key = int | str

# --- which of two messages is the older -------------------------------------------------------------------------


def stamp_now() -> Fields:
    """When something came to be wanted, for the daemon to drop what is older: refreshes keep the stamp they had."""
    return {"stamp": time.monotonic_ns()}


def no_stamp() -> Fields:
    """For a daemon that knows no stamps."""
    return {}


# --- what is wanted ---------------------------------------------------------------------------------------------

MAX_TARGETS = 16
MAX_VIRTUALS = 16
MAX_MESSAGE_BYTES = 65536
DEFAULT_TTL_S = 0.5


@dataclass(frozen=True, slots=True)
class Wanted:
    """Targets by finger and paths by name, as sent, and the time to live asked for each."""

    targets: Mapping[Key, Fields] = field(default_factory=dict)
    virtuals: Mapping[str, Fields] = field(default_factory=dict)
    ttls_s: Mapping[Key, float] = field(default_factory=dict)

    @property
    def is_empty(self) -> bool:
        """Nothing is wanted."""
        return not self.targets and not self.virtuals

    @property
    def ttl_s(self) -> float:
        """One message has one time to live: the shortest asked for."""
        return min(self.ttls_s.values(), default=DEFAULT_TTL_S)

    def with_target(self, key: Key, target: Fields, ttl_s: float) -> Wanted:
        """The same with another target for one finger."""
        if key not in self.targets and len(self.targets) >= MAX_TARGETS:
            raise RefusedError(f"set: a client may hold {MAX_TARGETS} fingers at once: release one first.")
        return replace(self, targets={**self.targets, key: target}, ttls_s={**self.ttls_s, key: ttl_s})

    def with_virtual(self, name: str, path: Fields, ttl_s: float) -> Wanted:
        """The same with another path for one virtual finger."""
        if name not in self.virtuals and len(self.virtuals) >= MAX_VIRTUALS:
            raise RefusedError(f"virtual: a client may have {MAX_VIRTUALS} virtual fingers: release one first.")
        return replace(self, virtuals={**self.virtuals, name: path}, ttls_s={**self.ttls_s, name: ttl_s})

    def without(self, *keys: Key) -> Wanted:
        """The same with nothing for these fingers."""
        return Wanted(
            {key: target for key, target in self.targets.items() if key not in keys},
            {name: path for name, path in self.virtuals.items() if name not in keys},
            {key: ttl_s for key, ttl_s in self.ttls_s.items() if key not in keys},
        )

    def fields(self, client: str, stamp: Fields) -> Fields:
        """The message's fields, its version excepted; `stamp` is when this came to be wanted, as a field, or empty."""
        return {
            "client": client,
            **stamp,
            "ttl_s": self.ttl_s,
            "targets": [{"finger": key, **target} for key, target in self.targets.items()],
            "virtuals": [{"name": name, **path} for name, path in self.virtuals.items()],
        }

    def payload(self, client: str, stamp: Fields) -> bytes:
        """The message for the `targets` socket. Raises RefusedError where the daemon would not read so much."""
        payload = bytes(msgpack.packb({"v": PROTOCOL_VERSION, **self.fields(client, stamp)}))
        # A request wraps the same fields in an envelope of less than a hundred bytes.
        if len(payload) > MAX_MESSAGE_BYTES - 100:
            raise RefusedError(
                f"All targets together take {len(payload)} of {MAX_MESSAGE_BYTES} bytes: use smaller maps."
            )
        return payload
