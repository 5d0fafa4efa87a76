"""Perceived friction: the friction that each finger gets, against the friction that was asked for it.

It is judged when the newest touch sample was taken: there the finger's place is measured, not predicted, and the plate
has followed its reference; where the board's voltage ended, by what its sensors read. What is not known is expected
(`core.uncertainty`). Beyond the Weber fraction a difference is felt. Computed for subscribers and recordings only.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from typing import Any

from hapticd_contract.states import Perceived

from ..board_protocol import BoardState
from ..core.board.session import BoardSession
from ..core.perception import ContactPerception, ExpectedAmplitude, Felt
from ..core.phasors import Phasors
from ..core.pipeline import Pipeline
from ..core.plate.contact import ContactEllipse
from ..core.touch.contact_ellipse import axes
from ..values import WEBER_FRAC, Finger, FingerKey, Tick, TouchPoint

LEAST_SHARE = 0.9  # of its target: a finger that gets less misses it
READ_NS = 1_000_000  # before a status: what its sensors read, of the reference before that which it acknowledges
READING_UM = 0.4  # by which one reading of all modes and the reference differ by their times alone
OLD_NS = 50_000_000  # a status says nothing of the present
BIN_JND, BINS = 0.05, 400  # of errors over time: larger ones count as the last

log = logging.getLogger("hapticd")


class ErrorTally:
    """A finger's errors, weighed by time, of which the first counts at once."""

    def __init__(self, error_jnd: float) -> None:
        self._sum_jnd_ns, self._all_ns, self._spans_ns = 0.0, 0, [0] * BINS
        self._felt_ns = self._within_two_ns = 0
        self._median, self._error_95 = _Quantile(0.5), _Quantile(0.95)
        self.add(error_jnd, 1)

    def add(self, error_jnd: float, span_ns: int) -> None:
        index = int(min(abs(error_jnd) / BIN_JND, BINS - 1.0))
        self._sum_jnd_ns += error_jnd * span_ns
        self._all_ns += span_ns
        self._spans_ns[index] += span_ns
        self._felt_ns += span_ns if index < 1.0 / BIN_JND else 0
        self._within_two_ns += span_ns if index < 2.0 / BIN_JND else 0
        self._median.follow(self._spans_ns, self._all_ns, index, span_ns)
        self._error_95.follow(self._spans_ns, self._all_ns, index, span_ns)

    def figures(self) -> dict[str, float]:
        """Return the fields of `Perceived` that are over time."""
        return {
            "bias_jnd": self._sum_jnd_ns / self._all_ns,
            "median_jnd": BIN_JND * (self._median.index + 0.5),
            "error_95_jnd": BIN_JND * (self._error_95.index + 0.5),
            "felt_frac": self._felt_ns / self._all_ns,
            "within_two_frac": self._within_two_ns / self._all_ns,
        }


class _Quantile:
    """The bin in which a share of all time ends: it moves by few bins at a time."""

    def __init__(self, share: float) -> None:
        self.index, self._share, self._below_ns = 0, share, 0

    def follow(self, spans_ns: Sequence[int], all_ns: int, grown: int, by_ns: int) -> None:
        """Take the times of bins, of which one has grown."""
        self._below_ns += by_ns if grown < self.index else 0
        end_ns = self._share * all_ns
        while self._below_ns >= end_ns:
            self.index -= 1
            self._below_ns -= spans_ns[self.index]
        while self._below_ns + spans_ns[self.index] < end_ns:
            self._below_ns += spans_ns[self.index]
            self.index += 1


