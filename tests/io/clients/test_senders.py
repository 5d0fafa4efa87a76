"""Rate limit and identity of senders."""

from __future__ import annotations

import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from hapticd.io.clients.senders import BURST, MAX_SENDERS, RATE_HZ, UNKNOWN, RateLimiter, Sender, remote_sender

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
        (Frame(User_Id="Z" * 40), Sender("key study-7", "key study-7")),
        (Frame(User_Id="Y" * 40, Peer_Address="localhost:7:7:7"), UNKNOWN),
        (Frame(X_Hapticd_Peer="0:1:1"), UNKNOWN),
    ],
)
def test_the_key_names_remote_senders(frame: zmq.Frame, sender: Sender) -> None:
    assert remote_sender(frame, KEYS) == sender


def test_a_pause_earns_a_burst_and_no_more() -> None:
    rate_limiter = RateLimiter()
    for t_s in (5.0, 1e6):
        assert [rate_limiter.admit("a", t_s) for _ in range(BURST + 2)] == [True] * BURST + [False] * 2
        assert [rate_limiter.admit("a", t_s + 1.5 / RATE_HZ) for _ in range(2)] == [True, False]


def test_a_flood_does_not_delay_other_senders() -> None:
    rate_limiter = RateLimiter()
    for _ in range(10 * BURST):
        rate_limiter.admit("rude", 0.0)
    assert rate_limiter.admit("polite", 0.0)


def test_invented_senders_are_bounded() -> None:
    rate_limiter = RateLimiter()
    for n in range(10 * MAX_SENDERS):
        rate_limiter.admit(f"invented {n}", 0.0)
    assert len(rate_limiter._buckets) == MAX_SENDERS


@given(st.lists(st.tuples(st.sampled_from("abc"), st.floats(0.0, 0.05)), max_size=400), st.floats(-1e9, 1e9))
def test_no_sender_exceeds_its_rate(arrivals: list[tuple[str, float]], t_s: float) -> None:
    rate_limiter, admitted, t_start_s = RateLimiter(), dict.fromkeys("abc", 0), t_s
    for source, wait_s in arrivals:
        t_s += wait_s
        admitted[source] += rate_limiter.admit(source, t_s)
        assert admitted[source] <= BURST + (t_s - t_start_s) * RATE_HZ + 1
