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
from typing import Annotated, Any, Final, cast

import msgspec
import zmq
import zmq.asyncio

from hapticd_contract.base import AmplitudeUm, FingerId, Share
from hapticd_contract.requests import MarkerRequest
from hapticd_contract.targets import MAX_TARGETS, FingerTarget, TargetsMessage

from ...errors import RequestError
from ...wire.client import read
from ...wire.osc import BUNDLE, Argument, OscError, OscMessage, decoded, encoded
from ..web.sockets import Pace, number
from .shared_daemon import SharedDaemon

HOLD_S: Final = 2.0
MAX_DATAGRAM_BYTES: Final = 1024
MAX_SENDERS: Final = 8
RATE_HZ, BURST = 200.0, 50  # of each sender, and of the refused ones together; those beyond are dropped
ARGUMENTS: Final[dict[str, dict[str, Any]]] = {
    "/hapticd/friction": {"finger": FingerId, "friction": Share},
    "/hapticd/amplitude": {"finger": FingerId, "amplitude_um": AmplitudeUm},
    "/hapticd/release": {"finger": FingerId},
    "/hapticd/marker": {"text": str},
    "/hapticd/follow": {"port": Annotated[int, msgspec.Meta(ge=1, le=65535)]},
}
OWN: Final = (b"/hapticd/finger\0", b"/hapticd/error\0")  # not answered, or two gateways would answer each other
_Address = tuple[str, int]


class _Sender:
    """One sender, or all that are refused. `socket` is its own: the daemon keeps one message of a connection."""

    def __init__(self, socket: zmq.asyncio.Socket) -> None:
        self.socket = socket
        self.t_last_s = self.t_free_s = -math.inf
        self.pace = Pace(RATE_HZ, BURST)
        self.targets: dict[int, FingerTarget] = {}
        self.follows: tuple[_Address, float] | None = None  # where to, and until when


class OscClients(asyncio.DatagramProtocol):
    """All senders of one port."""

    def __init__(self, daemon: SharedDaemon) -> None:
        self.dropped = 0
        self._daemon = daemon
        self._senders: dict[_Address, _Sender] = {}
        self._free = [daemon.connected(zmq.PUSH, "targets") for _ in range(MAX_SENDERS)]
        self._control = daemon.connected(zmq.DEALER, "control")
        self._refused = _Sender(self._control)  # to which it sends nothing
        self._transport: asyncio.DatagramTransport | None = None
        self._id = 0
        self._is_closed = asyncio.Event()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.DatagramTransport", transport)  # Python 3.11 does not derive its own from that
        self._own: _Address = transport.get_extra_info("sockname")[:2]

    def datagram_received(self, data: bytes, addr: Any) -> None:
        t_s = asyncio.get_running_loop().time()
        address: _Address = (str(addr[0]), int(addr[1]))
        if address == self._own or data.startswith(OWN):
            return
        sender = self._sender(address, t_s)
        if t_s < sender.t_free_s or not sender.pace.has_time:
            self.dropped += 1
            return
        with sender.pace:
            try:
                if sender is self._refused:
                    raise RequestError(f"{MAX_SENDERS} senders are here already: wait until one has been silent.")
                self._take(_message(data), sender, address, t_s)
            except (OscError, RequestError) as error:
                self._send(address, "/hapticd/error", str(error))
        sender.t_free_s = t_s + sender.pace.reserve()

    def connection_lost(self, _: Exception | None) -> None:
        self._is_closed.set()

    async def close(self) -> None:
        """Close; what was set ends by itself."""
        self._daemon.leave(self)
        if self._transport is not None:
            self._transport.abort()
            await self._is_closed.wait()
        for socket in (*self._free, *[one.socket for one in self._senders.values()], self._control):
            socket.close()

    def _sender(self, address: _Address, t_s: float) -> _Sender:
        for silent in [one for one, kept in self._senders.items() if t_s - kept.t_last_s >= HOLD_S]:
            self._free.append(self._senders.pop(silent).socket)
        if address not in self._senders:
            if not self._free:
                return self._refused
            self._senders[address] = _Sender(self._free.pop())
        sender = self._senders[address]
        sender.t_last_s = t_s
        return sender

    def _take(self, message: OscMessage, sender: _Sender, address: _Address, t_s: float) -> None:
        name, arguments = message.address, _arguments(message)
        finger = arguments.get("finger")
        if name == "/hapticd/marker":
            self._mark(read({"client": _client(address), **arguments}, MarkerRequest))
        elif name == "/hapticd/follow":
            if (address[0], arguments["port"]) == self._own:
                raise RequestError(f"port: {arguments['port']} is the gateway's own, give yours.")
            sender.follows = (address[0], arguments["port"]), t_s + HOLD_S
            self._daemon.follow(self, self._tell)
        elif name != "/hapticd/release":
            if finger not in sender.targets and len(sender.targets) >= MAX_TARGETS:
                raise RequestError(f"A sender may hold {MAX_TARGETS} fingers at once: release one first.")
            sender.targets[arguments["finger"]] = FingerTarget(**arguments)
        elif finger is None:
            sender.targets.clear()
        else:
            sender.targets.pop(finger, None)
        self._push(sender.socket, TargetsMessage(_client(address), HOLD_S, targets=tuple(sender.targets.values()), v=1))

    def _mark(self, marker: MarkerRequest) -> None:
        self._id = self._id % (2**32 - 1) + 1
        self._push(self._control, {"v": 1, "id": self._id, "op": "marker", "body": marker})

    @staticmethod
    def _push(socket: zmq.asyncio.Socket, message: object) -> None:
        try:
            zmq.Socket.send(socket, msgspec.msgpack.encode(message), zmq.NOBLOCK)
        except zmq.ZMQError:
            raise RequestError("No hapticd answers: start one.") from None

    def _tell(self, text: str) -> None:
        t_s = asyncio.get_running_loop().time()
        followed = {one.follows[0] for one in self._senders.values() if one.follows and one.follows[1] > t_s}
        if not followed:
            self._daemon.leave(self)
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


def _arguments(message: OscMessage) -> dict[str, Any]:
    """Return the arguments by name, of the contract's types. Raises RequestError."""
    name, given = message.address, message.arguments
    if name not in ARGUMENTS:
        raise RequestError(f"{name[:40]!r} is none of hapticd's messages.")
    kinds = ARGUMENTS[name]
    if len(given) != len(kinds) and (given or name != "/hapticd/release"):
        raise RequestError(f"{name}: takes {' and '.join(kinds)}, not {len(given)} arguments.")
    return {
        field: read(number(one) if isinstance(one, float) else one, kinds[field], field)
        for field, one in zip(kinds, given, strict=False)
    }


def _client(address: _Address) -> str:
    return f"osc-{address[1]}"
