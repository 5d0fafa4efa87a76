"""`hapticd stream lsl`: fingers, modes and markers as outlets of the Lab Streaming Layer.

Three streams, each sample with the daemon's own time: LSL's clock is the host's monotonic clock, as the daemon's is.
Each stream's description holds units and meanings, as LSL's recorders expect them. pylsl is passed in, so that tests
need no liblsl.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from hapticd_client import PlateState

from .samples import FINGER_FIELDS, MODE_FIELDS, Slots, finger_values, mode_values
from .states import serve

# Units as spelt in the metadata of XDF, the format of LSL's recordings.
RATIOS = ("change", "frac", "friction")
UNITS = {
    "mm": "millimeters",
    "mm2": "square millimeters",
    "um": "micrometers",
    "rad": "radians",
    "jnd": "JND",
    "target": "ratio",
    **dict.fromkeys(RATIOS, "ratio"),
}
MAKER = "hapticd"


class Channel(NamedTuple):
    """One channel's description."""

    label: str
    unit: str
    kind: str


def finger_channels(fingers: int) -> tuple[Channel, ...]:
    """Return, for each slot 1 .. `fingers`, the finger's id and FINGER_FIELDS."""
    channels = []
    for place in range(1, fingers + 1):
        channels.append(Channel(f"finger_{place}_id", "none", "Id"))
        channels += [Channel(f"finger_{place}_{name}", _unit(name), _kind(name)) for name in FINGER_FIELDS]
    return tuple(channels)


def mode_channels(modes: int) -> tuple[Channel, ...]:
    """Return MODE_FIELDS of each mode."""
    return tuple(Channel(f"mode_{m}_{name}", _unit(name), "Amplitude") for m in range(modes) for name in MODE_FIELDS)


class Outlets:
    """The three outlets of one plate. `lsl` is pylsl or a substitute; `clock_offset_s` is LSL's clock minus the
    daemon's."""

    def __init__(self, lsl: Any, source: str, fingers: int, modes: int, clock_offset_s: float) -> None:
        self.modes = modes
        self._slots = Slots(fingers)
        self._offset_s = clock_offset_s
        self._fingers = _outlet(lsl, "fingers", "MoCap", finger_channels(fingers), source)
        self._modes = _outlet(lsl, "modes", "Haptics", mode_channels(modes), source)
        self._markers = _outlet(lsl, "markers", "Markers", (Channel("marker", "none", "Marker"),), source)

    def push(self, state: PlateState) -> None:
        """Push one sample of fingers and modes, and one for each marker: "CLIENT: TEXT"."""
        t_s = state.t_ns / 1e9 + self._offset_s
        self._fingers.push_sample([one for finger in self._slots.fingers(state) for one in finger_values(finger)], t_s)
        self._modes.push_sample([one for mode in range(self.modes) for one in mode_values(state, mode)], t_s)
        for marker in state.markers:
            self._markers.push_sample([f"{marker.client}: {marker.text}"], marker.t_ns / 1e9 + self._offset_s)


def run(lsl: Any, endpoint: str | None, fingers: int, ended: Callable[[], bool] = lambda: False) -> None:
    """Stream until `ended` or Ctrl-C; the first state creates the outlets, another number of modes new ones."""
    offset_s = lsl.local_clock() - time.monotonic()
    source = f"{socket.gethostname()}:{endpoint or 'default'}"
    outlets: list[Outlets] = []

    def take(state: PlateState) -> None:
        if not outlets or outlets[-1].modes != len(state.modal_um):
            outlets[:] = [Outlets(lsl, source, fingers, len(state.modal_um), offset_s)]
            print("LSL streams: hapticd-fingers, hapticd-modes, hapticd-markers\n(Ctrl-C ends)", flush=True)
        outlets[-1].push(state)

    serve(take, endpoint, ended)


def _outlet(lsl: Any, what: str, kind: str, channels: Sequence[Channel], source: str) -> Any:
    """Return an outlet of irregular rate; by its `source` a recorder finds it again after a restart."""
    form = lsl.cf_string if kind == "Markers" else lsl.cf_double64
    info = lsl.StreamInfo(f"{MAKER}-{what}", kind, len(channels), lsl.IRREGULAR_RATE, form, f"{MAKER}:{what}:{source}")
    description = info.desc()
    description.append_child_value("manufacturer", MAKER)
    listed = description.append_child("channels")
    for channel in channels:
        one = listed.append_child("channel")
        for key, value in (("label", channel.label), ("unit", channel.unit), ("type", channel.kind)):
            one.append_child_value(key, value)
    return lsl.StreamOutlet(info)


def _unit(name: str) -> str:
    *_, over, end = ("", *_value(name).split("_"))
    return f"{UNITS[over]}/second" if end == "s" and over in UNITS else UNITS.get(end, end)


def _kind(name: str) -> str:
    kinds = {"x_mm": "PositionX", "y_mm": "PositionY", "um": "Amplitude"}
    kinds |= dict.fromkeys(("major_mm", "minor_mm", "angle_rad", "pressure_frac", "area_mm2"), "Contact")
    kinds |= dict.fromkeys(("change", "frac", "friction", "jnd", "misses_target"), "Friction")
    return next((kind for end, kind in kinds.items() if _value(name).endswith(end)), "Misc")


def _value(name: str) -> str:
    """Return of which value a field is the interval's end."""
    return name.removesuffix("_low").removesuffix("_high")
