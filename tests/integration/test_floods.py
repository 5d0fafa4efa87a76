"""The worst that clients can do to a running service: its memory, and the gaps between the states of others.

`python -m pytest tests/integration/test_floods.py -n 0 -s` prints both. The gaps, from pass to pass by `t_ns`, are
printed only: without SCHED_FIFO they are also those of a machine that is busy with the flood.
"""

from __future__ import annotations

import time
from itertools import pairwise
from pathlib import Path

import pytest
from flooder import KINDS
from service import Bench, resident_mb, wait_for

from hapticd.io.clients import keys

FLOOD_S = 3.0
MAX_RSS_MB = 150.0
MIN_STATES_HZ = 30.0  # of ninety: they do not stop
PORT = 27610

pytestmark = pytest.mark.long


@pytest.mark.parametrize("transport", ["ipc", "tcp"])
@pytest.mark.parametrize("kind", ["none", *KINDS])
def test_a_flood_takes_neither_memory_nor_the_states_of_others(bench: Bench, kind: str, transport: str) -> None:
    folder = bench.folder / "keys"
    for name in ("hapticd", "eve"):
        keys.make_pair(folder, name)
    keys.allow(folder, folder / "eve.key")
    text = bench.config.read_text().replace("[client]", f'[client]\ntcp = "127.0.0.1:{PORT}"\nkeys_dir = "{folder}"')
    bench.config.write_text(text)
    bench.configure("[realtime]\nfifo_priority = 20\n")  # as the system service; else a warning
    _, service, client, _ = bench.driven()
    states = client.states(timeout_s=10.0)
    if kind != "none":
        where = [f"tcp://127.0.0.1:{PORT}", str(folder / "hapticd.key"), str(folder / "eve.key_secret")]
        endpoint = where if transport == "tcp" else [str(bench.runtime_dir)]
        flooder = bench.program(str(Path(__file__).with_name("flooder.py")), kind, *endpoint)
        assert flooder.stdout is not None
        assert flooder.stdout.readline() == "ready\n"
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
    print(f"\n{kind:14} {transport}  gap {gap_ms:5.1f} ms  RSS {flooded_mb:5.1f} MB, then {left_mb:5.1f} MB")
    assert max(flooded_mb, left_mb) <= MAX_RSS_MB
    assert len(instants_ns) >= FLOOD_S * MIN_STATES_HZ
