"""Supervisor: states and events that decide when the plate may move.

    IDLE -> ARMED     link and sensor are both up
    ARMED -> ACTIVE   a finger that has a target is down; only from ARMED and ACTIVE are references sent
    FAULT             latched: left by CLEARED alone, whatever else happens
    STOPPED           the daemon is going down; nothing leaves it

Link and sensor are remembered through every state: a transition into a state whose needs are not met ends in IDLE.
Events are levels, not edges; reporting one again changes nothing. After an interruption the touch must be reported
again, which the next trackpad report does.
"""

from __future__ import annotations

from collections import deque
from typing import Final, NamedTuple

from .transitions import CONDITIONS, NEEDS, TRANSITIONS, Event, State

__all__ = ["TRANSITIONS", "Event", "State", "Supervisor", "Transition"]


_DRIVING: Final = (State.ARMED, State.ACTIVE)


class Transition(NamedTuple):
    """One change of state, and why."""

    t_ns: int
    event: Event
    before: State
    after: State
    reason: str


class Supervisor:
    """The state, and how it came to be: `history` holds the last changes, oldest first."""

    def __init__(self) -> None:
        self.state = State.IDLE
        self.history: deque[Transition] = deque(maxlen=64)
        self._up: frozenset[str] = frozenset()
        self._unchanging: list[Event] = []  # that changed nothing since something did

    @property
    def may_drive(self) -> bool:
        """Whether references other than zero may go out, if something is touched that has a target."""
        return self.state in _DRIVING

    def handle(self, event: Event, reason: str, t_ns: int) -> State:
        """Take one event and give the new state; only changes are recorded."""
        if event in self._unchanging:  # as most are: to look up what they do takes 0.4 us
            return self.state
        condition, was_up = CONDITIONS.get(event), self._up
        if condition is not None:
            name, is_up = condition
            if is_up is not (name in self._up):
                self._up ^= {name}
        after = TRANSITIONS[self.state, event]
        if not NEEDS[after] <= self._up:
            after = State.IDLE
        if after is not self.state:
            self.history.append(Transition(t_ns, event, self.state, after, reason))
            self.state = after
            self._unchanging = []
        elif self._up is was_up:
            self._unchanging.append(event)
        else:
            self._unchanging = []
        return after
