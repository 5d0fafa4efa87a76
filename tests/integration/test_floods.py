"""The worst that clients can do to a running service: its memory, and the gaps between the states of others.

`python -m pytest tests/integration/test_floods.py -n 0 -s` prints both. The gaps, from pass to pass by `t_ns`, are
printed only: without SCHED_FIFO they are also those of a machine that is busy with the flood.
"""

from __future__ import annotations

import subprocess
import time
from itertools import cycle, pairwise
from pathlib import Path
from statistics import median

import pytest
import zmq
from flooder import KINDS
from free_ports import free_ports
from service import PATIENCE_S, Bench, resident_mb, wait_for

from hapticd.io.clients import keys
from hapticd_client.control import Control
from hapticd_client.endpoint import find

FLOOD_S = 2.0
MAX_RSS_MB = 150.0
MIN_STATES_HZ = 30.0  # of ninety: they do not stop
MIN_HELLOS_HZ = 2.0  # of dozens, each on a connection of its own

pytestmark = pytest.mark.long


def served_over_both(bench: Bench) -> dict[str, list[str]]:
    """Configure ipc and TCP; return the flooder's arguments for each: the endpoint, for TCP also two keys."""
    folder = bench.folder / "keys"
    for name in ("hapticd", "eve"):
        keys.make_pair(folder, name)
    keys.allow(folder, folder / "eve.key")
    address = f"127.0.0.1:{free_ports()}"
    bench.configure(f'[client]\ntcp = "{address}"\nkeys_dir = "{folder}"\n')
    bench.configure("[realtime]\nfifo_priority = 20\n")  # as the system service; else a warning
    bench.folder.chmod(0o711)  # for the flooder of another user
    tcp = [f"tcp://{address}", str(folder / "hapticd.key"), str(folder / "eve.key_secret")]
    return {"ipc": [str(bench.runtime_dir)], "tcp": tcp}


def flooded(bench: Bench, kind: str, endpoint: list[str]) -> subprocess.Popen[str]:
    """A flooder that has begun."""
    flooder = bench.program(str(Path(__file__).with_name("flooder.py")), kind, *endpoint)
    assert flooder.stdout is not None
    assert flooder.stdout.readline() == "ready\n"
    return flooder


@pytest.mark.parametrize(("kind", "transport"), [("closing", "tcp"), ("expensive", "ipc")])
def test_while_another_user_floods_each_hello_is_answered(bench: Bench, kind: str, transport: str) -> None:
    endpoint = served_over_both(bench)[transport]
    client = bench.driven()[2]
    flooded(bench, kind, endpoint)
    t_end_s = time.monotonic() + FLOOD_S
    hellos_s = []
    with zmq.Context() as context:
        while time.monotonic() < t_end_s:
            t_begin_s = time.monotonic()
            control = Control(context, find(endpoint[0], {}, *endpoint[1:]))
            control.request("hello", timeout_s=PATIENCE_S)
            control.close()
            hellos_s.append(time.monotonic() - t_begin_s)
    status = client.status()
    print(f"\n{kind}  {transport}  {len(hellos_s)} hellos,", end=" ")
    print(f"median {1e3 * median(hellos_s):.0f} ms, worst {1e3 * max(hellos_s):.0f} ms")
    assert len(hellos_s) >= FLOOD_S * MIN_HELLOS_HZ
    signs = {"closing": status["clients"]["gone_early"], "expensive": len(status["surfaces"])}
    assert signs[kind] > 0  # there was a flood


@pytest.mark.parametrize(("kind", "transport"), [*zip(("none", *KINDS), cycle(("ipc", "tcp")))])
def test_a_flood_takes_neither_memory_nor_the_states_of_others(bench: Bench, kind: str, transport: str) -> None:
    endpoints = served_over_both(bench)
    _, service, client, _ = bench.driven()
    states = client.states(timeout_s=10.0)
    if kind != "none":
        flooder = flooded(bench, kind, endpoints[transport])
    t_end_s = time.monotonic() + FLOOD_S
    instants_ns = []
    while time.monotonic() < t_end_s:
        instants_ns.append(next(states).t_ns)
    gap_ms = max(after_ns - before_ns for before_ns, after_ns in pairwise(instants_ns)) * 1e-6
    flooded_mb = resident_mb(service.process.pid)
    if kind != "none":
        flooder.kill()
    wait_for(lambda: client.status()["state"] == "ACTIVE")
    left_mb = resident_mb(service.process.pid)
    trips = client.status()["board"]["deadman_trips"]
    print(f"\n{kind:14} {transport}  gap {gap_ms:5.1f} ms  RSS {flooded_mb:5.1f} MB, then {left_mb:5.1f} MB", end="")
    print(f"  dead-man trips {trips}")
    assert max(flooded_mb, left_mb) <= MAX_RSS_MB
    assert len(instants_ns) >= FLOOD_S * MIN_STATES_HZ
