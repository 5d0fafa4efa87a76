"""OSC datagrams as TUIO trackers send them, for tests."""

from __future__ import annotations

import struct
from collections.abc import Sequence

Argument = int | float | str
_FORMATS = {"h": "q"}


def text(value: str) -> bytes:
    data = value.encode() + b"\0"
    return data + bytes(-len(data) % 4)


def message(address: str, *arguments: Argument, times: Sequence[int] = (), kinds: str = "") -> bytes:
    """`times`: which arguments are time tags, in ns; `kinds`: the types of all, where they are not the usual ones."""
    types, data = ",", b""
    for place, value in enumerate(arguments):
        if place in times:
            assert isinstance(value, int)
            types, data = types + "t", data + struct.pack(">II", *_ntp(value))
        elif isinstance(value, str):
            types, data = types + "s", data + text(value)
        else:
            kind = kinds[place : place + 1] or ("i" if isinstance(value, int) else "f")
            types, data = types + kind, data + struct.pack(f">{_FORMATS.get(kind, kind)}", value)
    return text(address) + text(types) + data


def bundle(*messages: bytes) -> bytes:
    return b"#bundle\0" + struct.pack(">Q", 1) + b"".join(struct.pack(">I", len(one)) + one for one in messages)


def tuio1(frame: int, places: dict[int, tuple[float, float]], source: str = "tracker") -> bytes:
    return bundle(
        message("/tuio/2Dcur", "source", source),
        message("/tuio/2Dcur", "alive", *places),
        *[message("/tuio/2Dcur", "set", number, x, y, 0.0, 0.0, 0.0) for number, (x, y) in places.items()],
        message("/tuio/2Dcur", "fseq", frame),
    )


def tuio2(frame: int, t_ns: int, places: dict[int, tuple[float, float]]) -> bytes:
    return bundle(
        message("/tuio2/frm", frame, t_ns, 640 << 16 | 480, "tracker", times=(1,)),
        *[message("/tuio2/ptr", n, 0, 0, x, y, 0.0, 0.0, 0.01, 0.5) for n, (x, y) in places.items()],
        message("/tuio2/alv", *places),
    )


def _ntp(t_ns: int) -> tuple[int, int]:
    second_s, rest_ns = divmod(t_ns, 1_000_000_000)
    return second_s, -(-(rest_ns << 32) // 1_000_000_000)