class Perception:
    """Friction at each finger, and how far it was from what was asked, over time.

    `by_reference` judges amplitudes where they are driven for: over contacts if `has_contacts`, else at points.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        session: BoardSession,
        contacts: ContactPerception,
        by_reference: ContactPerception,
        *,
        has_contacts: bool,
    ) -> None:
        self._pipeline = pipeline
        self._session = session
        self._contacts = contacts
        self._by_reference = by_reference
        self._has_contacts = has_contacts
        self._t_last_ns = 0
        self._fails = False
        self._changes: dict[FingerKey, float] = {}
        self._tallies: dict[FingerKey, ErrorTally] = {}

    def judge(self, tick: Tick) -> tuple[Tick, dict[FingerKey, Perceived]]:
        """Return the pass with the amplitudes that are to be expected of it, and what is perceived at each finger that
        is down or takes part in it; what is over time is so since it came into the solve. A failure costs only that,
        because the reference was sent: it is logged once."""
        try:
            judged = self._judged(tick)
            self._fails = False
        except Exception:
            if not self._fails:
                log.exception("what fingers perceive is not known until it can be computed again")
            self._fails = True
            return tick, {}
        return judged

    def _judged(self, tick: Tick) -> tuple[Tick, dict[FingerKey, Perceived]]:
        for key, change in self._changes.items():
            self._tallies[key].add(change / WEBER_FRAC, tick.t_now_ns - self._t_last_ns)
        self._t_last_ns, t_ns = tick.t_now_ns, tick.t_now_ns - tick.age_ns
        solved = {point.key: point for point in tick.points}
        keys = list(dict.fromkeys([*[finger.finger_id for finger in self._pipeline.fingers], *solved]))
        past = self._pipeline.past(keys, t_ns)
        modal_um = past.modal_um
        missing_um = self._missing_um(tick.t_now_ns)
        if missing_um is not None:
            modal_um = tuple([w_um + less_um for w_um, less_um in zip(modal_um, missing_um, strict=True)])
        ellipses = past.ellipses or [None] * len(keys)
        achieved = self._achieved(tick, dict(zip(keys, ellipses, strict=True)))
        reported: dict[FingerKey, Finger] = {finger.finger_id: finger for finger in self._pipeline.fingers}
        perceived, self._changes, tallies, self._tallies = {}, {}, self._tallies, {}
        for key, (x_mm, y_mm, target_um), speed_gain, place_mm2, ellipse in zip(
            keys, past.places, past.speed_gains, self._places_mm2(keys, t_ns), ellipses, strict=True
        ):
            felt = self._contacts.felt(self._pipeline.modes, x_mm, y_mm, modal_um, speed_gain, place_mm2, ellipse)
            against_target = dict[str, Any]()
            if key in solved:
                change = felt.friction / self._contacts.asked(target_um, speed_gain) - 1.0
                self._changes[key] = change
                self._tallies[key] = tallies.get(key) or ErrorTally(change / WEBER_FRAC)
                against_target = self._against_target(felt, solved[key], achieved[key])
            perceived[key] = self._perceived(felt, ellipse, reported.get(key), against_target)
        points = tuple([point._replace(achieved_um=achieved[point.key].rms_um) for point in tick.points])
        return tick._replace(points=points), perceived

    def _achieved(
        self, tick: Tick, ellipses: Mapping[FingerKey, ContactEllipse | None]
    ) -> dict[FingerKey, ExpectedAmplitude]:
        """Return what each finger in the solve will get at the first knot."""
        points, pipeline = tick.points, self._pipeline
        t_knot_ns = tick.t_now_ns - tick.age_ns + tick.horizon_ns
        places_mm2 = self._places_mm2([point.key for point in points], t_knot_ns)
        return {
            point.key: self._by_reference.amplitude(
                *(pipeline.modes, point.x_mm, point.y_mm, pipeline.modal_um, place_mm2),
                ellipses[point.key] if self._has_contacts else None,
            )
            for point, place_mm2 in zip(points, places_mm2, strict=True)
        }

    def _places_mm2(self, keys: Sequence[FingerKey], t_ns: int) -> list[float]:
        """Return the variance of each finger's place; a virtual one is where its client has it."""
        expected = self._contacts.uncertainty
        return [
            0.0 if isinstance(key, str) else expected.place_mm2(variance_mm2, speed_mm_s)
            for key, (variance_mm2, speed_mm_s) in zip(keys, self._pipeline.motions(keys, t_ns), strict=True)
        ]

    def _missing_um(self, t_now_ns: int) -> Phasors | None:
        """Return what the sensors read less the reference, where the board's voltage ended; else the plate follows its
        reference more closely than one reading says."""
        status, clock = self._session.status, self._session.clock
        if status is None or not (status.saturated and status.state is BoardState.LIVE and clock.ready):
            return None
        t_ns = clock.to_host_ns(status.t_board_us, near=t_now_ns) - READ_NS
        asked_um = self._pipeline.asked_um(t_ns)
        if t_now_ns - t_ns > OLD_NS or len(status.measured_um) != len(asked_um):
            return None
        missing_um = [read_um - w_um for read_um, w_um in zip(status.measured_um, asked_um, strict=True)]
        square_um2 = sum(abs(less_um) ** 2 for less_um in missing_um)
        share = square_um2 / (square_um2 + READING_UM * READING_UM)  # the best estimate where both are noise
        return tuple([share * less_um for less_um in missing_um])

    def _perceived(
        self, felt: Felt, ellipse: ContactEllipse | None, finger: Finger | None, against_target: dict[str, Any]
    ) -> Perceived:
        """Return what is perceived at a finger, and how the pad reports it; None is not on the pad."""
        curve = self._contacts.curve
        major_mm, minor_mm, angle_rad = (None, None, None) if ellipse is None else axes(ellipse)
        area_mm2 = 0.0 if finger is None else 0.25 * math.pi * finger.major_mm * finger.minor_mm
        return Perceived(
            contact_um=felt.amplitude.rms_um,
            contact_um_low=felt.amplitude.low_um,
            contact_um_high=felt.amplitude.high_um,
            felt_friction=curve.friction_frac(felt.friction),
            felt_friction_low=curve.friction_frac(felt.low),
            felt_friction_high=curve.friction_frac(felt.high),
            contact_major_mm=major_mm,
            contact_minor_mm=minor_mm,
            contact_angle_rad=angle_rad,
            pressure_frac=None if finger is None else finger.pressure_frac,
            area_mm2=area_mm2 if area_mm2 > 0.0 else None,
            **against_target,
        )

    def _against_target(self, felt: Felt, point: TouchPoint, achieved: ExpectedAmplitude) -> dict[str, Any]:
        """Return the fields of `Perceived` that only a finger with a target has."""
        curve, change = self._contacts.curve, self._changes[point.key]
        fields = self._tallies[point.key].figures() | {"friction_change": change}
        if self._has_contacts:
            gets_um, off_jnd, asked = felt.amplitude.rms_um, change / WEBER_FRAC, felt.friction / (1.0 + change)
            low_jnd, high_jnd = [(friction / asked - 1.0) / WEBER_FRAC for friction in (felt.low, felt.high)]
            fields |= {"error_jnd": off_jnd, "error_jnd_low": low_jnd, "error_jnd_high": high_jnd}
        else:
            gets_um = achieved.rms_um
            off_jnd = (curve.friction(gets_um) / curve.friction(point.target_um) - 1.0) / WEBER_FRAC
        misses = gets_um < LEAST_SHARE * point.target_um or abs(off_jnd) > 1.0
        return fields | {
            "achieved_um_low": achieved.low_um,
            "achieved_um_high": achieved.high_um,
            "misses_target": misses,
        }
