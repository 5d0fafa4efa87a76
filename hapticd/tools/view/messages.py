"""Messages between page and server over the websocket, as JSON. Pure.

page -> server   {"op": "fingers", "fingers": {"1": [x_mm, y_mm, pressure_frac], ..}}   all held on the simulated pad
                 {"op": "record", "is_on": true}      record to a file of the viewer's, until false
server -> page   {"kind": "plate", ..} {"kind": "frame", ..} {"kind": "status", ..}
                 {"kind": "surfaces", ..}
                 {"kind": "recording", "is_on": true, "file": "..", "sentence": ""}
                 {"kind": "gone", "sentence": ".."} {"kind": "refused", "sentence": ".."}
                 {"kind": "starting", "sentence": ".."}      the service of a simulated plate starts
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
from msgspec import Meta
from msgspec.structs import asdict

from hapticd_contract.base import Contract, Name
from hapticd_contract.simulated import SimulatedTouch, problem_of_touches
from hapticd_contract.states import Perceived

from ...wire.client import read
from ..served_friction import served_curve
from ..web.sockets import decoded

if TYPE_CHECKING:
    from hapticd_client import FingerState, PlateEvent, PlateState

    from .rig import Truth

MAX_MESSAGE_BYTES = 4096
MAX_FINGERS = 16
CONTACT_RADIUS_MM = 5.0  # of a fingertip, where amplitudes count at points
LATENCIES = ("age", "compute", "link", "horizon")  # the daemon's histograms that the page draws
EVENT_FIELDS = ("kind", "finger", "x_mm", "y_mm", "client", "surface", "effect")
BOARD_FIELDS = ("ready", "state", "fault_code", "saturated", "limited", "deadman_trips", "late_frames", "drive_hz")


class _Message(Contract, frozen=True, tag_field="op"):
    """A page's message."""


class Hold(_Message, frozen=True, tag="fingers", rename={"touches": "fingers"}):
    """All fingers that this page holds on the simulated pad."""

    touches: Annotated[dict[Name, SimulatedTouch], Meta(max_length=MAX_FINGERS)]

    def problem(self) -> str:
        return problem_of_touches(self.touches)


class RecordPage(_Message, frozen=True, tag="record"):
    """Begin to record, or end it."""

    is_on: bool


Message = Hold | RecordPage


def decode(text: str) -> Message:
    """Decode a page's message. Raises RequestError."""
    message: Message = read(decoded(text), Message)
    return message


def frame(state: PlateState, truth: Truth | None, events: Iterable[PlateEvent] = ()) -> str:
    """Return one instant of the plate: the daemon's state, the events since the frame before, and on a simulated plate
    the ground truth."""
    return _text(
        {
            "kind": "frame",
            "t_s": state.t_ns * 1e-9,
            "instance": state.instance,
            "state": state.state,
            "fingers": [_finger(finger) for finger in state.fingers],
            "modal_um": list(zip(state.modal_um, state.modal_q_um or (0.0,) * len(state.modal_um), strict=False)),
            "measured_um": state.measured_d_q_um or (),
            "limited": state.limited,
            "misses_target": state.misses_target,
            "events": [{name: getattr(event, name) for name in EVENT_FIELDS} for event in events],
            "horizon_ms": state.horizon_ms,
            "truth": truth and asdict(truth),
        }
    )


def plate(body: Mapping[str, Any], simulated: str | None, person: str = "") -> str:
    """Return the plate's constants: sizes, limits, the name of a simulated plate, and whose friction curve it has.

    The page can touch a simulated one. Contacts are drawn with `contact_radius_mm`; with `has_contacts` amplitudes
    count over them.
    """
    contact_radius_mm, curve = body.get("contact_radius_mm", 0.0), served_curve(body)
    return _text(
        {
            "kind": "plate",
            "size_mm": body["size_mm"],
            "w_limit_um": body["w_limit_um"],
            "modes": body["modes"],
            "contact_radius_mm": contact_radius_mm or CONTACT_RADIUS_MM,
            "has_contacts": contact_radius_mm > 0.0,
            "simulated": simulated is not None,
            "name": simulated or "",
            "person": person,
            "friction_curve": [(um, curve.friction(um)) for _, um in reversed(curve.knots)],
        }
    )


def surfaces(layers: Sequence[Mapping[str, object]]) -> str:
    """Return the surfaces in force, topmost first (`surfaces.SurfacePainter`)."""
    return _text({"kind": "surfaces", "surfaces": list(layers)})


def status(body: Mapping[str, Any]) -> str:
    """Return the part of the daemon's status that the page shows."""
    timing, board = body["timing"], body["board"]
    histograms = timing["histograms"]
    return _text(
        {
            "kind": "status",
            "latency": {name: histograms[name] for name in LATENCIES if name in histograms},
            "board": {name: board.get(name) for name in BOARD_FIELDS},
            "undriven": board.get("refused") or board.get("lacking") or "",
            "missed_ticks": timing["missed_ticks"],
            "failed_passes": body.get("touch", {}).get("failed_passes", 0),
            "effects_playing": body.get("effects", {}).get("playing", 0),
            "late_frames": timing["late_frames"],
            "frames_hz": body["latency_ms"].get("frames_hz"),
        }
    )


def sentence(kind: str, text: str) -> str:
    """Return a message that is a sentence: that the service is "starting" or "gone", or that something is "refused"."""
    return _text({"kind": kind, "sentence": text})


def recording(file: str, *, is_on: bool, sentence: str = "") -> str:
    """Return the message that a recording to this file has begun, or how it ended."""
    return _text({"kind": "recording", "is_on": is_on, "file": file, "sentence": sentence})


def _finger(finger: FingerState) -> dict[str, object]:
    return {
        "id": finger.id,
        "seen_mm": [finger.x_mm, finger.y_mm],
        "predicted_mm": None
        if finger.predicted_x_mm is None or finger.predicted_y_mm is None
        else [finger.predicted_x_mm, finger.predicted_y_mm],
        "target_um": finger.target_um,
        "virtual": finger.virtual,
        "owner": finger.owner,
        **{name: getattr(finger, name) for name in Perceived.__struct_fields__},
    }


def _text(message: Mapping[str, object]) -> str:
    """Return a message as JSON, with null for what is not finite."""
    return msgspec.json.encode(message, enc_hook=float).decode()  # NumPy's, too
