"""The dead-man and the emergency stop of a bare rig, pulled and pressed by hand while a voltage stands."""

from __future__ import annotations

import asyncio
import contextlib

from ...board_protocol import BoardState
from ...design.commissioning import drive
from ...design.commissioning.findings import Judgement
from ...design.commissioning.rest import EMERGENCY_STOP
from ...errors import DeviceError
from ..firmware.conversation import Conversation
from . import measure
from .bench import Bench, bench_step

PULL_WITHIN_S, PLUG_WITHIN_S = 120.0, 120.0
RETRY_S = 0.5
PULLED_V_FRAC = 0.05  # of the voltage limit: what stands while the cable or the stop is pulled
PICTURE = """\
   computer ===X=== board --> amplifiers

   the cable is pulled while a voltage stands:
   50 ms later it ramps to zero

   (( STOP ))---- pole 1: rails
             +--- pole 2: enable
             +--- pole 3: PB15 (G474, H743: PC7)
"""


async def _interlocks(bench: Bench) -> Judgement:
    deadman = await _deadman(bench)
    return deadman.and_then(await _stop(bench)) if deadman.is_passed else deadman


async def _deadman(bench: Bench) -> Judgement:
    was_pulled = is_quiet = False
    async with bench.board() as board:
        volts, loop = PULLED_V_FRAC * board.hello.v_limit_v, asyncio.get_running_loop()
        is_silent = await measure.stops_in_silence(board, volts)
        boot_id, (before, _) = board.hello.boot_id, await measure.events(board)
        if is_silent:
            with contextlib.suppress(DeviceError):
                was_pulled = True
                async with measure.raw(board, 0, volts):
                    await bench.person.pull_cable()
                    end_s = loop.time() + PULL_WITHIN_S
                    while loop.time() < end_s:
                        await board.receive(RETRY_S)
                was_pulled = False
    if was_pulled:
        await bench.person.plug_cable()
        is_quiet = await _came_back_quiet(bench, boot_id, before)
    return drive.judge_deadman(is_silent=is_silent, was_pulled=was_pulled, is_quiet=is_quiet)


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
        async with measure.raw(board, 0, PULLED_V_FRAC * board.hello.v_limit_v):
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
    PICTURE,
    _interlocks,
    back_to="interlocks",
)
