"""Periodic timer, garbage collector and real-time settings."""

from __future__ import annotations

import asyncio
import os
import time

import pytest
from asynchronous import PATIENCE_S, asynchronous

from hapticd.io.host import realtime
from hapticd.io.host.realtime import Granted, PeriodicTimer, go_real_time

MS = 1_000_000


async def ticks(count: int, *, period_ns: int, stall_ns: int = 0) -> list[tuple[int, int]]:
    """(late_ns, missed) of the first `count` ticks, the loop being held for `stall_ns` before the first."""
    calls: list[tuple[int, int]] = []
    enough = asyncio.Event()

    def on_due(late_ns: int, missed: int) -> None:
        calls.append((late_ns, missed))
        if len(calls) >= count:
            enough.set()

    timer = PeriodicTimer(asyncio.get_running_loop(), period_ns, on_due)
    t_free_ns = time.monotonic_ns() + stall_ns
    while time.monotonic_ns() < t_free_ns:
        pass
    await asyncio.wait_for(enough.wait(), PATIENCE_S)
    timer.close()
    return calls


def test_what_fell_due_while_the_loop_was_busy_is_skipped_and_counted() -> None:
    (late_ns, missed), *_ = asyncio.run(ticks(2, period_ns=2 * MS, stall_ns=11 * MS))
    assert missed >= 4
    assert late_ns >= 0


@asynchronous
async def test_a_period_can_be_changed_from_within_a_tick() -> None:
    periods: list[int] = []

    enough = asyncio.Event()

    def on_due(_late_ns: int, _missed: int) -> None:
        periods.append(timer.period_ns)
        timer.set_period(timer.period_ns // 2)
        if len(periods) == 3:
            enough.set()

    timer = PeriodicTimer(asyncio.get_running_loop(), 4 * MS, on_due)
    await asyncio.wait_for(enough.wait(), PATIENCE_S)
    timer.close()
    assert periods == [4 * MS, 2 * MS, MS]


def test_refusals_of_the_kernel_are_returned_as_sentences(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "sched_setaffinity", refuse)
    monkeypatch.setattr(realtime, "_lock_memory", lambda refused: refused.append("mlockall: no") or False)
    granted = go_real_time(fifo_priority=20, processor=0)
    assert granted == Granted(
        0,
        tuple(sorted(os.sched_getaffinity(0))),
        False,
        ("processor 0: Operation not permitted", "SCHED_FIFO at 20: Operation not permitted", "mlockall: no"),
    )


def test_settings_apply_to_this_thread_and_not_to_later_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    requests: list[tuple[int, int]] = []
    monkeypatch.setattr(
        os, "sched_setscheduler", lambda _, policy, param: requests.append((policy, param.sched_priority))
    )
    go_real_time(fifo_priority=20)
    assert requests == [(os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, 20)]
