"""Clients by OSC, on one UDP port of this computer: each sender is a client of the daemon.

in    /hapticd/friction finger friction      /hapticd/amplitude finger amplitude_um
      /hapticd/release [finger]              /hapticd/marker text
      /hapticd/follow port                   fingers go to that port, for as long as this is repeated
out   /hapticd/finger id x_mm y_mm felt_friction target_um     -1 for what is not known
      /hapticd/error sentence

UDP has no end of a connection, so all that a sender set holds for HOLD_S after its last message, whatever that was.
"""

from __future__ import annotations

import asyncio
import json
import math
from typing import Any, Final, cast

import msgspec
import zmq
import zmq.asyncio

from hapticd_client.endpoint import Endpoint
from hapticd_contract.requests import MarkerRequest
from hapticd_contract.sentences import ContractError, converted
from hapticd_contract.targets import MAX_TARGETS, FingerTarget, TargetsMessage

from ...errors import RequestError
from ...wire.osc import BUNDLE, Argument, OscError, OscMessage, decoded, encoded
from .feed import Feed
from .peer import connected

HOLD_S: Final = 2.0
MAX_DATAGRAM_BYTES: Final = 1024
MAX_SENDERS: Final = 8
RATE_HZ, BURST = 200.0, 50  # of all senders together; those beyond are dropped
FIELDS: Final = {"/hapticd/friction": "friction", "/hapticd/amplitude": "amplitude_um"}
_Address = tuple[str, int]


class _Sender:
    def __init__(self) -> None:
        self.t_last_s = -math.inf
        self.targets: dict[int, FingerTarget] = {}
        self.follows: tuple[_Address, float] | None = None  # where to, and until when


class OscClients(asyncio.DatagramProtocol):
    """All senders of one port."""

    def __init__(self, context: zmq.asyncio.Context, endpoint: Endpoint, feed: Feed) -> None:
        self.dropped = 0
        self._feed = feed
        self._senders: dict[_Address, _Sender] = {}
        self._targets = connected(context, zmq.PUSH, endpoint, "targets")
        self._control = connected(context, zmq.DEALER, endpoint, "control")
        self._transport: asyncio.DatagramTransport | None = None
        self._tokens, self._t_tokens_s = float(BURST), 0.0
        self._id = 0
        self._is_closed = asyncio.Event()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.DatagramTransport", transport)  # Python 3.11 does not derive its own from that

    def datagram_received(self, data: bytes, addr: Any) -> None:
        t_s = asyncio.get_running_loop().time()
        if not self._has_token(t_s):
            self.dropped += 1
            return
        address: _Address = (str(addr[0]), int(addr[1]))
        try:
            self._take(_message(data), self._sender(address, t_s), address, t_s)
        except (OscError, RequestError, ContractError) as error:
            self._send(address, "/hapticd/error", str(error))

    def connection_lost(self, _: Exception | None) -> None:
        self._is_closed.set()

    async def close(self) -> None:
        """Close; what was set ends by itself."""
        self._feed.leave(id(self))
        if self._transport is not None:
            self._transport.abort()
            await self._is_closed.wait()
        self._targets.close(linger=0)
        self._control.close(linger=0)

    def _has_token(self, t_s: float) -> bool:
        self._tokens = min(self._tokens + (t_s - self._t_tokens_s) * RATE_HZ, float(BURST))
        self._t_tokens_s = t_s
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True

    def _sender(self, address: _Address, t_s: float) -> _Sender:
        self._senders = {one: kept for one, kept in self._senders.items() if t_s - kept.t_last_s < HOLD_S}
        if address not in self._senders and len(self._senders) >= MAX_SENDERS:
            raise RequestError(f"{MAX_SENDERS} senders are here already: wait until one has been silent for a while.")
        sender = self._senders.setdefault(address, _Sender())
        sender.t_last_s = t_s
        return sender

    def _take(self, message: OscMessage, sender: _Sender, address: _Address, t_s: float) -> None:
        name, given = message.address, message.arguments
        if name in FIELDS:
            target = converted(dict(zip(("finger", FIELDS[name]), given, strict=False)), FingerTarget)
            if not isinstance(target.finger, int):
                raise RequestError("finger: must be the id of a finger, a whole number.")
            if target.finger not in sender.targets and len(sender.targets) >= MAX_TARGETS:
                raise RequestError(f"A sender may hold {MAX_TARGETS} fingers at once: release one first.")
            sender.targets[target.finger] = target
        elif name == "/hapticd/release" and not given:
            sender.targets.clear()
        elif name == "/hapticd/release" and len(given) == 1 and isinstance(given[0], int):
            sender.targets.pop(given[0], None)
        elif name == "/hapticd/marker" and len(given) == 1:
            self._mark(converted({"client": _client(address), "text": given[0]}, MarkerRequest))
        elif name == "/hapticd/follow" and len(given) == 1 and isinstance(given[0], int) and 0 < given[0] < 65536:
            sender.follows = (address[0], given[0]), t_s + HOLD_S
            self._feed.follow(id(self), self._tell)
        else:
            raise RequestError(f"{name[:40]!r} with {len(given)} arguments is none of hapticd's messages.")
        holding = TargetsMessage(_client(address), HOLD_S, targets=tuple(sender.targets.values()), v=1)
        self._push(self._targets, msgspec.msgpack.encode(holding))

    def _mark(self, marker: MarkerRequest) -> None:
        self._id = self._id % (2**32 - 1) + 1
        self._push(self._control, msgspec.msgpack.encode({"v": 1, "id": self._id, "op": "marker", "body": marker}))

    @staticmethod
    def _push(socket: zmq.asyncio.Socket, payload: bytes) -> None:
        try:
            zmq.Socket.send(socket, payload, zmq.NOBLOCK)
        except zmq.ZMQError:
            raise RequestError("No hapticd answers: start one.") from None

    def _tell(self, text: str) -> None:
        t_s = asyncio.get_running_loop().time()
        followed = {one.follows[0] for one in self._senders.values() if one.follows and one.follows[1] > t_s}
        if not followed:
            self._feed.leave(id(self))
            return
        for finger in json.loads(text)["fingers"]:
            if isinstance(finger["id"], int) and finger["id"] < 2**31:  # as OSC has whole numbers
                values = [finger[name] for name in ("x_mm", "y_mm", "felt_friction", "target_um")]
                numbers = [-1.0 if value is None else float(value) for value in values]
                for address in followed:
                    self._send(address, "/hapticd/finger", finger["id"], *numbers)

    def _send(self, address: _Address, name: str, *arguments: Argument) -> None:
        if self._transport is not None:
            self._transport.sendto(encoded(name, *arguments), address)


def _message(datagram: bytes) -> OscMessage:
    if len(datagram) > MAX_DATAGRAM_BYTES:
        raise RequestError(f"The datagram has {len(datagram)} bytes, the limit is {MAX_DATAGRAM_BYTES}.")
    if datagram.startswith(BUNDLE):  # one of them would have the rate of many
        raise RequestError("The datagram is an OSC bundle: send its messages one by one.")
    return decoded(datagram)


def _client(address: _Address) -> str:
    return f"osc-{address[1]}"
