"""What goes on after the end of clients: `python -m pytest tests/integration/test_dead_clients.py -n 0 -s` prints it.

The figures are those of the daemon's own clock: from their end to the last finger that one of them took, and to the
last state in which the plate moved, which is to be at most the longest `ttl_s` of 2 s and 50 ms.
"""

from __future__ import annotations

import time
from itertools import pairwise
from pathlib import Path

import pytest
from legal_client import TTLS_S
from service import PATIENCE_S, Bench, is_quiet
from test_floods import served_over_both

from hapticd_client import PlateState

CLIENTS = 6
SENDING_S = 1.5

pytestmark = pytest.mark.long


def owners(state: PlateState) -> dict[int | str, str]:
    return {finger.id: finger.owner for finger in state.fingers if finger.owner is not None}


@pytest.mark.parametrize(
    ("socket", "transport", "end"),
    [("targets", "ipc", "kill"), ("targets", "tcp", "close"), ("control", "ipc", "close"), ("control", "tcp", "kill")],
)
def test_nothing_of_clients_acts_after_their_end(bench: Bench, socket: str, transport: str, end: str) -> None:
    endpoint = served_over_both(bench)[transport]
    bench.rig()
    bench.service()
    reader = bench.client()
    seconds = str(SENDING_S if end == "close" else 0)
    script = str(Path(__file__).with_name("legal_client.py"))
    clients = [bench.program(script, str(n), socket, seconds, *endpoint) for n in range(CLIENTS)]
    states, received = reader.states(timeout_s=PATIENCE_S), list[PlateState]()
    while not any(map(owners, received)):
        received.append(next(states))
    t_kill_s = time.monotonic() + SENDING_S
    while any(client.poll() is None for client in clients):
        received.append(next(states))
        if end == "kill" and time.monotonic() >= t_kill_s:
            for client in clients:
                client.kill()
    t_end_ns = time.monotonic_ns()
    reader.status()  # by the time of the reply the daemon has read the end of each connection
    t_known_ns = time.monotonic_ns()
    while not (received[-1].t_ns > t_known_ns + TTLS_S[-1] * 1e9 and is_quiet(received[-1])):
        received.append(next(states))
    gained = [new.t_ns for old, new in pairwise(received) if owners(new).items() - {*owners(old).items()}]
    after = [state for state in received if state.t_ns > t_end_ns]
    moves_s = max([(state.t_ns - t_end_ns) * 1e-9 for state in after if not is_quiet(state)], default=0.0)
    took_s = max([(t_ns - t_end_ns) * 1e-9 for t_ns in gained if t_ns > t_end_ns], default=0.0)
    print(f"\n{CLIENTS} clients, {socket}, {transport}, {end}: last finger taken {took_s:.2f} s,", end=" ")
    print(f"moves until {moves_s:.2f} s after their end")
    assert gained
    assert not [t_ns for t_ns in gained if t_ns > t_known_ns]
