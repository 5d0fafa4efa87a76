"""`systemctl reload`: a new configuration while fingers are driven, and what it costs them."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from service import Bench, drive, first, resident_mb, wait_for

PULSE_S = 0.002
STOOD_STILL_S = 0.030  # the board waits 50 ms from a keep-alive, and one comes every 20


@contextmanager
def pulse() -> Iterator[list[float]]:
    """A thread that wakes every PULSE_S; records the longest delay, s, of any thread on this machine."""
    longest_s, stop = [0.0], threading.Event()

    def beat() -> None:
        t_last_s = time.monotonic()
        while not stop.wait(PULSE_S):
            t_last_s, before_s = time.monotonic(), t_last_s
            longest_s[0] = max(longest_s[0], t_last_s - before_s)

    beating = threading.Thread(target=beat)
    beating.start()
    try:
        yield longest_s
    finally:
        stop.set()
        beating.join()


@pytest.mark.alone
def test_reloads_in_a_row_trip_no_dead_man_and_leave_nothing_behind(bench: Bench) -> None:
    first(bench.rig().process)
    service = bench.service()
    plain = bench.config.read_text(encoding="utf-8")
    with pulse() as longest_s:
        for period_ms in (11.0, 12.0, 11.0):  # the first was read at the start
            client = bench.client()
            drive(client)
            client.close()
            bench.config.write_text(f"{plain}[prediction]\nperiod_ms = {period_ms}\n", encoding="utf-8")
            served = len(service.lines_with("serving clients in"))
            service.process.send_signal(signal.SIGHUP)
            wait_for(lambda served=served: len(service.lines_with("serving clients in")) > served)  # type: ignore[misc]
        client = bench.client()
        drive(client)
        trips = client.status()["board"]["deadman_trips"]
    assert resident_mb(service.process.pid) <= 66.0  # with both periods' gains; 52 at the start
    if trips > 0 and longest_s[0] > STOOD_STILL_S:
        pytest.skip(f"this machine stood still for {1000.0 * longest_s[0]:.0f} ms, which is the dead-man's business")
    assert trips == 0


def test_a_running_service_takes_at_most_60_mb(bench: Bench) -> None:
    _, service, _, _ = bench.driven()
    assert resident_mb(service.process.pid) <= 60.0
