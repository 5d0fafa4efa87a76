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

USB, BLUETOOTH = 1, 2  # hidapi's bus_type


@dataclass(frozen=True, slots=True)
class PadGeometry:
    """The range of positions a pad declares (raw units, y up) and the size in mm that the kernel gives it.

    Of a device whose layout does not say it: the highest pressure, and the orientation of an ellipse along x; 0: none.
    """

    x_min_raw: int
    x_max_raw: int
    y_min_raw: int
    y_max_raw: int
    width_mm: float
    height_mm: float
    pressure_max_raw: int = 0
    quarter_turn_raw: int = 0

    @property
    def units_per_mm(self) -> tuple[float, float]:
        """Raw units per mm along x and y."""
        return (self.x_max_raw - self.x_min_raw) / self.width_mm, (self.y_max_raw - self.y_min_raw) / self.height_mm

    @property
    def centre_raw(self) -> tuple[float, float]:
        """The raw position of pad (0, 0) mm: the middle of the declared range."""
        return (self.x_min_raw + self.x_max_raw) / 2, (self.y_min_raw + self.y_max_raw) / 2


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
    """The decoder of one pad's reports."""

    @property
    @abstractmethod
    def clock_steps(self) -> int:
        """Return how often the pad's own clock was stopped or set."""

    @abstractmethod
    def decode(self, report: bytes, t_host_ns: int) -> tuple[TouchFrame, ...]:
        """Return the report's frames on the plate. Raises `records.RefusedError` and no other."""

    @abstractmethod
    def place(self, plate_from_pad: AffineMap) -> None:
        """Take the pad to lie elsewhere from the next report on."""

    @abstractmethod
    def reset(self) -> None:
        """Discard contacts and clock state."""


class Family(NamedTuple):
    """Pads that report alike, and how each of their layouts is made from a pad's size and its place on the plate."""

    pads: tuple[Pad, ...]
    layouts: dict[str, Callable[[PadGeometry, AffineMap], Layout]]
