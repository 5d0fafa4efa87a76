"""Rate limit and identity of senders."""

from __future__ import annotations

import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from hapticd.io.clients.senders import BURST, RATE_HZ, UNKNOWN, RateLimiter, remote_user

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
    ("frame", "user"),
    [
        (Frame(User_Id="Z" * 40), "key study-7"),
        (Frame(User_Id="Y" * 40, Peer_Address="localhost:7:7:7"), UNKNOWN),
        (Frame(X_Hapticd_Peer="0:1:1"), UNKNOWN),
    ],
)
def test_the_key_names_remote_users(frame: zmq.Frame, user: str) -> None:
    assert remote_user(frame, KEYS) == user


@given(st.lists(st.floats(0.0, 0.05), max_size=400), st.floats(-1e9, 1e9))
def test_no_connection_exceeds_its_rate(waits_s: list[float], t_start_s: float) -> None:
    rate_limiter, admitted, t_s = RateLimiter(t_start_s), 0, t_start_s
    for wait_s in waits_s:
        t_s += wait_s
        admitted += rate_limiter.admit(t_s)
        assert admitted <= BURST + (t_s - t_start_s) * RATE_HZ + 1
