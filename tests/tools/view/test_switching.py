"""A simulated plate that starts or is switched: a state of its own, no failure."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from aiohttp import web
from asynchronous import asynchronous

from hapticd.config.sections import SimConfig
from hapticd.tools.view import messages, server
from hapticd.tools.view.messages import PlateChoice, SwitchPlate
from hapticd.tools.view.server import Page, Viewer
from hapticd.tools.view.simulated import SimulatedService

OTHER = SwitchPlate("reference", 2, 5.0)


class Service(SimulatedService):
    """A service that is not started: a switch takes until `done`."""

    def __init__(self) -> None:
        self.first = "fingertip", 4
        self.choices = {"reference": PlateChoice((2, 3, 4), 2), "fingertip": PlateChoice((2, 3, 4, 5, 6), 4)}
        self.done = asyncio.Event()

    async def switch(self, _to: SwitchPlate) -> None:
        await self.done.wait()


class Client:
    """A client without a daemon; `made` are all of them."""

    made: list[Client]

    def __init__(self, _endpoint: str, publish: Callable[..., None]) -> None:
        self.publish = publish
        self.is_open = False
        self.made.append(self)

    def start(self) -> None:
        self.is_open = True

    def close(self) -> None:
        self.is_open = False
        self.publish("gone", messages.gone("late"), None)


@pytest.fixture
def clients(monkeypatch: pytest.MonkeyPatch) -> list[Client]:
    Client.made = []
    monkeypatch.setattr(server, "PlateClient", Client)
    return Client.made


def opened(viewer: Viewer) -> list[str]:
    """Open a page; return the kinds of message that it gets, now and later."""
    kinds: list[str] = []
    page = Page(web.WebSocketResponse(), 1)
    page.send = lambda _, text: kinds.append(json.loads(text)["kind"])  # type: ignore[method-assign]
    viewer._enter(page)
    return kinds


async def heard(client: Client, kind: str, plate: Any = None) -> None:
    """The client publishes on its thread; the loop passes it on."""
    text = json.dumps({"kind": kind})
    await asyncio.to_thread(client.publish, kind, text, plate)
    await asyncio.sleep(0)


async def closed(viewer: Viewer) -> None:
    viewer._pages.clear()  # they have no sockets
    await viewer._close(viewer.app())


PLATE = SimpleNamespace(rig_dir=None)


@asynchronous
async def test_a_service_that_does_not_answer_yet_is_starting_and_no_failure(
    tmp_path: Path, clients: list[Client]
) -> None:
    viewer = Viewer(str(tmp_path), simulated=Service())
    kinds = opened(viewer)
    await heard(clients[0], "gone")
    assert kinds == ["choices", "starting"]
    await heard(clients[0], "plate", PLATE)
    await heard(clients[0], "gone")
    assert kinds[2:] == ["plate", "gone"]
    assert opened(viewer) == ["choices", "gone"]
    await closed(viewer)


@asynchronous
async def test_while_the_plate_is_switched_no_page_hears_of_a_lost_daemon(
    tmp_path: Path, clients: list[Client]
) -> None:
    service = Service()
    viewer = Viewer(str(tmp_path), simulated=service)
    kinds = opened(viewer)
    await heard(clients[0], "plate", PLATE)
    viewer._switch(viewer._pages[0], OTHER)
    assert viewer._switching is not None
    await asyncio.wait((viewer._switching,), timeout=0.0)
    meanwhile = opened(viewer)
    service.done.set()
    await viewer._switching
    assert [client.is_open for client in clients] == [False, True]  # the page that opened meanwhile made none
    await heard(clients[1], "gone")  # the new service does not answer yet
    await heard(clients[1], "plate", PLATE)
    assert kinds == ["choices", "starting", "plate", "starting", "plate"]
    assert meanwhile == ["choices", "starting", "plate"]
    await closed(viewer)


@asynchronous
async def test_a_plate_whose_service_ends_before_it_answers_gives_way_to_the_one_before(
    tmp_path: Path, clients: list[Client]
) -> None:
    service = Service()
    service.done.set()
    viewer = Viewer(str(tmp_path), simulated=service)
    opened(viewer)
    assert not viewer.go_back()  # there was none before
    await heard(clients[0], "plate", PLATE)
    assert not viewer.go_back()  # it answered: its end is no failed start
    viewer._switch(viewer._pages[0], OTHER)
    assert viewer._switching is not None
    await viewer._switching
    assert viewer.go_back()
    await viewer._switching
    starting = json.loads(viewer._last["starting"])
    assert (starting["plate"], starting["modes"]) == ("fingertip", 4)
    assert "'reference' of 2 modes" in starting["sentence"]
    assert not viewer.go_back()  # it does not start either: the viewer ends
    await closed(viewer)


def test_each_plate_offers_its_own_number_of_modes() -> None:
    service = SimulatedService(SimConfig(scenario="hands", plate="fingertip"))
    assert service.first == ("fingertip", 4)
    offered = json.loads(messages.choices(service.choices))
    assert {name: choice["own_modes"] for name, choice in offered["plates"].items()} == {
        "reference": 2,
        "fingertip": 4,
        "wide": 8,
    }
    assert offered["plates"]["fingertip"]["modes"] == [2, 3, 4, 5, 6]
    assert offered["plates"]["wide"]["modes"] == [2, 3, 4, 5, 6, 7, 8]
    assert (offered["contact_radius_mm"], offered["least_contact_modes"]) == (5.0, 4)
    service._folder.cleanup()
