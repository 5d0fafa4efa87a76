"""Rate limit and identity of senders."""

from __future__ import annotations

import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from hapticd.io.clients.senders import BURST, MAX_SENDERS, RATE_HZ, RateLimiter, Sender, sender_of

KEYS = {"Z" * 40: "study-7"}


class Frame:
    """A frame with the properties set by libzmq."""

    def __init__(self, **properties: str) -> None:
        self._properties = {name.replace("_", "-"): value for name, value in properties.items()}

    def get(self, name: str) -> str:
        if name not in self._properties:
            raise zmq.ZMQError(22)
        return self._properties[name]


@pytest.mark.parametrize(
    ("frame", "sender"),
    [
        (Frame(X_Hapticd_Peer="1000:4242:3"), Sender("uid 1000", "process 4242 of uid 1000", 3)),
        (Frame(X_Hapticd_Peer="0:-1:0"), Sender("uid 0", "process -1 of uid 0", 0)),
        (Frame(User_Id="Z" * 40), Sender("key study-7", "key study-7")),
        (Frame(X_Hapticd_Peer="7:7:7", User_Id="Z" * 40), Sender("key study-7", "key study-7")),
        (Frame(X_Hapticd_Peer="7:7:7", User_Id="Y" * 40), Sender("an unknown user", "an unknown user")),
        (Frame(Peer_Address="localhost:7:7:7"), Sender("an unknown user", "an unknown user")),
        (Frame(), Sender("an unknown user", "an unknown user")),
    ],
)
def test_the_kernel_names_local_senders_and_the_key_names_remote_ones(frame: zmq.Frame, sender: Sender) -> None:
    assert sender_of(frame, KEYS) == sender


def test_a_pause_earns_a_burst_and_no_more() -> None:
    rate_limiter: RateLimiter[int] = RateLimiter(queue_length=1)
    for t_s in (5.0, 1e6):
        assert [rate_limiter.admit("a", n, t_s) for n in range(BURST + 2)] == [True] * BURST + [False] * 2
        assert list(rate_limiter.due(t_s + 1.5 / RATE_HZ)) == [BURST + 1]


def test_the_newest_of_a_flood_is_handled_in_the_end_and_the_others_are_counted() -> None:
    rate_limiter: RateLimiter[int] = RateLimiter(queue_length=1)
    admitted = [n for n in range(1000) if rate_limiter.admit("a", n, 0.0)]
    assert rate_limiter.is_waiting
    assert admitted + list(rate_limiter.due(60.0)) == [*range(BURST), 999]
    assert rate_limiter.lost == 1000 - BURST - 1
    assert not rate_limiter.is_waiting


def test_what_waits_is_handled_before_what_comes_later() -> None:
    rate_limiter: RateLimiter[int] = RateLimiter(queue_length=4)
    for n in range(BURST + 2):
        rate_limiter.admit("a", n, 0.0)
    assert not rate_limiter.admit("a", BURST + 2, 60.0)
    assert list(rate_limiter.due(60.0)) == [BURST, BURST + 1, BURST + 2]


def test_a_flood_does_not_delay_other_senders() -> None:
    rate_limiter: RateLimiter[str] = RateLimiter(queue_length=1)
    for _ in range(10 * BURST):
        rate_limiter.admit("rude", "spam", 0.0)
    assert rate_limiter.admit("polite", "please", 0.0)


def test_invented_senders_are_bounded_and_what_waited_for_the_forgotten_is_counted() -> None:
    rate_limiter: RateLimiter[int] = RateLimiter(queue_length=8)
    for n in range(BURST + 3):
        rate_limiter.admit("first", n, 0.0)
    for n in range(MAX_SENDERS):
        rate_limiter.admit(f"invented {n}", n, 0.0)
    assert rate_limiter.lost == 3
    assert not rate_limiter.is_waiting


@given(
    st.lists(st.tuples(st.sampled_from("abc"), st.floats(0.0, 0.05)), max_size=400),
    st.integers(1, 8),
    st.floats(-1e9, 1e9),
)
def test_no_sender_exceeds_its_rate_keeps_its_order_and_every_loss_is_counted(
    arrivals: list[tuple[str, float]], patience: int, t_s: float
) -> None:
    rate_limiter: RateLimiter[tuple[str, int]] = RateLimiter(patience)
    handled: list[tuple[str, int]] = []
    t_start_s = t_s
    for n, (source, wait_s) in enumerate(arrivals):
        t_s += wait_s
        handled += rate_limiter.due(t_s)
        if rate_limiter.admit(source, (source, n), t_s):
            handled.append((source, n))
    for source in "abc":
        mine = [n for sender, n in handled if sender == source]
        assert mine == sorted(mine)
        assert len(mine) <= BURST + (t_s - t_start_s) * RATE_HZ + 1
    handled += rate_limiter.due(t_s + 3600.0)
    assert len(handled) + rate_limiter.lost == len(arrivals)
