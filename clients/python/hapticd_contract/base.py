"""Parts of all messages: the base class, and the bounds that several fields share."""

from __future__ import annotations

import math
from typing import Annotated, Final

from msgspec import Meta, Struct

PROTOCOL_VERSION: Final = 1
MAX_MESSAGE_BYTES: Final = 65536
MAX_PART_BYTES: Final = 128 * 128  # of an asset, or the levels of a map within a message
MAX_AMPLITUDE_UM: Final = 1000.0
MAX_POSITION_MM: Final = 1000.0
MAX_WHOLE: Final = 2**63 - 1
MAX_ID: Final = 2**32 - 1
DIGEST_BYTES: Final = 32

AmplitudeUm = Annotated[float, Meta(ge=0.0, le=MAX_AMPLITUDE_UM)]
SignedUm = Annotated[float, Meta(ge=-MAX_AMPLITUDE_UM, le=MAX_AMPLITUDE_UM)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
PeriodMm = Annotated[float, Meta(ge=0.1, le=1000.0)]
AngleRad = Annotated[float, Meta(ge=-2.0 * math.pi, le=2.0 * math.pi)]
Mm = Annotated[float, Meta(ge=-MAX_POSITION_MM, le=MAX_POSITION_MM)]
Place = tuple[Mm, Mm]
Name = Annotated[str, Meta(min_length=1, max_length=32)]  # of printable characters
FingerId = Annotated[int, Meta(ge=1, le=MAX_ID)]
Whole = Annotated[int, Meta(ge=0, le=MAX_WHOLE)]
Digest = Annotated[bytes, Meta(min_length=DIGEST_BYTES, max_length=DIGEST_BYTES)]
Key = FingerId | Name  # a finger on the plate, or a virtual one


class Contract(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Message of a client: unknown fields are refused, and fields at their default are not sent."""

    def problem(self) -> str:
        """Return what is wrong between fields whose own bounds hold, empty for nothing: the place behind this one's,
        such as `.release`, and a sentence."""
        return ""


def problem_of_name(name: str, place: str) -> str:
    """Return what is wrong with a name whose length is right; empty for nothing."""
    return "" if name.isprintable() else f"{place}: must have 1 .. 32 printable characters."
