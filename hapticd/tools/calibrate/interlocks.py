"""The dead-man and the emergency stop of a bare rig, pulled and pressed by hand while a voltage stands."""

from __future__ import annotations

import asyncio
import contextlib

from ...board_protocol import BoardState, RawVoltage
from ...design.commissioning import drive
from ...design.commissioning.findings import Judgement
from ...design.commissioning.rest import EMERGENCY_STOP
from ...errors import DeviceError
from .bench import EXTENDED_MS, BareRig, Bench, bench_step

PULL_WITHIN_S, PLUG_WITHIN_S = 120.0, 120.0
RETRY_S = 0.5
SILENCE_S = 0.2  # far beyond the dead-man's 50 ms, and within the voltage's own time
TOOL_STOPPED = 65  # of the board's log
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
        is_silent = await _stops_in_silence(board, volts)
        boot_id, (before, _) = board.hello.boot_id, await board.events()
        if is_silent:
            with contextlib.suppress(DeviceError):
                was_pulled = True
                async with board.raw(0, volts):
                    await bench.person.pull_cable()
                    end_s = loop.time() + PULL_WITHIN_S
                    while loop.time() < end_s:
                        await board.receive(RETRY_S)
                was_pulled = False
    if was_pulled:
        await bench.person.plug_cable()
        is_quiet = await _came_back_quiet(bench, boot_id, before)
    return drive.judge_deadman(is_silent=is_silent, was_pulled=was_pulled, is_quiet=is_quiet)


async def _stops_in_silence(board: BareRig, volts: float) -> bool:
    """Return whether a voltage ends, and is logged, if no keep-alive follows it."""
    before, _ = await board.events()
    await board.demand(RawVoltage(0, complex(volts), EXTENDED_MS))
    await asyncio.sleep(SILENCE_S)
    after, codes = await board.events()
    return after > before and TOOL_STOPPED in codes


async def _came_back_quiet(bench: Bench, boot_id: int, before: int) -> bool:
    """Return whether the board is quiet once its cable is plugged in again: logged by the dead-man, or switched off
    with the cable that feeds it. Raises DeviceError."""
    loop = asyncio.get_running_loop()
    end_s = loop.time() + PLUG_WITHIN_S
    while True:
        try:
            async with bench.board() as board:
                after, codes = await board.events()
                is_logged = after > before and TOOL_STOPPED in codes
                is_quiet = (await board.status()).state is BoardState.QUIET
                return is_quiet and (is_logged or board.hello.boot_id != boot_id)
        except DeviceError:
            if loop.time() > end_s:
                raise
        await asyncio.sleep(RETRY_S)


async def _stop(bench: Bench) -> Judgement:
    async with bench.board() as board:
        before, _ = await board.events()
        async with board.raw(0, PULLED_V_FRAC * board.hello.v_limit_v):
            await bench.person.push_stop(True)
            stopped = await _ends(board, bench.press_s)
        after, codes = await board.events()
        await bench.person.push_stop(False)
        await board.quiet()
        drives_again = await board.drives()
    return drive.judge_stop(
        stopped=stopped, is_logged=after > before and EMERGENCY_STOP in codes, drives_again=drives_again
    )


async def _ends(board: BareRig, within_s: float) -> bool:
    """Return whether the voltage ends within that; a board whose stop is pushed cannot drive again."""
    loop = asyncio.get_running_loop()
    end_s, quiet = loop.time() + within_s, 0
    while loop.time() < end_s:
        quiet = quiet + 1 if (await board.status()).state is not BoardState.TOOL else 0
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
