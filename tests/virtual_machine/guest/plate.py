"""What a client does to see that the plate is driven: it waits for states, and asks for what two fingers shall feel."""

from __future__ import annotations

import time
from collections.abc import Callable

from kernel import PATIENCE_S

from hapticd_client import Client, PlateState

MOVES_UM, RESTS_UM = 0.3, 0.05


def wait_state(client: Client, what: str, condition: Callable[[PlateState], bool]) -> PlateState:
    """The first state from now on that meets the condition."""
    t_end_s = time.monotonic() + PATIENCE_S
    for state in client.states(timeout_s=PATIENCE_S):
        if condition(state):
            return state
        if time.monotonic() > t_end_s:
            raise TimeoutError(f"{what} did not come about; the last state is {state}")
    raise AssertionError("the states ended")


def is_as_asked(client: Client, state: PlateState) -> bool:
    """Whether of two fingers the left has 1 um and the right 0. Where not, ask for it: it may be for the first time,
    or an emulated machine paused for so long that the fingers count as new."""
    if len(state.fingers) != 2:
        return False
    left, right = sorted(state.fingers, key=lambda finger: finger.x_mm)
    if (left.target_um, right.target_um) == (1.0, 0.0):
        return True
    client.set(left, amplitude_um=1.0)
    client.set(right, amplitude_um=0.0)
    return False


def measured_um(client: Client) -> float:
    """What the board measures of the plate: the larger of the modes."""
    return max((abs(complex(*w_um)) for w_um in client.status()["board"].get("measured_um", ())), default=0.0)
