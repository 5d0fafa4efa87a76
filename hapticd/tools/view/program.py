"""`hapticd view`: arguments, and the server process, with --sim on a simulated plate of its own."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import signal
import socket
import sys
from dataclasses import replace
from pathlib import Path

from ...config.sections import SimConfig
from ...errors import HapticdError, UsageError
from ...sim.plate.glasses import driven_modes
from ...sim.rig.process import watch
from .. import glass, simulated_fingers
from ..arguments import PORT_NUMBER, add_endpoint, runtime_directory, whole
from ..daemon_process import DaemonProcess

SCENARIO = "hands"
HOST = "127.0.0.1"
PORT = 8017


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--sim", action="store_true", help="start a simulated plate and a service for it as well")
    simulated_fingers.add_arguments(parser, "hands: none")
    parser.add_argument(
        "--seed", type=whole(0, 2**31 - 1), default=1, help="of its fingers, noise and mode map (default 1)"
    )
    glass.add_arguments(parser, glass.SHOWN)
    add_endpoint(parser, type=runtime_directory)
    parser.add_argument(
        "--port", type=PORT_NUMBER, default=PORT, help=f"of the page on this computer, 0: any (default {PORT})"
    )
    parser.add_argument("--no-browser", action="store_true", help="print the page's address without opening it")
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Serve until SIGTERM or SIGINT. Raises HapticdError."""
    _check(options)
    from ..web.serving import bound

    listener, endpoint, service, starting = bound(HOST, options.port), options.endpoint, None, ""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # until the loop takes over; ends the child processes too
    with contextlib.ExitStack() as stack:
        stack.enter_context(listener)
        if options.sim:
            print("starting a simulated plate and a service for it ...", file=sys.stderr, flush=True)
            sim = _simulated(options)
            service = stack.enter_context(DaemonProcess(glass.lines(sim)))
            endpoint = str(service.runtime_dir)
            starting = f"{Path(sim.plate).name} plate, {driven_modes(sim.plate, sim.modes)} modes"
        asyncio.run(_serve(listener, endpoint, service, starting, open_browser=not options.no_browser))


def _check(options: argparse.Namespace) -> None:
    if options.sim and options.endpoint is not None:
        raise UsageError("--sim starts a service of its own: it cannot be combined with --endpoint.")
    _simulated(options)


def _simulated(options: argparse.Namespace) -> SimConfig:
    """Return the plate and its fingers that the options name. Raises UsageError."""
    sim = glass.chosen(options, glass.SHOWN, is_simulated=options.sim)
    sim = replace(sim, scenario=SCENARIO, seed=options.seed)
    return simulated_fingers.chosen(options, sim, is_simulated=options.sim)


async def _serve(
    listener: socket.socket, endpoint: str | None, service: DaemonProcess | None, starting: str, *, open_browser: bool
) -> None:
    from ..web.serving import ended_by_signal, in_browser, served
    from .server import Viewer

    viewer, ended = Viewer(endpoint, starting=starting), ended_by_signal()
    async with served(viewer.app(), listener):
        service_ended = asyncio.Event()

        def end() -> None:
            service_ended.set()
            ended.set()

        if service is not None:
            watch(service.process, end)
        address = f"http://{HOST}:{listener.getsockname()[1]}/?key={viewer.key}"
        print(f"the plate: {address}\n(Ctrl-C ends)", flush=True)
        async with in_browser(address, is_wanted=open_browser):
            await ended.wait()
        if service_ended.is_set():
            raise HapticdError("The service of the simulated plate has ended: start this command again.")
