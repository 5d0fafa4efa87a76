"""The worst that clients can do to the sockets: floods, unread states, false handshakes. The others are served on."""

from __future__ import annotations

import asyncio
import logging
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zmq
from asynchronous import asynchronous
from client_sockets import connected, in_thread, served

from hapticd.io.clients.inbox import BURST

STATE = bytes(400)

# Sends as fast as the machine can: what the daemon does not take is thrown away by its sender.
FLOODER = """
import sys, zmq
with zmq.Context() as context, context.socket(zmq.PUSH) as socket:
    socket.linger = 0
    socket.connect("ipc://" + sys.argv[1])
    print("ready", flush=True)
    while True:
        socket.poll(100, zmq.POLLOUT)
        try:
            while True:
                socket.send(b"spam", zmq.NOBLOCK)
        except zmq.Again:
            pass
"""
SUBSCRIBER = """
import sys, zmq
with zmq.Context() as context, context.socket(zmq.SUB) as socket:
    socket.subscribe(b"")
    socket.connect("ipc://" + sys.argv[1])
    socket.recv()
    print("ready", flush=True)
    sys.stdin.read()
"""


@contextmanager
def programs(source: str, endpoint: Path, count: int = 1) -> Iterator[list[subprocess.Popen[str]]]:
    """Client processes, from their start to the end of the test."""
    running = [
        subprocess.Popen(
            [sys.executable, "-c", source, str(endpoint)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for _ in range(count)
    ]
    try:
        yield running
    finally:
        for process in running:
            process.kill()
            process.communicate()


# --- floods ------------------------------------------------------------------------------------------------------


def test_floods_of_four_processes_stop_no_service_and_are_counted_and_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def scenario() -> None:
        async with served(tmp_path) as running:
            with programs(FLOODER, tmp_path / "targets", count=4) as flooders:
                for flooder in flooders:
                    assert flooder.stdout is not None
                    assert await in_thread(flooder.stdout.readline) == "ready\n"
                await running.until(lambda: running.server.counters["too_fast"] > 4 * BURST)
                with (
                    connected(tmp_path, zmq.PUSH, "targets") as polite,
                    connected(tmp_path, zmq.DEALER, "control") as requester,
                ):
                    for n in range(10):
                        message = b"please %d" % n
                        polite.send(message)
                        await running.until(lambda message=message: message in running.messages)
                        requester.send(b"%d" % n)
                        assert await in_thread(requester.recv) == b"answer to %d" % n
            assert len(set(running.users)) == 1  # this test is one user, whatever its processes

    with caplog.at_level(logging.WARNING, "hapticd"):
        asyncio.run(scenario())
    assert "too fast" in caplog.text
    assert len(caplog.records) <= 2  # logged, but not at each loss


@asynchronous
async def test_requests_beyond_the_rate_wait_their_turn_and_are_answered_in_order(tmp_path: Path) -> None:
    async with served(tmp_path):
        with connected(tmp_path, zmq.DEALER, "control") as client:

            def ask_and_hear() -> list[bytes]:
                replies = []
                for n in range(2 * BURST):
                    client.send(b"%d" % n)
                    replies.append(client.recv())
                return replies

            assert await in_thread(ask_and_hear) == [b"answer to %d" % n for n in range(2 * BURST)]


# --- unread states ----------------------------------------------------------------------------------------------


@asynchronous
async def test_a_stopped_subscriber_delays_no_other_and_queues_a_bounded_number_of_states(tmp_path: Path) -> None:
    async with served(tmp_path) as running:
        server = running.server
        with (
            programs(SUBSCRIBER, tmp_path / "telemetry") as (stopped,),
            connected(tmp_path, zmq.SUB, "telemetry") as listening,
        ):
            assert stopped.stdout is not None
            ready = asyncio.create_task(asyncio.to_thread(stopped.stdout.readline))
            while not ready.done():
                server.publish(STATE)
                await asyncio.sleep(0)
            assert await ready == "ready\n"
            stopped.send_signal(signal.SIGSTOP)
            listening.subscribe(b"")
            listening.conflate = False
            await running.until(lambda: server.has_subscribers)
            for n in range(5000):  # far more than the stopped process's buffers hold: none of it waits
                server.publish(b"%d" % n + STATE)
            last = 5000
            while True:  # a new subscription may take a moment: the next states come through
                last += 1
                server.publish(b"%d" % last)
                server.sweep()
                if await in_thread(lambda: listening.poll(20)):
                    break
            assert await in_thread(listening.recv)
            stopped.send_signal(signal.SIGCONT)
