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
from enum import Enum
from typing import NamedTuple


class _Singleton(Enum):
    """Members are unique objects: their identity is hash enough, and looked up in a third of the time."""

    __hash__ = object.__hash__


class State(_Singleton):
    """State of the daemon's output."""

    IDLE = "idle"  # board or trackpad is missing
    ARMED = "armed"  # both are there, no finger has a target
    ACTIVE = "active"  # references go out
    FAULT = "fault"  # latched until a client clears it
    STOPPED = "stopped"  # shutting down


class Event(_Singleton):
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


TRANSITIONS: dict[tuple[State, Event], State] = (
    {
        (State.IDLE, Event.LINK_UP): State.ARMED,
        (State.IDLE, Event.LINK_DOWN): State.IDLE,
        (State.IDLE, Event.SENSOR_UP): State.ARMED,
        (State.IDLE, Event.SENSOR_DOWN): State.IDLE,
        (State.IDLE, Event.TOUCHED): State.IDLE,
        (State.IDLE, Event.RELEASED): State.IDLE,
        (State.IDLE, Event.BOARD_FAULT): State.FAULT,
        (State.IDLE, Event.CLEARED): State.IDLE,
        (State.IDLE, Event.STOP): State.STOPPED,
        (State.ARMED, Event.LINK_UP): State.ARMED,
        (State.ARMED, Event.LINK_DOWN): State.IDLE,
        (State.ARMED, Event.SENSOR_UP): State.ARMED,
        (State.ARMED, Event.SENSOR_DOWN): State.IDLE,
        (State.ARMED, Event.TOUCHED): State.ACTIVE,
        (State.ARMED, Event.RELEASED): State.ARMED,
        (State.ARMED, Event.BOARD_FAULT): State.FAULT,
        (State.ARMED, Event.CLEARED): State.ARMED,
        (State.ARMED, Event.STOP): State.STOPPED,
        (State.ACTIVE, Event.LINK_UP): State.ACTIVE,
        (State.ACTIVE, Event.LINK_DOWN): State.IDLE,
        (State.ACTIVE, Event.SENSOR_UP): State.ACTIVE,
        (State.ACTIVE, Event.SENSOR_DOWN): State.IDLE,
        (State.ACTIVE, Event.TOUCHED): State.ACTIVE,
        (State.ACTIVE, Event.RELEASED): State.ARMED,
        (State.ACTIVE, Event.BOARD_FAULT): State.FAULT,
        (State.ACTIVE, Event.CLEARED): State.ACTIVE,
        (State.ACTIVE, Event.STOP): State.STOPPED,
        (State.FAULT, Event.CLEARED): State.ARMED,
        (State.FAULT, Event.STOP): State.STOPPED,
    }
    | {(State.FAULT, event): State.FAULT for event in Event if event not in (Event.CLEARED, Event.STOP)}
    | {(State.STOPPED, event): State.STOPPED for event in Event}
)

# The conditions that events set, and those that a state needs.
CONDITIONS: dict[Event, tuple[str, bool]] = {
    Event.LINK_UP: ("link", True),
    Event.LINK_DOWN: ("link", False),
    Event.SENSOR_UP: ("sensor", True),
    Event.SENSOR_DOWN: ("sensor", False),
}
NEEDS: dict[State, frozenset[str]] = {
    State.IDLE: frozenset(),
    State.ARMED: frozenset({"link", "sensor"}),
    State.ACTIVE: frozenset({"link", "sensor"}),
    State.FAULT: frozenset(),
    State.STOPPED: frozenset(),
}


class Transition(NamedTuple):
    """One change of state, and why."""

    t_ns: int
    event: Event
    before: State
    after: State
    reason: str


class Supervisor:
    """The state, and how it came to be: `history` holds the last changes, oldest first."""

    def __init__(self, history: int = 64) -> None:
        self.state = State.IDLE
        self.history: deque[Transition] = deque(maxlen=history)
        self._up: frozenset[str] = frozenset()

    @property
    def may_drive(self) -> bool:
        """Whether references other than zero may go out, if something is touched that has a target."""
        return self.state in (State.ARMED, State.ACTIVE)

    def handle(self, event: Event, reason: str, t_ns: int) -> State:
        """Take one event and give the new state; only changes are recorded."""
        condition = CONDITIONS.get(event)
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
        return after
