"""Too many pages and too many requests: bounded, with an error in a sentence."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from aiohttp import ClientSession, WSCloseCode, web
from asynchronous import asynchronous
from web_apps import running

from hapticd.tools.view.client import PlateClient
from hapticd.tools.view.messages import ClearBoardFault, PlateChoice, SetTarget, SwitchPlate
from hapticd.tools.view.server import MAX_PAGES, Page, Viewer
from hapticd.tools.view.simulated import SimulatedService


@asynchronous
async def test_a_page_too_many_gets_the_reason(tmp_path: Path) -> None:
    async with running(Viewer(str(tmp_path), key="key").app()) as (_, port):
        own = f"http://127.0.0.1:{port}"
        async with ClientSession(headers={"Origin": own}) as session:
            pages = [await session.ws_connect(f"{own}/socket?key=key") for _ in range(MAX_PAGES + 1)]
            closing = await pages[-1].receive()
            assert closing.data == WSCloseCode.TRY_AGAIN_LATER
            assert closing.extra == f"{MAX_PAGES} pages are open already: close one."
            assert sum(not page.closed for page in pages) == MAX_PAGES


class Recorder(SimulatedService):
    """A service that is not started; it notes what it is switched to, and takes until `done`."""

    def __init__(self) -> None:
        self.first = "fingertip", 4
        self.choices = {"reference": PlateChoice((2, 3, 4), 2), "fingertip": PlateChoice((2, 3, 4, 5, 6), 4)}
        self.switched: list[SwitchPlate] = []
        self.done = asyncio.Event()

    async def switch(self, to: SwitchPlate) -> None:
        self.switched.append(to)
        await self.done.wait()


@asynchronous
async def test_of_switches_to_another_plate_one_is_made_at_a_time_and_only_to_one_that_exists(tmp_path: Path) -> None:
    service, sent = Recorder(), list[str]()
    viewer, stranger = Viewer(str(tmp_path), simulated=service), Viewer(str(tmp_path))
    page = Page(web.WebSocketResponse(), 1)
    page.send = lambda _, text: sent.append(text)  # type: ignore[method-assign]
    for plate, modes in (("fingertip", 4), ("fingertip", 5), ("fingertip", 9), ("drum", 2)):
        viewer._switch(page, SwitchPlate(plate, modes, 5.0))
        await asyncio.sleep(0)
    stranger._switch(page, SwitchPlate("fingertip", 4, 5.0))
    service.done.set()
    for one in (viewer, stranger):
        await one._close(one.app())
    assert service.switched == [SwitchPlate("fingertip", 4, 5.0)]
    assert ["'fingertip' cannot drive 9" in sent[0], "'drum' cannot drive 2" in sent[1]] == [True, True]
    assert "only `hapticd view --sim` can switch it" in sent[2]


@pytest.fixture
def client() -> PlateClient:
    """Not started: requests stay queued."""
    return PlateClient(None, lambda *_: None)


def test_of_a_flood_of_requests_for_one_finger_the_newest_is_queued(client: PlateClient) -> None:
    refused: list[str] = []
    for step in range(10_000):
        client.request(SetTarget(1, step * 1e-4), refused.append)
    client.request(ClearBoardFault(), refused.append)

    assert [request for request, _ in client._pending()] == [SetTarget(1, 9999 * 1e-4), ClearBoardFault()]
    assert refused == []
