"""Messages that are too long for the pages' server."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from aiohttp import ClientSession, ClientWebSocketResponse, WSMsgType
from asynchronous import asynchronous
from web_apps import running

from hapticd.tools.view.messages import MAX_MESSAGE_BYTES
from hapticd.tools.view.server import Viewer

LONG_NUMBERS = ("9" * 3000, "-" + "9" * 3000)


async def refusal(page: ClientWebSocketResponse) -> str:
    """The next sentence that refuses a message."""
    while (message := json.loads(await page.receive_str()))["kind"] != "refused":
        pass
    return str(message["sentence"])


@asynchronous
async def test_a_message_too_long_closes_the_page_and_a_number_too_long_is_refused(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with running(Viewer(str(tmp_path), key="key").app()) as port, ClientSession() as session:
        own = f"http://127.0.0.1:{port}"
        page = await session.ws_connect(f"{own}/socket?key=key", headers={"Origin": own})
        for number in LONG_NUMBERS:
            await page.send_str(f'{{"op": "set", "finger": 1, "amplitude_um": {number}}}')
            assert (await refusal(page)).startswith("amplitude_um: a whole number of 9966 bits is out of bounds")
        await page.send_str(" " * (MAX_MESSAGE_BYTES + 1))
        while (message := await page.receive()).type is WSMsgType.TEXT:
            pass
        assert message.type in (WSMsgType.CLOSE, WSMsgType.CLOSED, WSMsgType.ERROR)
    assert caplog.text == ""
