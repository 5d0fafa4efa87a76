"""The board's log on its own: a ring in which a swarm of lost samples takes one place."""

from __future__ import annotations

import ctypes
import struct

from hapticd.sim.board import firmware

ENTRY = struct.Struct("<IIBBf")  # hd_wire_log_entry_t: t_board_us, boot_id, code, mode, value
ENTRIES = 8
DEADMAN_TRIP, MISSED_CHUNK = 64, 66


class Log:
    """`hd_log_t`: check, events, entries."""

    def __init__(self) -> None:
        self._bytes = ctypes.create_string_buffer(8 + ENTRIES * ENTRY.size)
        firmware.load(2).hd_log_recover(self._bytes)

    def add(self, t_us: int, code: int, value: float = 0.0, boot_id: int = 1) -> None:
        firmware.load(2).hd_log_add(self._bytes, ENTRY.pack(t_us, boot_id, code, 255, value))

    @property
    def events(self) -> int:
        return int.from_bytes(self._bytes.raw[4:8], "little")

    def codes(self) -> list[tuple[int, float]]:
        """Code and value of the entries in their places."""
        rows = ENTRY.iter_unpack(self._bytes.raw[8:])
        return [(code, value) for _, _, code, _, value in rows][: self.events]


def test_a_swarm_of_lost_samples_is_one_entry_that_tells_how_many() -> None:
    log = Log()
    log.add(100, DEADMAN_TRIP)
    for count in range(1, 13):
        log.add(200 + 30 * count, MISSED_CHUNK, float(count))
    assert log.events == 2
    assert log.codes() == [(DEADMAN_TRIP, 0.0), (MISSED_CHUNK, 12.0)]


def test_other_events_and_other_boots_begin_an_entry_of_their_own() -> None:
    log = Log()
    for _ in range(2):
        log.add(100, DEADMAN_TRIP)
    log.add(200, MISSED_CHUNK, 1.0)
    log.add(300, DEADMAN_TRIP)
    log.add(400, MISSED_CHUNK, 2.0)
    log.add(50, MISSED_CHUNK, 1.0, boot_id=2)
    assert log.events == 6
    assert [code for code, _ in log.codes()] == [64, 64, 66, 64, 66, 66]
