"""WebSockets of pages and programs: read at a pace, by the time that the messages cost, and JSON as plain values."""

from __future__ import annotations

import asyncio
import binascii
import json
import math
import time
from collections import deque
from collections.abc import Callable, Coroutine, Sized
from contextlib import suppress
from typing import Any, Final, NoReturn

from aiohttp import WSCloseCode, WSMessage, web

from ...errors import RequestError
from ...io.time_budget import TimeBudget
from ...wire.client import distinct

HEARTBEAT_S: Final = 10.0
PING_S: Final = 0.25  # without another message: the second one to a page that was killed fails
MAX_UNREAD_BYTES: Final = 256 * 1024  # of replies, as the daemon has it
MESSAGES_HZ, BURST = 200.0, 100  # a page sends one per picture of the screen
SHARE, BURST_NS = 0.05, 10_000_000  # of the processor's time, for each sender: 16 leave a fifth
SHORTEST_S: Final = 1e-3  # of a wait
MAX_CONTAINERS, MAX_ITEMS = 8192, 24_576  # of one text: 64 KiB of MessagePack have fewer
BYTE_FIELDS: Final = frozenset({"asset", "levels", "part"})  # base64; no field of such a name holds a text
MAX_EXACT: Final = 2.0**53


class Pace(TimeBudget):
    """Spreads what one sender sends: `rate_hz` in the long run, `burst` at once, and SHARE of the processor's time.

    What is handled within `with pace:` is paid for by the next message. What is beyond waits at the sender.
    """

    def __init__(
        self,
        rate_hz: float = MESSAGES_HZ,
        burst: int = BURST,
        *,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        processor_ns: Callable[[], int] = time.thread_time_ns,
    ) -> None:
        super().__init__(SHARE, BURST_NS, clock_ns=clock_ns, processor_ns=processor_ns)
        self._period_s, self._burst_s = 1.0 / rate_hz, burst / rate_hz
        self._t_next_s = -math.inf

    def reserve(self) -> float:
        """Account for one message; return the time until the rate admits the next, in s."""
        t_s = self._clock_ns() * 1e-9
        self._t_next_s = max(self._t_next_s, t_s - self._burst_s) + self._period_s
        return max(self._t_next_s - t_s, 0.0)

    async def wait(self) -> None:
        """Return when the next message may be taken."""
        await asyncio.sleep(self.reserve())
        while not self.has_time:
            await asyncio.sleep(max(self.wait_s, SHORTEST_S))


async def opened(
    request: web.Request, max_bytes: int, others: Sized, most: int, what: str = "connections"
) -> web.WebSocketResponse:
    """Return the WebSocket of a request, closed if there are too many `others`: a browser hides why one is refused."""
    socket = web.WebSocketResponse(max_msg_size=max_bytes, heartbeat=HEARTBEAT_S, compress=False)
    await socket.prepare(request)
    if len(others) >= most:
        why = f"{most} {what} are open already: close one."
        await socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=why.encode())
    return socket


async def read(socket: web.WebSocketResponse, pace: Pace, take: Callable[[WSMessage], None]) -> None:
    """Take messages until the socket is closed."""
    async for message in socket:
        with pace:
            take(message)
        await pace.wait()


class Outbox:
    """Texts that wait to be sent: replies in their order, before the newest of each kind of news, at most `most`."""

    def __init__(self, most: int) -> None:
        self.is_overfull = False  # of replies: the socket is to be closed
        self._most = most
        self._replies: deque[str] = deque()
        self._news: dict[object, str] = {}
        self._unread_bytes = 0
        self._ready = asyncio.Event()

    def add(self, reply: str) -> None:
        """Queue a reply."""
        self._unread_bytes += len(reply)
        self.is_overfull = self._unread_bytes > MAX_UNREAD_BYTES
        self._replies.append(reply)
        self._ready.set()

    def newest(self, kind: object, news: str) -> None:
        """Queue news instead of those of this kind that wait; the oldest give way."""
        self._news.pop(kind, None)
        self._news[kind] = news
        if len(self._news) > self._most:
            del self._news[next(iter(self._news))]
        self._ready.set()

    async def write(self, socket: web.WebSocketResponse) -> None:
        """Send what is queued until the socket is closed or too many replies wait."""
        while not socket.closed and not self.is_overfull:
            try:
                await asyncio.wait_for(self._ready.wait(), PING_S)
            except TimeoutError:
                await socket.ping()
            self._ready.clear()
            while (self._replies or self._news) and not self.is_overfull:
                await socket.send_str(self._next())

    def _next(self) -> str:
        if not self._replies:
            return self._news.pop(next(iter(self._news)))
        text = self._replies.popleft()
        self._unread_bytes -= len(text)
        return text


async def until_one_ends(*work: Coroutine[Any, Any, None]) -> None:
    """Run until one of them ends; so of a page that has gone nothing is read as soon as it cannot be written to."""
    tasks = [asyncio.ensure_future(one) for one in work]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


# --- texts ------------------------------------------------------------------------------------------------------


def decoded(text: str) -> object:
    """Return the plain values of a JSON text: 2.0 as 2, base64 as bytes where it is some. Raises RequestError."""
    if text.count("[") + text.count("{") > MAX_CONTAINERS or text.count(",") > MAX_ITEMS:
        raise RequestError(f"The message has more than {MAX_CONTAINERS} maps and lists, or {MAX_ITEMS} items.")
    try:
        return json.loads(text, object_pairs_hook=_map, parse_float=_parsed, parse_constant=_not_finite)
    except (ValueError, RecursionError):
        raise RequestError("The message is not JSON, or too deep.") from None


def number(value: float) -> float:
    """Return a float as a whole number if it is one: TouchOSC, Pure Data and some writers of JSON have only floats."""
    return int(value) if value.is_integer() and abs(value) <= MAX_EXACT else value


def _parsed(digits: str) -> float:
    return number(float(digits))


def _map(pairs: list[tuple[object, object]]) -> dict[object, object]:
    table = distinct(pairs)
    for name in BYTE_FIELDS.intersection(table):
        if isinstance(value := table[name], str):
            with suppress(ValueError):  # also of what is not ASCII: it stays, and is refused as no bytes
                table[name] = binascii.a2b_base64(value, strict_mode=True)
    return table


def _not_finite(name: str) -> NoReturn:
    raise RequestError(f"The message contains {name}, which is no number of JSON.")
