"""A conversation with one board over the daemon's own serial link: greeting, questions, answers, signs of life."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Iterator
from typing import TypeVar

from ...board_values import (
    BoardCommand,
    BoardHello,
    BoardMessage,
    BoardVerdict,
    HelloRequest,
    KeepAlive,
    Stop,
    ToolCommand,
    ToolMessage,
    Verdict,
)
from ...errors import DeviceError, UsageError
from ...io.devices.serial_link import SerialLink
from ...wire import protocol
from ...wire.commands import encode
from ...wire.device import Decoder, check_protocol

TRIES = 4
ANSWER_WITHIN_S = 0.4  # of each try: the board itself answers at once
ALIVE_EVERY_S = 0.015  # the board waits for 50 ms
LEAVE_WITHIN_S = 0.1  # how long the last frame may take to leave

Message = BoardMessage | ToolMessage
Answer = TypeVar("Answer", bound=Message)


class Conversation:
    """An async context: inside it the link is ours, the board has been greeted and speaks this protocol.

    `where` names the link in sentences. Everything that goes wrong is a DeviceError in one of them.
    """

    def __init__(self, link: SerialLink, where: str) -> None:
        self._link, self._where = link, where
        self._decoder = Decoder()
        self._heard: asyncio.Queue[Message | DeviceError] = asyncio.Queue()
        self._is_driving = False
        self.hello: BoardHello

    async def __aenter__(self) -> Conversation:
        opened: asyncio.Future[str | None] = asyncio.get_running_loop().create_future()

        def on_link(up: bool, reason: str) -> None:
            if not opened.done():
                opened.set_result(None if up else reason)
            elif not up:
                self._heard.put_nowait(DeviceError(f"The board went away: {reason}."))

        self._link.start(asyncio.get_running_loop(), self._on_bytes, on_link)
        try:
            reason = await opened
            if reason is not None:
                raise DeviceError(_advised(reason))
            self.hello = await self._greet()
        except BaseException:
            self._link.close()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._is_driving:
            self.say(Stop())
        await self._link.drained(LEAVE_WITHIN_S)
        self._link.close()

    @property
    def damaged_frames(self) -> int:
        """Frames from the board that had to be refused."""
        return sum(self._decoder.counters.values())

    def say(self, command: BoardCommand | ToolCommand) -> None:
        """Send without waiting. Figures that no board would take raise UsageError."""
        try:
            line = encode(command)
        except ValueError as error:
            raise UsageError(str(error)) from None
        self._link.write(line)

    async def hear(self, within_s: float) -> Message | None:
        """The next message from the board, or None after so long without one."""
        try:
            heard = await asyncio.wait_for(self._heard.get(), within_s)
        except TimeoutError:
            return None
        if isinstance(heard, DeviceError):
            raise heard
        return heard

    async def wait_for(self, kind: type[Answer], within_s: float) -> Answer | None:
        """The next message of this kind; others that come before it are let go."""
        deadline_s = asyncio.get_running_loop().time() + within_s
        while (left_s := deadline_s - asyncio.get_running_loop().time()) > 0.0:
            message = await self.hear(left_s)
            if isinstance(message, kind):
                return message
        return None

    async def ask(self, command: BoardCommand | ToolCommand, kind: type[Answer]) -> Answer:
        """Say it until it is answered by a message of this kind."""
        for _ in range(TRIES):
            self.say(command)
            if (answer := await self.wait_for(kind, ANSWER_WITHIN_S)) is not None:
                return answer
        raise DeviceError(f"The board on {self._where} stopped answering: look at its cable and its supply.")

    async def demand(self, command: ToolCommand) -> None:
        """Say it, and raise DeviceError unless the board does it."""
        answer = await self.ask(command, BoardVerdict)
        what = protocol.COMMANDS.get(answer.request, "the command")
        if answer.verdict is Verdict.OUT_OF_RANGE:
            raise DeviceError(f"The board refuses {what}: a figure lies beyond its bounds (firmware/PROTOCOL.md).")
        if answer.verdict is Verdict.NOT_QUIET:
            raise DeviceError(
                f"The board refuses {what}: it is busy or has a fault: see `hapticd firmware info`, and `clear-fault`."
            )

    @contextlib.contextmanager
    def driving(self) -> Iterator[None]:
        """Inside, the board hears that we live; a tool that runs when this is left is stopped."""
        beating = asyncio.get_running_loop().create_task(self._beat())
        self._is_driving = True
        try:
            yield
            self._is_driving = False
        finally:
            beating.cancel()

    async def _beat(self) -> None:
        while True:
            self.say(KeepAlive(0))
            await asyncio.sleep(ALIVE_EVERY_S)

    async def _greet(self) -> BoardHello:
        for _ in range(TRIES):
            self.say(HelloRequest())
            hello = await self.wait_for(BoardHello, ANSWER_WITHIN_S)
            if hello is not None:
                check_protocol(hello)
                return hello
        if self.damaged_frames:
            raise DeviceError(f"What comes from {self._where} makes no sense: look at --baud and the cable.")
        raise DeviceError(f"Nobody answers on {self._where}: look at port, baud rate, and the board's supply.")

    def _on_bytes(self, data: bytes) -> None:
        for message in self._decoder.feed(data):
            self._heard.put_nowait(message)


def _advised(reason: str) -> str:
    if "another program holds it" in reason:
        return f"{reason}: stop the service first (systemctl stop hapticd)."
    return f"{reason}: look at --port, and at who may open it (systemd/README.md)."
