"""Too many pages, and messages that are too long."""

from __future__ import annotations

from pathlib import Path

from aiohttp import ClientSession, WSCloseCode, WSMsgType
from asynchronous import asynchronous
from web_apps import running

from hapticd.tools.view.messages import MAX_MESSAGE_BYTES
from hapticd.tools.view.server import MAX_PAGES, Viewer


@asynchronous
async def test_a_page_too_many_gets_the_reason_and_a_message_too_long_closes_its_page(tmp_path: Path) -> None:
    async with running(Viewer(str(tmp_path), key="key").app()) as port:
        own = f"http://127.0.0.1:{port}"
        async with ClientSession(headers={"Origin": own}) as session:
            pages = [await session.ws_connect(f"{own}/socket?key=key") for _ in range(MAX_PAGES + 1)]
            closing = await pages[-1].receive()
            assert closing.data == WSCloseCode.TRY_AGAIN_LATER
            assert closing.extra == f"{MAX_PAGES} pages are open already: close one."
            assert sum(not page.closed for page in pages) == MAX_PAGES
            await pages[0].send_str(" " * (MAX_MESSAGE_BYTES + 1))
            while (message := await pages[0].receive()).type is WSMsgType.TEXT:
                pass
            assert message.type in (WSMsgType.CLOSE, WSMsgType.CLOSED, WSMsgType.ERROR)
