"""The dead-man and the emergency stop of a bare rig, pulled and pressed by hand while a voltage stands."""

from __future__ import annotations

import asyncio

from ...board_protocol import BoardState
from ...design.commissioning import drive
from ...design.commissioning.findings import Judgement
from ...design.commissioning.rest import EMERGENCY_STOP
from ...errors import DeviceError
from ..firmware.conversation import Conversation
from . import measure, pictures
from .bench import Bench, bench_step

PULL_WITHIN_S, PLUG_WITHIN_S = 120.0, 120.0
RETRY_S = 0.5
PULLED_V_FRAC = 0.05  # of the voltage limit: what stands while the cable or the stop is pulled


async def _interlocks(bench: Bench) -> Judgement:
    deadman = await _deadman(bench)
    if not deadman.is_passed:
        return deadman
    stop = await _stop(bench)
    return Judgement(f"{deadman.passed} {stop.passed}", stop.findings)


async def _deadman(bench: Bench) -> Judgement:
    was_pulled = False
    async with bench.board() as board:
        volts = PULLED_V_FRAC * board.hello.v_limit_v
        is_silent = await measure.stops_in_silence(board, volts)
        if not is_silent:
            return drive.judge_deadman(is_silent=False, was_pulled=False, is_quiet=False)
        boot_id, (before, _) = board.hello.boot_id, await measure.events(board)
        loop = asyncio.get_running_loop()
        try:
            async with measure.raw(board, 0, volts):
                await bench.person.pull_cable()
                end_s = loop.time() + PULL_WITHIN_S
                while loop.time() < end_s:
                    await board.receive(RETRY_S)
        except DeviceError:
            was_pulled = True
    if not was_pulled:
        return drive.judge_deadman(is_silent=True, was_pulled=False, is_quiet=False)
    await bench.person.plug_cable()
    is_quiet = await _came_back_quiet(bench, boot_id, before)
    return drive.judge_deadman(is_silent=True, was_pulled=True, is_quiet=is_quiet)


async def _came_back_quiet(bench: Bench, boot_id: int, before: int) -> bool:
    """Return whether the board is quiet once its cable is plugged in again: logged by the dead-man, or switched off
    with the cable that feeds it. Raises DeviceError."""
    loop = asyncio.get_running_loop()
    end_s = loop.time() + PLUG_WITHIN_S
    while True:
        try:
            async with bench.board() as board:
                after, codes = await measure.events(board)
                is_logged = after > before and measure.TOOL_STOPPED in codes
                is_quiet = (await measure.status(board)).state is BoardState.QUIET
                return is_quiet and (is_logged or board.hello.boot_id != boot_id)
        except DeviceError:
            if loop.time() > end_s:
                raise
        await asyncio.sleep(RETRY_S)


async def _stop(bench: Bench) -> Judgement:
    async with bench.board() as board:
        before, _ = await measure.events(board)
        volts = PULLED_V_FRAC * board.hello.v_limit_v
        async with measure.raw(board, 0, volts):
            await bench.person.push_stop(True)
            stopped = await _ends(board, bench.press_s)
        after, codes = await measure.events(board)
        await bench.person.push_stop(False)
        await measure.quiet(board)
        drives_again = await measure.drives(board)
    return drive.judge_stop(
        stopped=stopped, is_logged=after > before and EMERGENCY_STOP in codes, drives_again=drives_again
    )


async def _ends(board: Conversation, within_s: float) -> bool:
    """Return whether the voltage ends within that; a board whose stop is pushed cannot drive again."""
    loop = asyncio.get_running_loop()
    end_s, quiet = loop.time() + within_s, 0
    while loop.time() < end_s:
        quiet = quiet + 1 if (await measure.status(board)).state is not BoardState.TOOL else 0
        if quiet >= 2:
            return True
    return False


STEP = bench_step(
    "interlocks",
    5,
    "pull the cable, press the stop: the board must go quiet",
    "Pull the board's USB cable when asked, and plug it in again; then press the stop when asked, and release it.",
    pictures.DEADMAN + "\n" + pictures.STOP,
    _interlocks,
    back_to="interlocks",
)
