"""`hapticd firmware`: arguments, and the subcommands info, clear-fault and raw."""

from __future__ import annotations

import argparse
import asyncio
import cmath
import contextlib
import math
import os
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from ... import board_protocol as protocol
from ...board_protocol import (
    BoardState,
    BoardTime,
    ClearFault,
    ControllerRequest,
    LogRequest,
    RawVoltage,
    TimeRequest,
)
from ...board_values import BoardController, BoardLog, BoardStatus
from ...config import loader as config
from ...config.sections import SIMULATED, DeviceConfig
from ...errors import ConfigError, DeviceError, UsageError
from ...io.devices.serial_link import SerialLink
from ...sim.rig.process import RigProcess
from .. import glass, outputs
from ..arguments import POSITIVE, add_command, whole
from . import selftest, sweep, telemetry, text
from .conversation import Conversation

STATUS_WITHIN_S = 1.0  # the board sends its status ten times a second
ECHOES = 5
FULL_FRAC = 0.999  # of the requested voltage, which the board rounds to float32
MOST_RATE_HZ = 65535  # what the message holds
SIM_SCENARIO = "step"  # its plate is not touched


def add_arguments(parser: argparse.ArgumentParser) -> None:
    commands = parser.add_subparsers(title="subcommands", required=True, metavar="SUBCOMMAND")
    _command(
        commands,
        "info",
        "show the board's identity, status, gains and log",
        "--sim",
        json=True,
    )
    _command(commands, "clear-fault", "clear a latched fault", "--port /dev/ttyACM0")
    summary = "measure modes and wires in two seconds, and say what has moved"
    parser = _command(commands, "selftest", summary, "--sim", json=True)
    compared = "what to compare with (default: the board's own models)"
    parser.add_argument("--calibration", type=Path, metavar="F.toml", help=compared)
    summary = "measure a mode: resonance, quality, gain and loop phase"
    parser = _command(commands, "sweep", summary, "--sim --mode 0 --plot mode-0.png", json=True)
    parser.add_argument("--mode", type=int, default=0, help="which mode, from 0 (default 0)")
    sweep.add_arguments(parser)
    outputs.add_file(parser, "--plot", outputs.PICTURE, metavar="F.png", help="draw amplitude and circle")
    parser = _command(commands, "raw", "put a voltage on one amplifier, open loop, for at most 1 s", "--sim --volts 10")
    parser.add_argument("--mode", type=int, default=0, help="which amplifier, from 0 (default 0)")
    parser.add_argument("--volts", type=float, required=True, help="magnitude, at most a fifth of the board's limit")
    parser.add_argument("--phase", type=float, default=0.0, metavar="DEG", help="relative to the drive (default 0)")
    parser.add_argument("--ms", type=int, default=500, help="duration, at most 1000 (default 500)")
    parser = _command(commands, "telemetry", "stream control ticks as CSV", "--sim > ticks.csv")
    parser.add_argument(
        "--rate", type=whole(1, MOST_RATE_HZ), default=100, metavar="HZ", help="samples a second, at most (default 100)"
    )
    parser.add_argument("--seconds", type=POSITIVE, default=2.0, help="duration (default 2)")


def _command(commands: Any, name: str, summary: str, example: str, *, json: bool = False) -> argparse.ArgumentParser:
    parser = add_command(commands, name, summary, example)
    where = parser.add_argument_group("the board")
    where.add_argument("--port", help="serial port, such as /dev/ttyACM0")
    where.add_argument("--baud", type=int, help="serial speed (default 921600)")
    where.add_argument("--config", type=Path, help="the service's configuration, which names port and speed")
    where.add_argument("--sim", action="store_true", help="a simulated board with a simulated plate")
    glass.add_arguments(parser)
    if json:
        parser.add_argument("--json", action="store_true", help="write JSON")
    parser.set_defaults(command=run, subcommand=name)
    return parser


