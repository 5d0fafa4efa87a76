"""Three clocks on one axis: accuracy under jitter and drift, steps, wraps, hostile answers."""

from __future__ import annotations

import random
import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.board_protocol import BoardTime
from hapticd.core.board.link import BoardClock, LinkLatency
from hapticd.core.touch.sensor_clock import SensorClock

US, MS, S = 1_000, 1_000_000, 1_000_000_000
WRAP_US = 2**32


# --- the trackpad's clock -----------------------------------------------------------------------------------------


class Pad:
    """A trackpad that samples every 11.25 ms; its reports take `latency_ns` and up to `late_ms` more, or more rarely
    `tail_ms` more, on average."""

    def __init__(
        self,
        *,
        stamp_ms: float = 1.0,
        late_ms: float = 2.0,
        tail_ms: float = 0.0,
        ppm: float = 0.0,
        origin_ns: int = 0,
        seed: int = 1,
    ) -> None:
        self.random = random.Random(seed)
        self.stamp_ms, self.late_ms, self.tail_ms, self.ppm = stamp_ms, late_ms, tail_ms, ppm
        self.origin_ns = origin_ns
        self.latency_ns = 10 * MS
        self.device_offset_ns = 777 * S
        self.t_ns = 0

    def report(self) -> tuple[int, int, int, int]:
        """Stamp, arrival, the true sampling instant, and the stamp without its error."""
        self.t_ns += 11_250_000
        exact = round(self.t_ns * (1 + self.ppm * 1e-6)) + self.device_offset_ns
        stamp = exact + round(self.random.uniform(-self.stamp_ms, self.stamp_ms) * MS)
        sampled = self.origin_ns + self.t_ns
        late_ms = self.random.uniform(0, self.late_ms) + self.tail_ms * self.random.expovariate(1.0)
        arrival = sampled + self.latency_ns + round(late_ms * MS)
        return stamp, arrival, sampled, exact


def error_ns(pad: Pad, clock: SensorClock) -> int:
    """How far the next report is taken to be from its true sampling instant."""
    stamp, arrival, sampled, _ = pad.report()
    return abs(clock.update(stamp, arrival) - sampled)


def settled_errors_ms(pad: Pad, clock: SensorClock, reports: int = 3000, after: int = 300) -> list[float]:
    """How far an exact stamp would be mapped from its true instant, once the window is full or `after` reports."""
    errors = []
    for index in range(reports):
        stamp, arrival, sampled, exact = pad.report()
        clock.update(stamp, arrival)
        if index > after:
            errors.append((exact + clock.offset_ns - sampled) / MS)
    return errors


@pytest.mark.parametrize("ppm", [0.0, 200.0, -200.0])
def test_under_jitter_and_drift_the_sampling_instants_are_nearly_free_of_bias(ppm: float) -> None:
    clock = SensorClock(10 * MS)
    errors = settled_errors_ms(Pad(ppm=ppm), clock)
    assert abs(statistics.mean(errors)) < 0.25
    assert statistics.pstdev(errors) < 0.2
    assert clock.relocks == 0


@pytest.mark.parametrize("stamp_ms", [1.0, 2.0])
@pytest.mark.parametrize(
    ("late_ms", "tail_ms"), [(0.0, 0.0), (0.125, 0.0), (1.0, 0.0), (4.0, 0.0), (0.0, 0.3), (0.0, 1.0)]
)
def test_with_late_reports_and_wrong_stamps_the_bias_stays_near_0_1_ms(
    stamp_ms: float, late_ms: float, tail_ms: float
) -> None:
    pad = Pad(stamp_ms=stamp_ms, late_ms=late_ms, tail_ms=tail_ms)
    assert abs(statistics.mean(settled_errors_ms(pad, SensorClock(10 * MS)))) < 0.12


def test_after_half_a_second_the_bias_is_small_whatever_the_first_stamps_were() -> None:
    early = [
        statistics.mean(settled_errors_ms(Pad(late_ms=0.0, seed=seed), SensorClock(10 * MS), reports=45, after=20))
        for seed in range(40)
    ]
    assert abs(statistics.mean(early)) < 0.15
    assert statistics.pstdev(early) < 0.25


def test_the_first_report_is_usable_and_nothing_was_sampled_after_it_was_read() -> None:
    pad, clock = Pad(), SensorClock(10 * MS)
    for _ in range(300):
        stamp, arrival, sampled, _ = pad.report()
        t_sample_ns = clock.update(stamp, arrival)
        assert abs(t_sample_ns - sampled) < 4 * MS
        assert t_sample_ns <= arrival - 10 * MS


@pytest.mark.parametrize("step_ns", [-700 * S, -100 * MS, 40 * MS, 3600 * S])
def test_a_step_of_the_device_clock_is_followed_at_once(step_ns: int) -> None:
    pad, clock = Pad(), SensorClock(10 * MS)
    settled_errors_ms(pad, clock, 400)
    pad.device_offset_ns += step_ns
    assert max(error_ns(pad, clock) for _ in range(50)) < 4 * MS
    assert clock.relocks >= 1


# --- the board's clock --------------------------------------------------------------------------------------------


