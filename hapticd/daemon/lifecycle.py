"""Runs a daemon until a signal: SIGTERM and SIGINT stop it with a quiet plate, SIGHUP reloads the configuration."""

from __future__ import annotations

import asyncio
import logging
import signal
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any, TypeVar

from ..core.plate.mode_shapes import ModeShapes
from ..errors import DeviceError, HapticdError
from ..io.host.realtime import quiet_collector
from .daemon import Daemon

log = logging.getLogger("hapticd")

Again = TypeVar("Again")
Found = TypeVar("Found")


async def serve(
    daemon: Daemon,
    modes: ModeShapes,
    reread: Callable[[], Awaitable[Again]] | None = None,
    watch: Callable[[Callable[[str], None]], None] | None = None,
) -> Again | None:
    """Run `daemon` until SIGTERM or SIGINT, then leave a quiet plate.

    At SIGHUP `reread` returns the next configuration; then the plate is silenced and that is returned. If it raises
    HapticdError, its sentence is logged and the daemon continues. `watch` is given what to call when something is lost
    that does not come back: the plate is silenced, and DeviceError raised with that sentence.
    """
    loop = asyncio.get_running_loop()
    asked: asyncio.Future[Again | None] = loop.create_future()
    rereading: set[asyncio.Task[None]] = set()

    async def read_again(reread: Callable[[], Awaitable[Again]]) -> None:
        try:
            again = await reread()
        except HapticdError as error:
            log.error("SIGHUP: %s The present configuration stays.", error)
            return
        finally:
            rereading.clear()
        _answer(asked, again, "SIGHUP: applying the new configuration, silencing the plate")

    def on_hangup() -> None:
        if reread is not None and not rereading:
            rereading.add(loop.create_task(read_again(reread)))

    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, _answer, asked, None, f"{number.name}: stopping, silencing the plate")
    if reread is not None:
        loop.add_signal_handler(signal.SIGHUP, on_hangup)
    if watch is not None:
        watch(lambda sentence: None if asked.done() else asked.set_exception(DeviceError(sentence)))
    try:
        daemon.start(loop, modes)
        quiet_collector()
        daemon.go_real_time()
        log.info("serving clients in %s", daemon.runtime_dir)
        daemon.ready()
        return await asked
    finally:
        ended = tuple(rereading)
        for task in ended:
            task.cancel()
        await daemon.stop()
        await asyncio.gather(*ended, return_exceptions=True)


async def while_served(daemon: Daemon, modes: ModeShapes, watch: Coroutine[Any, Any, Found]) -> Found | None:
    """Serve until `watch` ends and return what it finds; None if the service ended first. Raises the errors of both."""
    serving, watching = asyncio.create_task(serve(daemon, modes)), asyncio.create_task(watch)
    await asyncio.wait((serving, watching), return_when=asyncio.FIRST_COMPLETED)
    for task in (watching, serving):
        task.cancel()
    await asyncio.wait((serving, watching))
    if not serving.cancelled() and (error := serving.exception()) is not None:
        raise error
    return None if watching.cancelled() else watching.result()


def _answer(asked: asyncio.Future[Again | None], again: Again | None, why: str) -> None:
    if not asked.done():
        log.info("%s", why)
        asked.set_result(again)
