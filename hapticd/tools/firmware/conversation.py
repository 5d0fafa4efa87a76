"""Session with one board over the daemon's own serial link: handshake, requests, replies, keep-alives."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Iterator
from typing import Self, TypeVar

from ... import board_protocol as protocol
from ...board_protocol import BoardVerdict, CommandResult, HelloRequest, Keepalive, Stop
from ...board_values import BoardCommand, BoardHello, BoardMessage
from ...errors import DeviceError, UsageError
from ...io.devices.serial_link import SerialLink
from ...sim.board.virtual_link import VirtualLink
from ...wire.commands import encode
from ...wire.device import Decoder, check_protocol

TRIES = 4
ANSWER_WITHIN_S = 0.4  # of each try; the board answers at once
ALIVE_EVERY_S = 0.015  # of the board's dead-man timeout of 50 ms
DRAIN_WITHIN_S = 0.1  # for the last frame to be sent
REMEDIES = {
    CommandResult.OUT_OF_RANGE: " (firmware/PROTOCOL.md)",
    CommandResult.NOT_QUIET: ": see `hapticd firmware info`, and `clear-fault`",
}

Link = SerialLink | VirtualLink
_Answer = TypeVar("_Answer", bound=BoardMessage)


class Conversation:
    """Async context with an open link and a board of this protocol version.

    `where` names the link in errors, which are all DeviceError.
    """

    def __init__(self, link: Link, where: str) -> None:
        self._link, self._where = link, where
        self._decoder = Decoder()
        self._received: asyncio.Queue[BoardMessage | DeviceError] = asyncio.Queue()
        self._is_driving = False
        self.hello: BoardHello

    async def __aenter__(self) -> Self:
        opened: asyncio.Future[str | None] = asyncio.get_running_loop().create_future()

        def on_link(up: bool, reason: str) -> None:
            if not opened.done():
                opened.set_result(None if up else reason)
            elif not up:
                self._received.put_nowait(DeviceError(f"The board disconnected: {reason}."))

        self._link.start(asyncio.get_running_loop(), self._on_bytes, on_link)
        try:
            reason = await opened
            if reason is not None:
                raise DeviceError(_with_remedy(reason))
            self.hello = await self._greet()
        except BaseException:
            self._link.close()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._is_driving:
            self.send(Stop())
        await self._link.drained(DRAIN_WITHIN_S)
        self._link.close()

    @property
    def damaged_frames(self) -> int:
        """Number of damaged frames from the board."""
        return sum(self._decoder.counters.values())

    def send(self, command: BoardCommand) -> None:
        """Send without waiting. Raises UsageError for values that no board accepts."""
        try:
            line = encode(command)
        except ValueError as error:
            raise UsageError(str(error)) from None
        self._link.write(line)

    async def receive(self, within_s: float) -> BoardMessage | None:
        """Return the next message from the board, None after `within_s` without one."""
        try:
            # Python 3.11's wait_for loses a cancellation that comes with a message.
            async with asyncio.timeout(within_s):
                received = await self._received.get()
        except TimeoutError:
            return None
        if isinstance(received, DeviceError):
            raise received
        return received

    async def wait_for(self, kind: type[_Answer], within_s: float) -> _Answer | None:
        """Return the next message of this kind, None after `within_s`; others are dropped."""
        deadline_s = asyncio.get_running_loop().time() + within_s
        while (left_s := deadline_s - asyncio.get_running_loop().time()) > 0.0:
            message = await self.receive(left_s)
            if isinstance(message, kind):
                return message
        return None

    async def ask(self, command: BoardCommand, kind: type[_Answer]) -> _Answer:
        """Send the command, with retries, and return the reply of this kind. Raises DeviceError."""
        for _ in range(TRIES):
            self.send(command)
            if (answer := await self.wait_for(kind, ANSWER_WITHIN_S)) is not None:
                return answer
        raise DeviceError(f"The board on {self._where} stopped answering: check its cable and supply.")

    async def demand(self, command: BoardCommand) -> None:
        """Send the command; raise DeviceError unless the board executes it."""
        answer = await self.ask(command, BoardVerdict)
        what = protocol.COMMANDS.get(answer.request, "the command")
        if answer.verdict is not CommandResult.DONE:
            why = protocol.VERDICTS[answer.verdict.value]
            raise DeviceError(f"The board refuses {what}: {why}{REMEDIES[answer.verdict]}.")

    @contextlib.contextmanager
    def driving(self) -> Iterator[None]:
        """Context that sends keep-alives; leaving it by an exception stops a running tool."""
        beating = asyncio.get_running_loop().create_task(self._beat())
        self._is_driving = True
        try:
            yield
            self._is_driving = False
        finally:
            beating.cancel()

    async def _beat(self) -> None:
        while True:
            self.send(Keepalive(0))
            await asyncio.sleep(ALIVE_EVERY_S)

    async def _greet(self) -> BoardHello:
        for _ in range(TRIES):
            self.send(HelloRequest())
            hello = await self.wait_for(BoardHello, ANSWER_WITHIN_S)
            if hello is not None:
                check_protocol(hello)
                return hello
        if self.damaged_frames:
            raise DeviceError(f"The data from {self._where} is damaged: check --baud and the cable.")
        raise DeviceError(f"No board answers on {self._where}: check port, baud rate and the board's supply.")

    def _on_bytes(self, data: bytes) -> None:
        for message in self._decoder.feed(data):
            self._received.put_nowait(message)


def _with_remedy(reason: str) -> str:
    if "another program holds it" in reason:
        return f"{reason}: stop the service first (systemctl stop hapticd)."
    return f"{reason}: check --port and its access rights (systemd/README.md)."
