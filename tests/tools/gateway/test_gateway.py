"""Each WebSocket is a client of the daemon of its own."""

from __future__ import annotations

from pathlib import Path

import pytest
from aiohttp import ClientSession, WSServerHandshakeError
from asynchronous import asynchronous, until
from clients.fake_daemon import FakeDaemon
from webclients import KEY, ORIGIN, gateway, programs

from hapticd.tools.gateway import peer

TARGET = {"finger": 1, "friction": 0.2}
VIRTUALS = [{"name": "a", "path_mm": [[0, 0]]}]


@pytest.mark.parametrize(
    ("query", "headers", "is_admitted"),
    [
        (f"?key={KEY}", {}, True),
        (f"?key={KEY}", {"Origin": ORIGIN}, True),
        ("", {}, False),
        (f"?key={KEY}", {"Origin": "http://evil.example"}, False),
    ],
)
@asynchronous
async def test_key_host_and_origin_decide(
    tmp_path: Path, query: str, headers: dict[str, str], is_admitted: bool
) -> None:
    async with gateway(tmp_path) as address, ClientSession() as session:
        if is_admitted:
            await session.ws_connect(address + query, headers=headers)
        else:
            with pytest.raises(WSServerHandshakeError, match="403"):
                await session.ws_connect(address + query, headers=headers)


@asynchronous
async def test_a_program_without_zeromq_does_what_a_client_does(daemon: FakeDaemon) -> None:
    daemon.fingers = {1: (0.0, 0.0)}
    async with programs(daemon.directory) as (program,):
        assert (await program.ask("hello"))["body"]["protocol"] == 1
        await program.send(states="every")
        await program.send(client="page", ttl_s=5.0, targets=[TARGET])  # which a busy machine does not outlast
        felt = await program.next(lambda message: bool(message.get("fingers") and message["fingers"][0]["target_um"]))
        assert [(await program.next())["seq"] - felt["seq"] for _ in range(50)] == list(range(1, 51))
        await program.send(states="none")
        await until(lambda: not daemon.server.has_subscribers)
        assert (await program.ask("marker", client="page", text="now"))["ok"]
        assert daemon.markers[-1].text == "now"
        assert (await program.ask("release", client="page", finger=1))["body"] == {"released": True}


@asynchronous
async def test_a_page_that_goes_without_a_word_releases_by_its_ttl_and_keeps_no_name(daemon: FakeDaemon) -> None:
    daemon.fingers = {1: (0.0, 0.0)}
    async with programs(daemon.directory, 2) as (first, second):
        assert (await first.ask("set", client="page", ttl_s=0.3, targets=[TARGET]))["ok"]
        assert "another connection" in (await second.ask("release", client="page"))["error"]
        transport = first.socket.get_extra_info("socket")
        assert transport is not None
        first.socket._response.close()  # as a killed browser leaves it
        await until(lambda: daemon.released == [1])
        assert (await second.ask("release", client="page"))["ok"]


@asynchronous
async def test_a_refused_message_gets_a_sentence_with_its_id_or_0(daemon: FakeDaemon) -> None:
    async with programs(daemon.directory) as (program,):
        await program.socket.send_str("{")
        assert (await program.next())["id"] == 0
        await program.socket.send_bytes(b"1")
        assert "binary" in (await program.next())["error"]
        await program.send(client="page", targets=[{"finger": 1, "friction": 2}])
        assert (await program.next())["error"].startswith("targets[0].friction: 2 is out of bounds")
        refused = await program.ask("set", client="page", targets=[{"finger": "a", "friction": 0}])
        assert "no virtual finger 'a'" in refused["error"]
        await program.send(client="page")
        await program.send(client="other")
        assert "this connection is 'page'" in (await program.next())["error"]


@asynchronous
async def test_without_a_daemon_a_request_is_refused_and_targets_do_not_come_late(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(peer, "ANSWER_S", 0.05)
    async with programs(tmp_path) as (program,):
        await program.send(client="page", ttl_s=0.02, virtuals=VIRTUALS)
        assert (await program.ask("hello"))["error"].startswith("No hapticd answers at ")
        daemon = FakeDaemon(tmp_path)
        daemon.start()
        try:
            monkeypatch.setattr(peer, "ANSWER_S", 10.0)
            assert (await program.ask("hello"))["ok"]
            assert daemon.messages == 0
        finally:
            daemon.stop()


@asynchronous
async def test_a_flood_of_one_page_leaves_the_newest_and_keeps_no_other_waiting(daemon: FakeDaemon) -> None:
    async with programs(daemon.directory, 2) as (flooding, other):
        for number in range(1000):
            await flooding.send(client="flood", ttl_s=5.0, stamp=number, virtuals=VIRTUALS)
        own = [{"name": "b", "path_mm": [[0, 0]]}]
        assert (await other.ask("set", client="other", virtuals=own))["ok"]
        assert daemon.stamps[-1] != 999  # while the flood lasts
        await until(lambda: 999 in daemon.stamps)


@asynchronous
async def test_requests_beyond_those_that_may_wait_are_refused(tmp_path: Path) -> None:
    async with programs(tmp_path) as (program,):
        for number in range(1, peer.MAX_REQUESTS + 3):  # one in its turn, and those that wait
            await program.send(id=number, op="hello")
        refused = await program.next()
        assert (refused["id"], "wait already" in refused["error"]) == (peer.MAX_REQUESTS + 2, True)
