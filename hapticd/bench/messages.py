"""Run time of what clients cost the daemon at its rim: the bytes of a request decoded, those of a state encoded."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from msgspec.structs import asdict

from hapticd_contract.contents import Amplitude, Friction, Grating
from hapticd_contract.states import FingerState, Perceived, PlateState
from hapticd_contract.surfaces import VirtualPath
from hapticd_contract.targets import ClientTargets

from ..wire.client import decode_targets, encode_state, encode_targets
from .tables import Table, finite_rows
from .timing import compare

DECODE, ENCODE = "decode four targets", "encode telemetry"
CALLS = 1000

TARGETS = ClientTargets.of(
    "study-7",
    500_000_000,
    {3: Amplitude(1.0), 4: Friction(1.0), 5: Grating(6.0, 2.0, duty_frac=0.5), "walker": Amplitude(0.0)},
    {"walker": VirtualPath(((-40.0, 20.0), (40.0, 20.0)), 80.0)},
    stamp=81_234_567_890_123,
)
PERCEIVED = Perceived(friction_change=0.62, weber_frac=0.94, contact_um=0.78, felt_friction=0.39, error_jnd=5.6)


def table(repeats: int) -> Table:
    """Time a message of four targets with a virtual finger, and a state of two fingers with all that they feel."""
    calls: dict[str, Callable[[], object]] = {
        DECODE: partial(decode_targets, encode_targets(TARGETS)),
        ENCODE: lambda: encode_state(_state()),
    }
    timings = compare({name: (partial(_repeated, call), CALLS) for name, call in calls.items()}, repeats)
    return Table(
        name="messages",
        title="tick: messages of clients",
        default=DECODE,
        rows=finite_rows([(name, timing.figures("hot")) for name, timing in timings.items()]),
        compared=(),
    )


def _repeated(call: Callable[[], object]) -> None:
    for _ in range(CALLS):
        call()


def _state() -> PlateState:
    fingers = [
        FingerState(finger_id, -20.5, 4.0, -18.9, 4.1, 1.0, 1.0, False, "study-7", **asdict(PERCEIVED))
        for finger_id in (3, 4)
    ]
    return PlateState(
        *(7234, 512, 81_234_567_890_123, "ACTIVE", tuple(fingers), (1.9, -0.7), False, 10.4, 16.1),
        modal_q_um=(0.0, 0.0),
        measured_d_q_um=((1.88, 0.01), (-0.69, 0.0)),
        surfaces_version=7,
        tick_late_ms=0.1,
        missed_ticks=0,
        pauses=0,
    )
