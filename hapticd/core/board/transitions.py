"""The supervisor's state machine as a table. Not compiled: it is built once, and would be 6600 lines of C."""

from __future__ import annotations

from enum import Enum


class State(Enum):
    """State of the daemon's output."""

    IDLE = "idle"  # board or trackpad is missing
    ARMED = "armed"  # both are there, no finger has a target
    ACTIVE = "active"  # references go out
    FAULT = "fault"  # latched until a client clears it
    STOPPED = "stopped"  # shutting down


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


# What is not in the second part changes nothing.
TRANSITIONS: dict[tuple[State, Event], State] = {(state, event): state for state in State for event in Event} | {
    (State.IDLE, Event.LINK_UP): State.ARMED,
    (State.IDLE, Event.SENSOR_UP): State.ARMED,
    (State.IDLE, Event.BOARD_FAULT): State.FAULT,
    (State.IDLE, Event.STOP): State.STOPPED,
    (State.ARMED, Event.LINK_DOWN): State.IDLE,
    (State.ARMED, Event.SENSOR_DOWN): State.IDLE,
    (State.ARMED, Event.TOUCHED): State.ACTIVE,
    (State.ARMED, Event.BOARD_FAULT): State.FAULT,
    (State.ARMED, Event.STOP): State.STOPPED,
    (State.ACTIVE, Event.LINK_DOWN): State.IDLE,
    (State.ACTIVE, Event.SENSOR_DOWN): State.IDLE,
    (State.ACTIVE, Event.RELEASED): State.ARMED,
    (State.ACTIVE, Event.BOARD_FAULT): State.FAULT,
    (State.ACTIVE, Event.STOP): State.STOPPED,
    (State.FAULT, Event.CLEARED): State.ARMED,
    (State.FAULT, Event.STOP): State.STOPPED,
}

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
