"""Messages of pages and programs: their pace by rate and by cost, and JSON as plain values."""

from __future__ import annotations

import asyncio

import pytest
from asynchronous import VirtualTimeLoop, asynchronous, until

from hapticd.errors import RequestError
from hapticd.tools.web import sockets
from hapticd.tools.web.sockets import Outbox, Pace, decoded


@pytest.mark.parametrize(
    ("cost_s", "count", "takes_s"),
    [
        (0.0, sockets.BURST + 400, 400 / sockets.MESSAGES_HZ),
        (1e-4, sockets.BURST + 400, 400 / sockets.MESSAGES_HZ),  # 0.1 ms at 200 Hz is less than the share
        (0.002, 500, (500 * 0.002 - 0.01) / sockets.SHARE),
        (0.040, 5, (5 * 0.040 - 0.01) / sockets.SHARE),
    ],
)
def test_messages_are_paced_by_their_rate_or_by_what_they_cost(cost_s: float, count: int, takes_s: float) -> None:
    async def paced() -> float:
        loop, spent_s = asyncio.get_running_loop(), 0.0
        pace = Pace(clock_ns=lambda: round(loop.time() * 1e9), processor_ns=lambda: round(spent_s * 1e9))
        t_begin_s = loop.time()
        for _ in range(count):
            with pace:
                spent_s += cost_s
            await pace.wait()
        return loop.time() - t_begin_s

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        assert runner.run(paced()) == pytest.approx(takes_s, rel=2e-3)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("[1.0, -2e0, 0.5, 1e300]", [1, -2, 0.5, 1e300]),
        ('{"v": 1.0, "fields": {"trial": 7.0}}', {"v": 1, "fields": {"trial": 7}}),
        ('{"asset": "AAEC", "part": "?", "name": "AAEC"}', {"asset": b"\0\1\2", "part": "?", "name": "AAEC"}),
    ],
)
def test_a_text_becomes_plain_values_with_whole_numbers_and_bytes(text: str, value: object) -> None:
    assert repr(decoded(text)) == repr(value)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{", "not JSON"),
        ("[" * 8000, "not JSON, or too deep"),
        ("[" * 100_000, "more than 8192 maps and lists"),
        ("[" + "[]," * 40_000 + "[]]", "more than 8192 maps and lists"),
        ("[" + "1," * 60_000 + "1]", "or 24576 items"),
        ("9" * 6000, "not JSON"),
        ("[NaN]", "NaN, which is no number of JSON"),
        ('{"v": 1, "v": 1}', "same key twice"),
    ],
)
def test_another_text_is_refused_in_a_sentence(text: str, sentence: str) -> None:
    with pytest.raises(RequestError, match=sentence):
        decoded(text)


@asynchronous
async def test_a_reader_who_leaves_replies_unread_is_to_be_disconnected() -> None:
    box = Outbox(50)
    box.add("x" * sockets.MAX_UNREAD_BYTES)
    assert not box.is_overfull
    box.add("x")
    assert box.is_overfull


class Sent:
    """A WebSocket that keeps what is sent."""

    closed = False

    def __init__(self) -> None:
        self.texts: list[str] = []

    async def send_str(self, text: str) -> None:
        self.texts.append(text)


@pytest.mark.parametrize("newest", [True, False])
@asynchronous
async def test_a_slow_reader_has_a_bounded_number_of_news_waiting(newest: bool) -> None:
    box, socket = Outbox(50), Sent()
    numbers = [str(number) for number in range(50 + 5)]
    for number in numbers:
        box.newest("kind" if newest else number, number)
    box.add("reply")
    writing = asyncio.ensure_future(box.write(socket))  # type: ignore[arg-type]
    await until(lambda: numbers[-1] in socket.texts)
    writing.cancel()
    assert socket.texts == ["reply", *(numbers[-1:] if newest else numbers[5:])]
