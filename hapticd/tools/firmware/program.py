"""The subcommands of `hapticd firmware`: each greets the board, asks, and prints."""

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

from ...board_values import (
    BoardController,
    BoardLog,
    BoardState,
    BoardStatus,
    BoardTime,
    ClearFault,
    ControllerRequest,
    LogRequest,
    RawVoltage,
    SetGains,
    TimeRequest,
)
from ...config import loader as config
from ...config.sections import SIMULATED, DeviceConfig
from ...errors import ConfigError, DeviceError, UsageError
from ...io.devices.serial_link import SerialLink
from ...sim.rig.process import RigProcess
from . import sweep, telemetry, text
from .conversation import Conversation

STATUS_WITHIN_S = 1.0  # the board says how it is ten times a second
ECHOES = 5
FULL_FRAC = 0.999  # of the voltage asked for, as float32 has it
SIM_SCENARIO = "step"  # nobody touches the plate


def run(options: argparse.Namespace) -> int:
    """The whole of one subcommand; returns the exit code."""
    with contextlib.ExitStack() as stack:
        port, baud = named_port(options, stack)
        try:
            asyncio.run(_converse(port, baud, options))
        except BrokenPipeError:  # `| head` has seen enough; what is buffered must not be tried again at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def named_port(options: argparse.Namespace, stack: contextlib.ExitStack) -> tuple[str, int]:
    """The board's port and speed as --port, --baud, --config or --sim say; `stack` keeps the simulated rig."""
    loaded = config.load(options.config) if options.config is not None else None
    device = DeviceConfig() if loaded is None else loaded.device
    named = options.port or (loaded is not None and device.port)
    if not (options.sim or named):
        raise ConfigError("No board is named: give --port or --config, or try it with --sim.")
    if options.baud is not None:
        device = config.from_table({"device": {"baud": options.baud}}, where="--baud", folder=Path()).device
    baud = device.baud
    if options.sim or named == SIMULATED:
        rig = stack.enter_context(RigProcess(SIM_SCENARIO, 1))
        return str(rig.directory / "board"), baud
    return str(named), baud


async def _converse(port: str, baud: int, options: argparse.Namespace) -> None:
    async with Conversation(SerialLink(port, baud), f"{port} at {baud} baud") as board:
        await SUBCOMMANDS[options.subcommand](board, options)


async def _status(board: Conversation) -> BoardStatus:
    status = await board.wait_for(BoardStatus, STATUS_WITHIN_S)
    if status is None:
        raise DeviceError("The board answered its greeting but does not say how it is: reset it, and try again.")
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


async def _log(board: Conversation, options: argparse.Namespace) -> None:
    log = await board.ask(LogRequest(), BoardLog)
    print(text.as_json(log) if options.json else text.log(log, board.hello.boot_id))


async def _clear_fault(board: Conversation, options: argparse.Namespace) -> None:
    del options
    status = await board.ask(ClearFault(), BoardStatus)
    if status.state is BoardState.FAULT:
        raise DeviceError("The board's fault persists: it refuses its own configuration, so flash another firmware.")
    print(f"The board is {text.STATES[status.state]}.")


async def _gains(board: Conversation, options: argparse.Namespace) -> None:
    found = await board.ask(ControllerRequest(), BoardController)
    if options.law is not None or options.bandwidth is not None or options.integral_time is not None:
        law = options.law or found.law
        if law is None:
            raise DeviceError("The board runs a law that this hapticd does not know: choose one with --law.")
        await board.demand(SetGains(law, options.bandwidth, options.integral_time))
        found = await board.ask(ControllerRequest(), BoardController)
    print(text.as_json(found) if options.json else text.controller(found))


async def _raw(board: Conversation, options: argparse.Namespace) -> None:
    sweep.check_drive(board.hello, options.mode, options.volts)
    if not math.isfinite(options.phase):
        raise UsageError(f"--phase is {options.phase:g}: an angle is a finite number of degrees.")
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
        print("too short to be measured: the board says how it is ten times a second")
    for k, w_um in enumerate(measured_um):
        print(f"mode {k}    {abs(w_um):.5f} um at {math.degrees(cmath.phase(w_um)):+.2f} degrees")


SUBCOMMANDS: dict[str, Callable[[Conversation, argparse.Namespace], Awaitable[None]]] = {
    "info": _info,
    "log": _log,
    "clear-fault": _clear_fault,
    "gains": _gains,
    "sweep": sweep.run,
    "raw": _raw,
    "telemetry": telemetry.run,
}
