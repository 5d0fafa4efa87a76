"""Supervisor: states and events that decide when the plate may move.

    IDLE -> ARMED     link and sensor are both up
    ARMED -> ACTIVE   a finger that has a target is down; only from ARMED and ACTIVE are references sent
    FAULT             latched: left by CLEARED alone, whatever else happens
    STOPPED           the daemon is going down; nothing leaves it

Link and sensor are remembered through every state: without one of them ARMED and ACTIVE end in IDLE. Events are levels,
not edges; reporting one again changes nothing. After an interruption the touch must be reported again, which the next
trackpad report does.
"""

from __future__ import annotations

from collections import deque
from enum import Enum
from typing import Final, NamedTuple


class State(Enum):
    """State of the daemon's output."""

    IDLE = "idle"  # board or trackpad is missing
    ARMED = "armed"  # both are there, no finger has a target
    ACTIVE = "active"  # references go out
    FAULT = "fault"  # latched until a client clears it
    STOPPED = "stopped"  # shutting down


DRIVING: Final = (State.ARMED, State.ACTIVE)  # where references other than zero may go out


class Event(Enum):
    """Input of the state machine."""

    LINK_UP = "link up"  # the board's handshake is done and its clock known
    LINK_DOWN = "link down"
    SENSOR_UP = "sensor up"
    SENSOR_DOWN = "sensor down"
    TOUCHED = "touched"  # a finger that has a target is down, or a virtual one moves
    RELEASED = "released"
    BOARD_FAULT = "board fault"
    CLEARED = "cleared"  # a client cleared the fault, and the board agreed
    STOP = "stop"


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
        self._has_link = self._has_sensor = False

    def handle(self, event: Event, reason: str, t_ns: int) -> State:
        """Take one event and give the new state; only changes are recorded."""
        if event is Event.LINK_UP or event is Event.LINK_DOWN:
            self._has_link = event is Event.LINK_UP
        elif event is Event.SENSOR_UP or event is Event.SENSOR_DOWN:
            self._has_sensor = event is Event.SENSOR_UP
        after = self._after(event)
        if after is not self.state:
            self.history.append(Transition(t_ns, event, self.state, after, reason))
            self.state = after
        return after

    def _after(self, event: Event) -> State:
        if self.state is State.STOPPED or event is Event.STOP:
            return State.STOPPED
        if event is Event.BOARD_FAULT or (self.state is State.FAULT and event is not Event.CLEARED):
            return State.FAULT
        if not (self._has_link and self._has_sensor):
            return State.IDLE
        if event is Event.TOUCHED or (self.state is State.ACTIVE and event is not Event.RELEASED):
            return State.ACTIVE
        return State.ARMED
