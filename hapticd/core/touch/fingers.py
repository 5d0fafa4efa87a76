"""The fingers on the pad: which are down, and where each of them will be.

A report's contacts become fingers with stable ids, whatever the trackpad does with its own. It numbers its contacts,
and mostly the numbers hold. Now and then it reuses one at once for another finger, swaps two, or renumbers a finger;
and it merges two fingers that touch each other. Friction must stay with the finger, so the device's number is only the
first guess: it stands while the contact is where the finger was going. Otherwise contacts go to fingers by position,
with the least total distance from where each was going or would have stopped, within what a finger can do in the time.

A report's stamp becomes an instant of the host (`sensor_clock`), and every finger has a predictor of its own
(`prediction`) from its landing until it is lifted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Final

from mypy_extensions import mypyc_attr

from ...values import Contact, Finger, FingerFrame, TouchFrame
from ..plate.contact import Ellipses
from .contact_ellipse import ContactTracker, EllipseScale
from .sensor_clock import GAP_PERIODS, SHORTEST_PERIODS, SensorClock

OLD_IN_A_ROW: Final = 3  # a frame out of order comes alone; several in a row: the pad's clock was reset
SILENT_PERIODS: Final = 3.5  # of a slow pad, which may lose two reports in a row: 40 ms at 11.25 ms
LONGEST_SILENCE_NS: Final = 80_000_000  # whatever period was measured
MAX_HORIZON_NS: Final = 50_000_000  # predictors are judged up to here; a longer horizon is cut to this
_STALE_STEP_MM: Final = 0.3  # a finger that made such a step cannot be at exactly the same counts one sample later
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

        Contacts that do not touch or have no finite position are ignored. No decoder gives two with one id.
        """
        if self._t_ns is None:
            self._t_ns = frame.t_ns
            return self._settle(frame.t_ns, [], _touching(frame.contacts), 0.0)
        elapsed_ns = frame.t_ns - self._t_ns
        if elapsed_ns <= 0:
            return FingerFrame(self._t_ns, tuple(_finger(track, is_new=False) for track in self._tracks.values()), ())
        self._t_ns = frame.t_ns
        elapsed_s = elapsed_ns * 1e-9
        contacts = _touching(frame.contacts)
        if elapsed_ns > _MAX_GAP_NS:
            pairs = self._pairs_after_gap(contacts)
        elif (sure := self._pairs_by_contact_id(contacts, elapsed_s)) is not None:
            pairs = sure
        else:
            pairs = self._pairs_by_position(contacts, elapsed_s)
        return self._settle(frame.t_ns, pairs, contacts, elapsed_s)

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
        lifted = [lifted_mm] * len(tracks)
        costs = [[*[self._cost(track, c, elapsed_s, reach_mm) for c in candidates], *lifted] for track in tracks]
        columns = _least_cost_columns(costs)
        return [
            (track, candidates[column])
            for track, column in zip(tracks, columns, strict=True)
            if column < len(candidates)
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


def _touching(contacts: Iterable[Contact]) -> dict[int, Contact]:
    """Return the valid contacts of a report by their numbers."""
    return {
        contact.contact_id: contact
        for contact in contacts
        if contact.touching and is_position(contact.x_mm, contact.y_mm)
    }


def _least_cost_columns(costs: list[list[float]]) -> list[int]:
    """Return a column for each row, none twice, with the least total cost, by shortest augmenting paths with prices
    (Jonker and Volgenant, Computing 38, 1987), O(n^3). A cost may be infinite where each row has a finite one."""
    free, none = len(costs), len(costs[0]) if costs else 0  # a row that none is, a column that none is
    row_price, column_price, row_of = [0.0] * (free + 1), [0.0] * (none + 1), [free] * (none + 1)
    for newcomer in range(free):
        length, came_from, is_closed = [math.inf] * (none + 1), [none] * (none + 1), [False] * (none + 1)
        row_of[none], column = newcomer, none
        while row_of[column] != free:
            is_closed[column] = True
            row, nearest = row_of[column], none
            for other in range(none):
                if not is_closed[other]:
                    through = costs[row][other] - row_price[row] - column_price[other]
                    if through < length[other]:
                        length[other], came_from[other] = through, column
                    if nearest == none or length[other] < length[nearest]:
                        nearest = other
            step = length[nearest]
            for other in range(none + 1):
                if is_closed[other]:
                    row_price[row_of[other]] = row_price[row_of[other]] + step
                    column_price[other] = column_price[other] - step
                else:
                    length[other] = length[other] - step
            column = nearest
        while column != none:
            row_of[column] = row_of[came_from[column]]
            column = came_from[column]
    return [row_of.index(row) for row in range(free)]


def _finger(track: _Track, *, is_new: bool) -> Finger:
    contact_id, x_mm, y_mm, major_mm, minor_mm, angle_rad, pressure_frac, _, _, _, _ = track.contact
    return Finger(track.finger_id, contact_id, x_mm, y_mm, is_new, pressure_frac, major_mm, minor_mm, angle_rad)


@mypyc_attr(allow_interpreted_subclasses=True)  # a base class: native calls cost a tenth of a protocol's
class FingerPredictor:
    """A touch's intake of samples, whose stamps are filtered already. A subclass estimates the motion: it takes samples
    at their true sampling times by `start` and `step`.

    The intake refuses what is no sample, and drops the stale duplicates that touchpads send.
    """

    def __init__(self) -> None:
        self._t_ns: int | None = None
        self._t_stamp_ns = 0
        self._x_mm = self._y_mm = math.nan
        self._moved = False

    def start(self, x_mm: float, y_mm: float) -> None:
        """Take the first sample of a touch; earlier ones are dropped."""
        raise NotImplementedError

    def step(self, interval_s: float, x_mm: float, y_mm: float) -> None:
        """Take the next sample, `interval_s` > 0 after the last."""
        raise NotImplementedError

    def position(self, ahead_s: float) -> tuple[float, float]:
        """Position in mm, `ahead_s` >= 0 after the last sample; NaN before the first."""
        raise NotImplementedError

    def covariance_mm2(self, ahead_s: float) -> tuple[float, float, float]:
        """Expected xx, xy, yy of the position's error; NaN where it is not known."""
        return math.nan * ahead_s, math.nan, math.nan

    def update(self, t_ns: int, t_stamp_ns: int, x_mm: float, y_mm: float, period_s: float) -> None:
        """Take a sample: when it was taken, on the axis of `predict`, its filtered stamp on the sampler's own, from
        which intervals come, its position, and the sampler's period. Ignored: what is no position, and stamps that do
        not increase."""
        if not is_position(x_mm, y_mm):
            return
        elapsed_s = math.inf if self._t_ns is None else (t_stamp_ns - self._t_stamp_ns) * 1e-9
        if elapsed_s > GAP_PERIODS * period_s:
            self.start(x_mm, y_mm)
            self._moved = False
        else:
            if elapsed_s <= 0.0 or self.is_stale(x_mm, y_mm):
                return
            self.step(max(elapsed_s, SHORTEST_PERIODS * period_s), x_mm, y_mm)
            dx_mm, dy_mm = x_mm - self._x_mm, y_mm - self._y_mm
            self._moved = dx_mm * dx_mm + dy_mm * dy_mm > _STALE_STEP_MM * _STALE_STEP_MM
        self._t_ns, self._t_stamp_ns = t_ns, t_stamp_ns
        self._x_mm, self._y_mm = x_mm, y_mm

    def predict(self, t_ns: int) -> tuple[float, float]:
        """Return the position in mm at an instant: up to the last sample the filtered last position, NaN before the
        first, finite from then on."""
        return self.position(self._ahead_s(t_ns))

    def covariance(self, t_ns: int) -> tuple[float, float, float]:
        """Return xx, xy, yy in mm^2 of the predicted position's error at an instant."""
        return self.covariance_mm2(self._ahead_s(t_ns))

    def is_stale(self, x_mm: float, y_mm: float) -> bool:
        """Return whether a moving finger's sample repeats the last one exactly. A second one in a row is not stale: the
        finger has stopped."""
        repeats = self._moved and x_mm == self._x_mm and y_mm == self._y_mm
        self._moved = self._moved and not repeats
        return repeats

    def _ahead_s(self, t_ns: int) -> float:
        if self._t_ns is None:
            return math.nan
        ahead_ns = t_ns - self._t_ns
        return (ahead_ns if ahead_ns < MAX_HORIZON_NS else MAX_HORIZON_NS) * 1e-9 if ahead_ns > 0 else 0.0


def is_position(x_mm: float, y_mm: float) -> bool:
    """Return whether both are finite, and on some plate."""
    return -_FARTHEST_MM <= x_mm <= _FARTHEST_MM and -_FARTHEST_MM <= y_mm <= _FARTHEST_MM


class Fingers:
    """Tracked fingers with their predictors, from the trackpad's frames."""

    def __init__(
        self,
        make_predictor: Callable[[], FingerPredictor],
        *,
        sensor_latency_ns: int,
        silence_ns: int,
        ellipse_scale: EllipseScale | None = None,
    ) -> None:
        """`sensor_latency_ns`: the pad's own; `silence_ns`: without a report for so long the pad counts as silent, and
        a slow one after SILENT_PERIODS; `ellipse_scale`: that of the pad's ellipses, where they are used.
        """
        self.down: tuple[Finger, ...] = ()
        self.predictors: dict[int, FingerPredictor] = {}  # of those that are down, by finger id
        self.released: set[int] = set()  # of those: held still unless they have a target
        self.t_sample_ns = 0  # when the newest report was sampled, on the host's axis
        self.t_device_ns = 0  # the same, as the pad stamped it
        self.period_s = 0.0  # from one report to the next, as stamps show it; 0 before the first
        self.make_predictor = make_predictor
        self._ellipse_scale = ellipse_scale
        self._contacts: dict[int, ContactTracker] = {}  # with `ellipse_scale`, of those that are down
        self._least_silence_ns = self._silence_ns = silence_ns
        self._tracker = Tracker()
        self._sensor_clock = SensorClock(sensor_latency_ns)
        self._t_stamp_ns: int | None = None
        self._t_read_ns = self._t_filtered_ns = 0
        self._old_in_a_row = 0

    @property
    def newest_id(self) -> int:
        """The largest finger id so far; 0 before the first finger."""
        return self._tracker.newest_id

    def touch(self, frame: TouchFrame, t_read_ns: int) -> FingerFrame:
        """Take one report: track its contacts and feed the predictors, on the host's time axis."""
        if (is_repeated := frame.t_ns == self._t_stamp_ns) and not self.down:
            return FingerFrame(frame.t_ns, self.down, ())
        self._t_stamp_ns = frame.t_ns
        self._t_read_ns = self._t_read_ns if is_repeated else t_read_ns  # while its clock stands still a pad is silent
        t_sample_ns = self._sensor_clock.update(frame.t_ns, t_read_ns)
        if frame.t_ns <= self.t_device_ns and self._sensor_clock.t_filtered_ns > self._t_filtered_ns:  # jitter
            frame = frame._replace(t_ns=max(self._sensor_clock.t_filtered_ns, self.t_device_ns + 1))
        self._old_in_a_row = self._old_in_a_row + 1 if frame.t_ns < self.t_device_ns else 0
        if self._old_in_a_row == OLD_IN_A_ROW:
            self.lift_all()
            t_sample_ns = self._sensor_clock.update(frame.t_ns, t_read_ns)
        tracked = self._tracker.update(frame)
        for finger_id in tracked.lifted:
            self._forget(finger_id)
        if tracked.t_ns != frame.t_ns:
            return tracked  # an old frame holds no news
        self.t_device_ns = frame.t_ns
        self.t_sample_ns = t_sample_ns
        self._t_filtered_ns, period_s = self._sensor_clock.t_filtered_ns, self._sensor_clock.period_s
        self.period_s = period_s
        slow_ns = min(round(SILENT_PERIODS * period_s * 1e9), LONGEST_SILENCE_NS)
        self._silence_ns = max(self._least_silence_ns, slow_ns)
        for finger_id, _, x_mm, y_mm, is_new, _, major_mm, minor_mm, angle_rad in tracked.fingers:
            if is_new:
                self.predictors[finger_id] = self.make_predictor()
            self.predictors[finger_id].update(t_sample_ns, self._t_filtered_ns, x_mm, y_mm, period_s)
            if self._ellipse_scale is not None:
                if is_new:
                    self._contacts[finger_id] = ContactTracker(self._ellipse_scale)
                self._contacts[finger_id].update(major_mm, minor_mm, angle_rad)
        self.down = tracked.fingers
        return tracked

    def lift_all(self) -> None:
        """Lift every finger and reset the clock: the pad is gone or silent."""
        for finger in self.down:
            self._forget(finger.finger_id)
        self.down = ()
        self._tracker.reset()
        self._sensor_clock.reset()
        self.t_device_ns = self._t_filtered_ns = self._old_in_a_row = 0

    def are_silent(self, t_now_ns: int) -> bool:
        """Whether fingers are down and no report came for too long."""
        return len(self.down) > 0 and t_now_ns - self._t_read_ns > self._silence_ns

    def release(self, keys: Sequence[int | str]) -> None:
        """Mark those of these fingers that are down as released, until they are lifted."""
        self.released.update(key for key in keys if isinstance(key, int) and key in self.predictors)

    def hold_all(self) -> None:
        """Mark all fingers that are down as released: surfaces decide what they feel, also after the last has ended."""
        if len(self.released) < len(self.predictors):
            self.released.update(self.predictors)

    def predicted_mm(self, finger_id: int, t_ns: int) -> tuple[float, float]:
        """Return where a finger that is down will be at an instant."""
        return self.predictors[finger_id].predict(t_ns)

    def variances_mm2(self, keys: Sequence[int | str], t_ns: int) -> list[float]:
        """Return the variance of each predicted place, the mean of both axes; 0 for virtual fingers."""
        variances_mm2 = []
        for key in keys:
            xx_mm2 = yy_mm2 = 0.0
            if isinstance(key, int):
                xx_mm2, _, yy_mm2 = self.predictors[key].covariance(t_ns)
            variances_mm2.append(0.5 * (xx_mm2 + yy_mm2))
        return variances_mm2

    def ellipses(self, keys: Sequence[int | str]) -> Ellipses:
        """Return the ellipse of each contact, None where the pad reports none, as for virtual fingers; None for all
        where the pad's ellipses are not used."""
        if self._ellipse_scale is None:
            return None
        return [self._contacts[key].ellipse if isinstance(key, int) else None for key in keys]

    def _forget(self, finger_id: int) -> None:
        self.predictors.pop(finger_id, None)
        self._contacts.pop(finger_id, None)
        self.released.discard(finger_id)
