"""What a person perceives: the friction that each finger gets, against the friction that was asked for it.

It is judged when the newest touch sample was taken: there the finger's place is measured, not predicted, and the plate
has followed its reference. Beyond the Weber fraction a difference is felt. Computed for subscribers and recordings
only.
"""

from __future__ import annotations

import logging

from hapticd_contract.states import Perceived

from ..core.perception import ContactPerception
from ..core.pipeline import Pipeline
from ..values import WEBER_FRAC, FingerKey, Tick

log = logging.getLogger("hapticd")


class Perception:
    """Friction at each finger, and the share of time in which it was beyond the Weber fraction from what was asked.

    `has_contacts`: the plate is driven for contacts, else for points.
    """

    def __init__(self, pipeline: Pipeline, contacts: ContactPerception, *, has_contacts: bool) -> None:
        self._pipeline = pipeline
        self._contacts = contacts
        self._has_contacts = has_contacts
        self._t_last_ns = 0
        self._fails = False
        self._changes: dict[FingerKey, float] = {}
        self._spans_ns: dict[FingerKey, tuple[int, int]] = {}  # beyond the Weber fraction, and in all

    def judge(self, tick: Tick) -> dict[FingerKey, Perceived]:
        """Return what is perceived at each finger that is down or takes part in a pass; its share of time is that since
        it came into the solve. A failure costs only that, because the reference was sent: it is logged once."""
        try:
            perceived = self._judged(tick)
            self._fails = False
        except Exception:
            if not self._fails:
                log.exception("what fingers perceive is not known until it can be computed again")
            self._fails = True
            return {}
        return perceived

    def _judged(self, tick: Tick) -> dict[FingerKey, Perceived]:
        self._count(tick.t_now_ns - self._t_last_ns)
        self._t_last_ns = tick.t_now_ns
        solved = dict.fromkeys([point.key for point in tick.points])
        keys = list(dict.fromkeys([*[finger.finger_id for finger in self._pipeline.fingers], *solved]))
        past = self._pipeline.past(keys, tick.t_now_ns - tick.age_ns)
        forms = [None] * len(keys) if past.forms is None else past.forms
        felt = {
            key: self._contacts.felt(self._pipeline.modes, x_mm, y_mm, past.modal_um, stretch, form)
            for key, (x_mm, y_mm, _), stretch, form in zip(keys, past.places, past.stretches, forms, strict=True)
        }
        self._changes = {
            key: felt[key][0] / self._contacts.asked(target_um, stretch) - 1.0
            for key, (_, _, target_um), stretch in zip(keys, past.places, past.stretches, strict=True)
            if key in solved
        }
        self._spans_ns = {key: self._spans_ns.get(key, (0, 0)) for key in self._changes}
        return {key: self._perceived(key, friction, rms_um) for key, (friction, rms_um) in felt.items()}

    def _perceived(self, key: FingerKey, friction: float, rms_um: float) -> Perceived:
        change = self._changes.get(key)
        felt_friction = self._contacts.curve.friction_frac(friction)
        if change is None:
            return Perceived(contact_um=rms_um, felt_friction=felt_friction)
        error_jnd = change / WEBER_FRAC if self._has_contacts else None
        return Perceived(
            friction_change=change,
            weber_frac=self._weber_frac(key),
            contact_um=rms_um,
            felt_friction=felt_friction,
            error_jnd=error_jnd,
        )

    def _count(self, span_ns: int) -> None:
        for key, change in self._changes.items():
            beyond_ns, all_ns = self._spans_ns[key]
            self._spans_ns[key] = beyond_ns + span_ns * is_felt(change), all_ns + span_ns

    def _weber_frac(self, key: FingerKey) -> float:
        beyond_ns, all_ns = self._spans_ns[key]
        return beyond_ns / all_ns if all_ns > 0 else float(is_felt(self._changes[key]))


def is_felt(friction_change: float) -> bool:
    """Whether a relative change of friction is beyond the Weber fraction."""
    return abs(friction_change) > WEBER_FRAC
