"""The description of a pad: all that must be known of a touch device, in one record that its link carries.

Each family of devices has a file here: its pads, and the decoders of their reports. A device whose size and period are
known when it is opened gets its record then: its source makes it with `dataclasses.replace`, or from scratch.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from ...values import AffineMap, TouchFrame
from .geometry import PadGeometry, PlateMap

USB, BLUETOOTH = 1, 2  # hidapi's bus_type


@dataclass(frozen=True, slots=True)
class HidIds:
    """By what hidapi lists a device: bus, ids, and the interface that reports touches."""

    bus: int
    vendor_id: int
    product_id: int
    interface: int = -1  # hidapi's for a device that has one


@dataclass(frozen=True, slots=True)
class Pad:
    """A touch device. `model` names it in configurations and files, `name` is for people.

    `layout` names the decoder of its reports; `period_ns` is the nominal one between them. `source` is the
    `trackpad.source` that reads it; `ids` are for hidapi, None for other sources. `enable` is the feature report that
    switches it to multitouch; empty: it needs none.
    """

    model: str
    name: str
    layout: str
    geometry: PadGeometry
    period_ns: int
    source: str = "hid"
    ids: HidIds | None = None
    enable: bytes = b""


class Layout(ABC):
    """The decoder of one pad's reports, which count `orientations` angles in half a turn."""

    def __init__(self, geometry: PadGeometry, plate_from_pad: AffineMap, orientations: int = 1) -> None:
        self._geometry, self._orientations = geometry, orientations
        self.place(plate_from_pad)

    @property
    @abstractmethod
    def clock_steps(self) -> int:
        """Return how often the pad's own clock was stopped or set."""

    @abstractmethod
    def decode(self, report: bytes, t_host_ns: int) -> tuple[TouchFrame, ...]:
        """Return the report's frames on the plate. Raises `records.RefusedError` and no other."""

    def place(self, plate_from_pad: AffineMap) -> None:
        """Take the pad to lie elsewhere from the next report on."""
        self._plate_map = PlateMap(self._geometry, plate_from_pad, orientations=self._orientations)

    @abstractmethod
    def reset(self) -> None:
        """Discard contacts and clock state."""


class Family(NamedTuple):
    """Pads that report alike, and how each of their layouts is made from a pad's size and its place on the plate."""

    pads: tuple[Pad, ...]
    layouts: dict[str, Callable[[PadGeometry, AffineMap], Layout]]
