"""Fingers out of contacts: stable ids, whatever the trackpad does with its own.

A trackpad numbers its contacts, and mostly the numbers hold. Now and then it reuses one at once for another finger,
swaps two, or renumbers a finger; and it merges two fingers that touch each other. Friction must stay with the finger,
so the device's number is only the first guess: it stands while the contact is where the finger was going. Otherwise
contacts go to fingers by position, with the least total distance from where each was going or would have stopped,
within what a finger can do in the time.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

from ...values import Contact, Finger, FingerFrame, TouchFrame
from .assignment import least_cost_assignment

_SHORTEST_S: Final = 4e-3  # two stamps closer than this are jitter: no speed is made of them
_RENUMBERED_MM: Final = 1.0  # added to a distance when the contact's number differs: settles near ties only
_FARTHEST_MM: Final = 1e6  # a coordinate beyond is no position

# What a finger can do: of adults' hands, on a trackpad of 60 to 130 Hz.
_SURE_MM: Final = 2.5  # a contact this near to where its number was going needs no second thought
_SLACK_MM: Final = 3.0  # by how far a contact's centre may jump as the fingertip rolls
_MAX_SPEED_MM_S: Final = 2e3  # a contact that jumps farther is another finger under the same number
_MAX_ACCELERATION_MM_S2: Final = 8e4  # a contact with another number must be where this finger was going
_MAX_RENUMBERED_MM: Final = 15.0  # and no farther from there than this, however long the interval
_MAX_GAP_NS: Final = 100_000_000  # after a longer silence only a contact of the same number
_NEAR_MM: Final = 10.0  # and this near is the same finger


class _Track:
    """A finger that is down: its id, last contact, position and velocity (mm, mm/s)."""

    def __init__(self, finger_id: int, contact: Contact) -> None:
        self.finger_id = finger_id
        self.contact = contact
        self.contact_id = contact.contact_id
        self.x, self.y = contact.x_mm, contact.y_mm
        self.vx = self.vy = 0.0

    def move(self, contact: Contact, elapsed_s: float) -> None:
        rate = 1.0 / (elapsed_s if elapsed_s > _SHORTEST_S else _SHORTEST_S)
        self.contact, self.contact_id = contact, contact.contact_id
        self.vx, self.vy = rate * (contact.x_mm - self.x), rate * (contact.y_mm - self.y)
        self.x, self.y = contact.x_mm, contact.y_mm

    def distance(self, contact: Contact) -> float:
        """From where it was last seen."""
        return math.hypot(contact.x_mm - self.x, contact.y_mm - self.y)

    def surprise(self, contact: Contact, elapsed_s: float) -> float:
        """From where it was going, or where it would have stopped, whichever is nearer.

        Two fingers that merge pull the contact's centre at a speed that no finger has: speed alone is no witness.
        """
        dx, dy = contact.x_mm - self.x, contact.y_mm - self.y
        return min(math.hypot(dx, dy), math.hypot(dx - elapsed_s * self.vx, dy - elapsed_s * self.vy))


_Pairs = list[tuple[_Track, Contact]]


class Tracker:
    """Turns touch frames into finger frames.

    Finger ids count up from 1 and are never used twice, not even after `reset`. Each finger is new in one frame and
    lifted in one. The result does not depend on the order of a frame's contacts.
    """

    def __init__(self) -> None:
        self._next_id = 1
        self._t_ns: int | None = None
        self._tracks: dict[int, _Track] = {}  # by contact id, in the order of finger ids
        self._unreported: tuple[int, ...] = ()

    @property
    def newest_id(self) -> int:
        """The largest finger id so far; 0 before the first finger."""
        return self._next_id - 1

    def reset(self) -> None:
        """Lift every finger (the next frame reports it) and accept any time next: the trackpad is gone."""
        self._unreported += tuple(track.finger_id for track in self._tracks.values())
        self._tracks = {}
        self._t_ns = None

    def update(self, frame: TouchFrame) -> FingerFrame:
        """The fingers of `frame`; of a frame that is not later than the last: the last fingers, with the last time.

        Contacts that do not touch or have no finite position are ignored; of two records with one contact id, the one
        nearer to where that contact was going counts.
        """
        if self._t_ns is None:
            self._t_ns = frame.t_ns
            return self._settle(frame.t_ns, [], self._touching(frame.contacts, 0.0), 0.0)
        elapsed_ns = frame.t_ns - self._t_ns
        if elapsed_ns <= 0:
            return FingerFrame(self._t_ns, tuple(_finger(track, is_new=False) for track in self._tracks.values()), ())
        self._t_ns = frame.t_ns
        elapsed_s = elapsed_ns * 1e-9
        contacts = self._touching(frame.contacts, elapsed_s)
        if elapsed_ns > _MAX_GAP_NS:
            pairs = self._pairs_after_gap(contacts)
        elif (sure := self._pairs_by_contact_id(contacts, elapsed_s)) is not None:
            pairs = sure
        else:
            pairs = self._pairs_by_position(contacts, elapsed_s)
        return self._settle(frame.t_ns, pairs, contacts, elapsed_s)

    def _touching(self, contacts: Iterable[Contact], elapsed_s: float) -> dict[int, Contact]:
        """Return the valid contacts of a report, one for each number."""
        touching: dict[int, Contact] = {}
        for contact in contacts:
            if contact.touching and abs(contact.x_mm) <= _FARTHEST_MM and abs(contact.y_mm) <= _FARTHEST_MM:
                rival = touching.setdefault(contact.contact_id, contact)
                if rival is not contact:
                    touching[contact.contact_id] = self._likelier(rival, contact, elapsed_s)
        return touching

    def _likelier(self, one: Contact, other: Contact, elapsed_s: float) -> Contact:
        """Of two contacts with one number; at a tie the choice must still not depend on their order."""
        track = self._tracks.get(one.contact_id)

        def unlikeliness(contact: Contact) -> tuple[float, float, float]:
            surprise = 0.0 if track is None else track.surprise(contact, elapsed_s)
            return surprise, contact.x_mm, contact.y_mm

        return min(one, other, key=unlikeliness)

    def _pairs_by_contact_id(self, contacts: dict[int, Contact], elapsed_s: float) -> _Pairs | None:
        """The fast path: the device's numbers, if every one is where it was going; None if one has to be doubted."""
        pairs = []
        for contact_id, track in self._tracks.items():
            contact = contacts.get(contact_id)
            if contact is not None:
                dx = contact.x_mm - track.x - elapsed_s * track.vx
                dy = contact.y_mm - track.y - elapsed_s * track.vy
                if dx * dx + dy * dy > _SURE_MM * _SURE_MM:
                    return None
                pairs.append((track, contact))
        renumbered_perhaps = len(pairs) < len(contacts) and len(pairs) < len(self._tracks)
        return None if renumbered_perhaps else pairs

    def _pairs_after_gap(self, contacts: dict[int, Contact]) -> _Pairs:
        """Match by number and distance alone: velocities are too old to use."""
        return [
            (track, contacts[contact_id])
            for contact_id, track in self._tracks.items()
            if contact_id in contacts and track.distance(contacts[contact_id]) <= _NEAR_MM
        ]

    def _pairs_by_position(self, contacts: dict[int, Contact], elapsed_s: float) -> _Pairs:
        """As many fingers as can be kept, with the least total distance from where they were going."""
        tracks = list(self._tracks.values())
        candidates = sorted(contacts.values(), key=lambda contact: contact.contact_id)
        reach_mm = _SLACK_MM + _MAX_SPEED_MM_S * elapsed_s
        lifted_mm = 4.0 * reach_mm  # what it costs to lift a finger: more than any move it can make
        costs = [[min(self._cost(track, c, elapsed_s, reach_mm), lifted_mm) for c in candidates] for track in tracks]
        return [
            (tracks[row], candidates[column])
            for row, column in least_cost_assignment(costs)
            if costs[row][column] < lifted_mm
        ]

    def _cost(self, track: _Track, contact: Contact, elapsed_s: float, reach_mm: float) -> float:
        """Distance in mm from where the finger was going; inf if it cannot be that finger."""
        surprise_mm = track.surprise(contact, elapsed_s)
        if not track.distance(contact) <= reach_mm:
            return math.inf
        if contact.contact_id == track.contact_id:
            return surprise_mm
        steered_mm = _SLACK_MM + 0.5 * _MAX_ACCELERATION_MM_S2 * elapsed_s * elapsed_s
        if not surprise_mm <= min(steered_mm, _MAX_RENUMBERED_MM):
            return math.inf
        return surprise_mm + _RENUMBERED_MM

    def _settle(self, t_ns: int, pairs: _Pairs, contacts: dict[int, Contact], elapsed_s: float) -> FingerFrame:
        """Move the fingers that stay, lift those without a contact, begin one for each contact that is left."""
        before = self._tracks
        self._tracks = {}
        fingers = []
        for track, contact in pairs:
            track.move(contact, elapsed_s)
            self._tracks[contact.contact_id] = track
            fingers.append(_finger(track, is_new=False))
        lifted = self._unreported
        if len(pairs) < len(before):
            kept = {track.finger_id for track, _ in pairs}
            lifted += tuple(track.finger_id for track in before.values() if track.finger_id not in kept)
        if len(pairs) < len(contacts):
            unclaimed = sorted(contacts.keys() - self._tracks.keys())
            fingers += [self._begin(contacts[contact_id]) for contact_id in unclaimed]
        self._unreported = ()
        return FingerFrame(t_ns, tuple(fingers), lifted)

    def _begin(self, contact: Contact) -> Finger:
        track = self._tracks[contact.contact_id] = _Track(self._next_id, contact)
        self._next_id += 1
        return _finger(track, is_new=True)


def _finger(track: _Track, *, is_new: bool) -> Finger:
    contact_id, x_mm, y_mm, major_mm, minor_mm, angle_rad, pressure_frac, _, _, _, _ = track.contact
    return Finger(track.finger_id, contact_id, x_mm, y_mm, is_new, pressure_frac, major_mm, minor_mm, angle_rad)
