"""Reports of the Magic Trackpad 1: 0x28, and pairs of it in 0xF7."""

from __future__ import annotations

from typing import Final

from ...values import AffineMap, Contact, TouchFrame
from .pad import BLUETOOTH, Family, HidIds, Layout, Pad, PadGeometry, records, require_distinct_ids

_SINGLE, _PAIR = 0x28, 0xF7
_TIMEOUT_NS = 100_000_000  # nine frames: a contact missing for so long has ended
_PERIOD_NS = 11_250_000  # as the later models' frames; the first frame of a pair is so much older


class MagicTrackpad1(Layout):
    """Decoder of this model's reports. Keeps the contacts: only state 0, or a timeout, ends one."""

    def __init__(self, geometry: PadGeometry, plate_from_pad: AffineMap) -> None:
        super().__init__(geometry, plate_from_pad, orientations=64)
        self._down: dict[int, tuple[Contact, int]] = {}  # by id: the contact and the host time of its last record

    @property
    def clock_steps(self) -> int:
        return 0  # its stamp is not understood

    def reset(self) -> None:
        self._down.clear()

    def decode(self, report: bytes, t_host_ns: int) -> tuple[TouchFrame, ...]:
        parsed = [self._parse(part) for part in _singles(report)]  # the whole report is validated before any is used
        first_ns = t_host_ns - _PERIOD_NS * (len(parsed) - 1)
        return tuple(
            TouchFrame(first_ns + index * _PERIOD_NS, self._merge(seen, t_host_ns), button)
            for index, (seen, button) in enumerate(parsed)
        )

    def _parse(self, part: bytes) -> tuple[tuple[Contact, ...], bool]:
        contacts = tuple([self._contact(record) for record in records(part, _SINGLE, 4)])
        require_distinct_ids(contacts)
        return contacts, part[1] & 1 == 1

    def _merge(self, seen: tuple[Contact, ...], t_host_ns: int) -> tuple[Contact, ...]:
        for contact in seen:
            self._down.pop(contact.contact_id, None)
        self._down = {i: kept for i, kept in self._down.items() if t_host_ns - kept[1] <= _TIMEOUT_NS}
        absent = tuple(contact for contact, _ in self._down.values())
        self._down.update((contact.contact_id, (contact, t_host_ns)) for contact in seen if contact.touching)
        return seen + absent

    def _contact(self, record: tuple[int, ...]) -> Contact:
        word, major, minor, size_and_id, id_and_angle, last = record
        x_mm, y_mm, raw_x, raw_y = self._plate_map.position(word)
        angle_rad, major_mm, minor_mm = self._plate_map.axes[id_and_angle >> 2]
        state = last >> 4
        return Contact(
            (id_and_angle & 3) << 2 | size_and_id >> 6, x_mm, y_mm, major * major_mm, minor * minor_mm, angle_rad,
            (size_and_id & 63) / 63, state != 0, state, raw_x, raw_y,
        )  # fmt: skip


def _singles(report: bytes) -> tuple[bytes, ...]:
    """Split a report into its 0x28 frames: a 0xF7 holds two, the first one's length before it."""
    if len(report) < 2 or report[0] != _PAIR:
        return (report,)
    end = 2 + report[1]
    return report[2:end], report[end:]


FAMILY: Final[Family] = Family(
    (
        Pad(
            model="mt1",
            name="Magic Trackpad on Bluetooth",
            layout="mt1",
            geometry=PadGeometry(-2909, 3167, -2565, 2456, 130.0, 110.0),
            period_ns=_PERIOD_NS,
            ids=HidIds(BLUETOOTH, 0x05AC, 0x030E),
            enable=b"\xd7\x01",
        ),
    ),
    {"mt1": MagicTrackpad1},
)
