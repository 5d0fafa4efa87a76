"""The simulated client: assigns finger ids to actors and sends the targets of each."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hapticd_contract.contents import Amplitude, Content, Friction
from hapticd_contract.targets import ClientTargets

from ...core.friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from .scenarios import Actor

TTL_NS = 500_000_000
REFRESH_S = 0.15
ABSENT_MM = 1e9  # distance added for a lifted actor: less than that of a virtual one
LANDS_WITHIN_S = 0.05  # of the instant at which the daemon takes the first report to have been sampled


def virtual_name(actor: int) -> str:
    """Return the name of an actor's virtual finger; names count from 1, as finger ids do."""
    return f"virtual-{actor + 1}"


class ScriptedClient:
    """Assigns the daemon's finger ids to actors (by position, when an id is first seen) and builds their targets.

    `actor_of` maps finger ids and virtual names to actors. With the daemon's `curve` the targets are the frictions that
    their amplitudes have by the built-in one.
    """

    def __init__(self, actors: Sequence[Actor], curve: FrictionCurve | None = None) -> None:
        self._actors = actors
        self._curve = curve
        self._virtuals = {
            virtual_name(index): actor.virtual for index, actor in enumerate(actors) if actor.virtual is not None
        }
        self.actor_of: dict[int | str, int] = {
            virtual_name(index): index for index, actor in enumerate(actors) if actor.virtual is not None
        }
        self._last: dict[int | str, Content] = {}
        self._t_last_s = -math.inf

    def message(
        self, t_s: float, t_sampled_s: float, fingers: Sequence[tuple[int, float, float]]
    ) -> ClientTargets | None:
        """Return the message to send now, if targets changed or the last one is REFRESH_S old.

        `fingers` are the daemon's (id, x_mm, y_mm), sampled at `t_sampled_s`.
        """
        for finger_id, x_mm, y_mm in fingers:
            if finger_id not in self.actor_of:
                self.actor_of[finger_id] = self._nearest(x_mm, y_mm, t_sampled_s)
        targets: dict[int | str, Content] = {}
        keys: list[int | str] = [*self._virtuals, *(finger_id for finger_id, _, _ in fingers)]
        for key in keys:
            amplitude_um = self._actors[self.actor_of[key]].target_at_um(t_s)
            if amplitude_um is not None:
                targets[key] = self._content(amplitude_um)
        if targets == self._last and t_s - self._t_last_s < REFRESH_S:
            return None
        self._last, self._t_last_s = targets, t_s
        return ClientTargets.of("scenario", TTL_NS, targets, self._virtuals)

    def _content(self, amplitude_um: float) -> Content:
        if self._curve is None:
            return Amplitude(amplitude_um)
        return Friction(self._curve.friction_frac(DEFAULT_FRICTION_CURVE.friction(amplitude_um)))

    def _nearest(self, x_mm: float, y_mm: float, t_s: float) -> int:
        def distance_mm(index: int) -> float:
            path = self._actors[index].path
            if path is None:
                return math.inf
            now, soon = path.position_mm(np.array([t_s, t_s + LANDS_WITHIN_S]))
            for absent_mm, position in ((0.0, now), (ABSENT_MM, soon)):
                away_mm = math.hypot(position[0] - x_mm, position[1] - y_mm)
                if math.isfinite(away_mm):
                    return absent_mm + away_mm
            return 2.0 * ABSENT_MM

        return min(range(len(self._actors)), key=distance_mm)
