"""The budget of processor time: a burst, a share of the time, and debts that end."""

from __future__ import annotations

import pytest

from hapticd.io.time_budget import TimeBudget

MS = 1_000_000


class Source:
    """Items of `cost_ns` that come without a pause, for `span_ns` on a clock of its own."""

    def __init__(self, share: float, burst_ns: int) -> None:
        self.t_ns = self.ran_ns = 0
        self.budget = TimeBudget(share, burst_ns, clock_ns=lambda: self.t_ns, processor_ns=lambda: self.ran_ns)

    def handle(self, cost_ns: int, waited_ns: int = 0) -> bool:
        if not self.budget.has_time:
            return False
        with self.budget:
            self.ran_ns += cost_ns
        self.t_ns += cost_ns + waited_ns
        return True

    def ran_in(self, span_ns: int, cost_ns: int) -> int:
        end_ns, before_ns = self.t_ns + span_ns, self.ran_ns
        while self.t_ns < end_ns:
            if not self.handle(cost_ns):
                self.t_ns += max(round(self.budget.wait_s * 1e9), 1)
        return self.ran_ns - before_ns


@pytest.mark.parametrize("cost_ns", [10_000, 3 * MS, 40 * MS])
def test_a_source_has_its_share_of_a_second_whatever_an_item_costs(cost_ns: int) -> None:
    source = Source(share=0.1, burst_ns=2 * MS)
    assert 98 * MS <= source.ran_in(1000 * MS, cost_ns) <= 102 * MS + cost_ns


def test_a_burst_after_a_pause_is_no_longer_than_the_bound() -> None:
    source = Source(share=0.1, burst_ns=2 * MS)
    source.t_ns += 10_000 * MS
    items = 0
    while source.handle(100_000):
        items += 1
    assert items == 22 or items == 23  # two more, by the time that they take