def run(options: argparse.Namespace) -> None:
    with contextlib.ExitStack() as stack:
        port, baud = named_port(options, stack)
        try:
            asyncio.run(_converse(port, baud, options))
        except BrokenPipeError:  # as by `| head`; the buffer must not be flushed again at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def named_port(options: argparse.Namespace, stack: contextlib.ExitStack) -> tuple[str, int]:
    """Return port and speed from --port, --baud, --config or --sim; `stack` keeps the simulated rig running."""
    loaded = config.load(options.config) if options.config is not None else None
    device = DeviceConfig() if loaded is None else loaded.device
    named = options.port or (loaded is not None and device.port)
    if not (options.sim or named):
        raise UsageError("No board is given: add --port or --config, or --sim.")
    if options.baud is not None:
        try:
            device = config.from_table({"device": {"baud": options.baud}}, where="--baud", folder=Path()).device
        except ConfigError as error:
            raise UsageError(str(error)) from None
    baud = device.baud
    is_simulated = options.sim or named == SIMULATED
    sim = glass.chosen(options, None if loaded is None else loaded.sim, is_simulated=is_simulated)
    if is_simulated:
        rig = stack.enter_context(RigProcess(SIM_SCENARIO, 1, plate=sim.plate, modes=sim.modes, wiring=sim.wiring))
        return str(rig.directory / "board"), baud
    return str(named), baud


async def _converse(port: str, baud: int, options: argparse.Namespace) -> None:
    async with Conversation(SerialLink(port, baud), f"{port} at {baud} baud") as board:
        await SUBCOMMANDS[options.subcommand](board, options)


async def _status(board: Conversation) -> BoardStatus:
    status = await board.wait_for(BoardStatus, STATUS_WITHIN_S)
    if status is None:
        raise DeviceError("The board sends no status after its handshake: reset it, and try again.")
    return status


async def _info(board: Conversation, options: argparse.Namespace) -> None:
    loop = asyncio.get_running_loop()
    trips_s = []
    for _ in range(ECHOES):
        t_sent_s = loop.time()
        await board.ask(TimeRequest(round(t_sent_s * 1e9)), BoardTime)
        trips_s.append(loop.time() - t_sent_s)
    round_trip_ms = 1e3 * min(trips_s)
    status = await _status(board)
    controller = await board.ask(ControllerRequest(), BoardController)
    log = await board.ask(LogRequest(), BoardLog)
    if options.json:
        parts = {"hello": board.hello, "status": status, "controller": controller, "log": log}
        print(text.as_json(parts | {"round_trip_ms": round_trip_ms}))
        return
    print(text.board(board.hello, status, round_trip_ms))
    print(text.controller(controller))
    print(text.log(log, board.hello.boot_id))


async def _clear_fault(board: Conversation, options: argparse.Namespace) -> None:
    del options
    status = await board.ask(ClearFault(), BoardStatus)
    if status.state is BoardState.FAULT:
        raise DeviceError("The board's fault persists: it refuses its own configuration, so flash another firmware.")
    print(f"The board is {protocol.STATES[status.state.value]}.")


async def _raw(board: Conversation, options: argparse.Namespace) -> None:
    sweep.check_drive(board.hello, options.mode, options.volts)
    voltage_v = cmath.rect(options.volts, math.radians(options.phase))
    with board.driving():
        await board.demand(RawVoltage(options.mode, voltage_v, options.ms))
        measured_um: tuple[complex, ...] = ()
        while (status := await _status(board)).state is BoardState.TOOL:
            if abs(status.voltage_v[options.mode]) >= FULL_FRAC * options.volts:  # not on a ramp
                measured_um = status.measured_um
    if status.state is BoardState.FAULT:
        raise DeviceError("The board ended the voltage with a fault: see `hapticd firmware info`.")
    if not measured_um:
        print("no measurement: the board sends its status ten times a second, so give more --ms")
    for k, w_um in enumerate(measured_um):
        print(f"mode {k}    {abs(w_um):.5f} um at {math.degrees(cmath.phase(w_um)):+.2f} degrees")


SUBCOMMANDS: dict[str, Callable[[Conversation, argparse.Namespace], Awaitable[None]]] = {
    "info": _info,
    "clear-fault": _clear_fault,
    "selftest": selftest.run,
    "sweep": sweep.run,
    "raw": _raw,
    "telemetry": telemetry.run,
}