class Link:
    """A board whose counter is about to wrap, behind a link with a random delay each way."""

    def __init__(self, *, ppm: float = 0.0, jitter_ms: float = 0.5, start_us: int = -5 * 10**6):
        self.random = random.Random(2)
        self.ppm, self.jitter_ms = ppm, jitter_ms
        self.start_us = start_us
        self.t_boot_ns = 10**12
        self.t_ns = 10**12

    def board_us(self, t_ns: int) -> int:
        ticked_ns = (t_ns - self.t_boot_ns) * (1 + self.ppm * 1e-6)
        return (self.start_us + int(ticked_ns / 1000)) % WRAP_US

    def delay_ns(self) -> int:
        return round((0.3 + self.random.expovariate(1.0) * self.jitter_ms) * MS)

    def ask(self, clock: BoardClock, after_ns: int = 500 * MS) -> bool:
        """One exchange; the link's time is then that of the answer's receipt."""
        self.t_ns += after_ns
        sent_ns = clock.request(self.t_ns)
        arrived_ns = sent_ns + self.delay_ns()
        left_ns = arrived_ns + 50 * US
        self.t_ns = left_ns + self.delay_ns()
        return clock.update(BoardTime(sent_ns, self.board_us(arrived_ns), self.board_us(left_ns)), self.t_ns)

    def error_us(self, clock: BoardClock) -> int:
        t_ns = self.t_ns + 20 * MS
        off_us = clock.to_board_us(t_ns) - self.board_us(t_ns)
        return (off_us + WRAP_US // 2) % WRAP_US - WRAP_US // 2


@pytest.mark.parametrize("ppm", [0.0, 100.0, -100.0])
def test_the_board_clock_holds_through_jitter_drift_and_the_wrap(ppm: float) -> None:
    link, clock = Link(ppm=ppm), BoardClock()
    errors = []
    for index in range(200):
        assert link.ask(clock)
        assert clock.ready == (index >= 3)
        if index >= 20:
            errors.append(link.error_us(clock))
            assert abs(errors[-1]) * US < clock.error_ns
    assert abs(statistics.mean(errors)) < 20
    assert max(map(abs, errors)) < 150
    assert clock.rate_ppm == pytest.approx(ppm, abs=15)
    assert clock.relocks == 0


@given(ahead_ns=st.integers(-30 * 60 * S, 30 * 60 * S), start_us=st.integers(0, WRAP_US - 1))
def test_there_and_back_is_the_same_instant_however_the_counter_stands(ahead_ns: int, start_us: int) -> None:
    link, clock = Link(start_us=start_us, ppm=50.0), BoardClock()
    for _ in range(6):
        link.ask(clock)
    t_ns = link.t_ns + ahead_ns
    board_us = clock.to_board_us(t_ns)
    assert 0 <= board_us < WRAP_US
    assert abs(clock.to_host_ns(board_us, near=t_ns + 5 * S) - t_ns) <= 1 * US
    assert abs(clock.to_host_ns(board_us, near=t_ns - 5 * S) - t_ns) <= 1 * US


def test_the_shortest_round_trips_decide() -> None:
    """One exchange in four is quick, the others are delayed one way only by 20 ms."""
    clock, link = BoardClock(), Link(jitter_ms=0.0)
    for index in range(64):
        link.t_ns += 100 * MS
        sent_ns = clock.request(link.t_ns)
        there_ns = 300 * US if index % 4 == 0 else 20 * MS
        board_us = link.board_us(sent_ns + there_ns)
        clock.update(BoardTime(sent_ns, board_us, board_us), sent_ns + there_ns + 300 * US)
    assert abs(link.error_us(clock)) < 20
    assert clock.rtt_ns == 600 * US


def test_a_reboot_is_seen_in_one_exchange_and_must_be_confirmed() -> None:
    link, clock = Link(), BoardClock()
    for _ in range(30):
        link.ask(clock)
    link.start_us, link.t_boot_ns = 0, link.t_ns
    link.ask(clock)
    assert clock.relocks == 1
    assert not clock.ready
    for _ in range(3):
        link.ask(clock)
    assert clock.ready
    assert abs(link.error_us(clock)) < 1500
    assert clock.relocks == 1


@pytest.mark.parametrize(
    ("stamp_ns", "received_us", "sent_us", "t_received_ns"),
    [
        (10 * S + 1, 0, 0, 10 * S + MS),  # never sent
        (20 * S, 0, 0, 19 * S),  # from the future
        (10 * S, 0, 0, 12 * S),  # too long ago
        (10 * S, 0, 5000, 10 * S + MS),  # the board held it longer than it was away
        (10 * S, 5000, 4999, 10 * S + MS),  # answered before it came
    ],
)
def test_a_hostile_answer_is_ignored(stamp_ns: int, received_us: int, sent_us: int, t_received_ns: int) -> None:
    clock = BoardClock()
    clock.request(10 * S)
    clock.request(20 * S)
    assert not clock.update(BoardTime(stamp_ns, received_us, sent_us), t_received_ns)
    assert clock.rtt_ns == 0


@given(replies=st.lists(st.tuples(*[st.integers(0, 2**32 - 1)] * 2, st.integers(-S, 3 * S)), max_size=20))
def test_no_sequence_of_answers_breaks_the_clock(replies: list[tuple[int, int, int]]) -> None:
    clock = BoardClock()
    for index, (received_us, sent_us, rtt_ns) in enumerate(replies):
        clock.update(BoardTime(index * S, received_us, sent_us), index * S + rtt_ns)
    if clock.ready:
        assert 0 <= clock.to_board_us(10**15) < WRAP_US
        assert abs(clock.to_host_ns(5, near=10**15) - 10**15) <= WRAP_US * US


# --- the link -----------------------------------------------------------------------------------------------------


def test_the_link_latency_starts_at_5_ms_and_becomes_the_90_percent_quantile() -> None:
    latency, jitter = LinkLatency(), random.Random(3)
    for count in range(200):
        assert (latency.link_ns == 5 * MS) == (count < 8)
        latency.update(MS + round(jitter.random() * MS))
    assert 1.8 * MS < latency.link_ns < 2.0 * MS
    late = sum(jitter.random() * MS + MS > latency.link_ns for _ in range(1000))
    assert 20 < late < 200
