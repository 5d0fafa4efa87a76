"""What each event does in the states that matter, any sequence of events, and the history."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.board.supervisor import DRIVING, Event, State, Supervisor

EVENTS = list(Event)


def supervisor_after(*events: Event) -> Supervisor:
    supervisor = Supervisor()
    for t_ns, event in enumerate(events):
        supervisor.handle(event, "test", t_ns)
    return supervisor


ACTIVE = (Event.LINK_UP, Event.SENSOR_UP, Event.TOUCHED)


@pytest.mark.parametrize("event", Event)
def test_only_clearing_or_stopping_leaves_a_fault_and_nothing_leaves_stopped(event: Event) -> None:
    left = {Event.CLEARED: State.ARMED, Event.STOP: State.STOPPED}
    driving = {Event.LINK_DOWN: State.IDLE, Event.SENSOR_DOWN: State.IDLE, Event.RELEASED: State.ARMED}
    driving |= {Event.BOARD_FAULT: State.FAULT, Event.STOP: State.STOPPED}
    assert supervisor_after(*ACTIVE, event).state is driving.get(event, State.ACTIVE)
    assert supervisor_after(*ACTIVE, Event.BOARD_FAULT, event).state is left.get(event, State.FAULT)
    assert supervisor_after(*ACTIVE, Event.STOP, event).state is State.STOPPED


@given(events=st.lists(st.sampled_from(EVENTS), max_size=40))
def test_it_drives_only_with_link_sensor_touch_and_no_fault(events: list[Event]) -> None:
    """A model kept apart: four flags, each set by its last event."""
    link = sensor = touched = faulty = stopped = False
    supervisor = Supervisor()
    for t_ns, event in enumerate(events):
        supervisor.handle(event, "random", t_ns)
        link = (link or event is Event.LINK_UP) and event is not Event.LINK_DOWN
        sensor = (sensor or event is Event.SENSOR_UP) and event is not Event.SENSOR_DOWN
        faulty = (faulty or event is Event.BOARD_FAULT) and event is not Event.CLEARED
        stopped = stopped or event is Event.STOP
        interrupted = not (link and sensor) or faulty or event is Event.RELEASED
        touched = (touched or event is Event.TOUCHED) and not interrupted
        is_armed = link and sensor and not faulty and not stopped
        assert (supervisor.state in DRIVING) == is_armed
        assert (supervisor.state is State.ACTIVE) == (is_armed and touched)
    assert all(change.before is not change.after for change in supervisor.history)


def test_a_cleared_fault_returns_to_what_is_up_and_waits_for_a_touch() -> None:
    supervisor = supervisor_after(*ACTIVE, Event.BOARD_FAULT, Event.TOUCHED)
    assert supervisor.state is State.FAULT
    assert supervisor.handle(Event.CLEARED, "cleared", 9) is State.ARMED
    assert supervisor.handle(Event.TOUCHED, "finger 1", 10) is State.ACTIVE
    lost = supervisor_after(*ACTIVE, Event.BOARD_FAULT, Event.LINK_DOWN, Event.CLEARED)
    assert lost.state is State.IDLE
    assert lost.handle(Event.LINK_UP, "back", 10) is State.ARMED  # the sensor was never gone


def test_history_has_change_instant_and_reason_and_stays_short() -> None:
    supervisor = supervisor_after(Event.LINK_UP, Event.SENSOR_UP, Event.SENSOR_UP)
    supervisor.handle(Event.TOUCHED, "finger 3 has a target", 1234)
    last = supervisor.history[-1]
    assert last == (1234, Event.TOUCHED, State.ARMED, State.ACTIVE, "finger 3 has a target")
    assert len(supervisor.history) == 2
    for t_ns in range(200):
        supervisor.handle(Event.RELEASED if t_ns % 2 == 0 else Event.TOUCHED, "", t_ns)
    assert len(supervisor.history) == 64
    assert supervisor.history[-1].t_ns == 199
