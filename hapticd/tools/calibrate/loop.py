"""The closed loop of a bare rig: each mode held alone at 0.1 and 1 um, then a finger on the driven plate."""

from __future__ import annotations

from dataclasses import replace

from ...design.commissioning import drive
from ...design.commissioning.findings import Judgement
from ...files import calibration
from ..firmware.conversation import Conversation
from . import folder, pictures
from .bench import Bench, bench_step
from .held_loop import Loop
from .resonance import CALIBRATION_FILE
from .trial import LAW

SMALL_UM, LARGE_UM, TOUCHED_UM = 0.1, 1.0, 0.5


async def _loop(bench: Bench) -> Judgement:
    for amplitude_um in (SMALL_UM, LARGE_UM):
        async with bench.board() as board:
            loop = _calibrated(bench, board)
            await loop.begin()
            held = [
                await loop.hold(mode, min(amplitude_um, board.hello.w_limit_um[mode]))
                for mode in range(board.hello.modes)
            ]
            loop.rest()
        judged = drive.judge_loop(held, loop.fault)
        if not judged.is_passed:
            return judged
    touched = await _touch(bench)
    return Judgement(f"{judged.passed} {touched.passed}", touched.findings, (*judged.figures, *touched.figures))


async def _touch(bench: Bench) -> Judgement:
    async with bench.board() as board:
        loop = _calibrated(bench, board)
        await loop.begin()
        still = await loop.hold(0, TOUCHED_UM)
        await bench.person.touch_plate(True)
        touched = await loop.hold(0, TOUCHED_UM, bench.touch_s)
        await bench.person.touch_plate(False)
        loop.rest()
    judgement = drive.judge_touch(still.volts_v, touched.volts_v)
    faults = drive.judge_loop((), loop.fault).findings
    return replace(judgement, findings=(*faults, *judgement.findings))


def _calibrated(bench: Bench, board: Conversation) -> Loop:
    """Return the loop as the service closes it: with the calibration, and the law that bears the plate. Raises
    HapticdError."""
    law = folder.merged(folder.load(bench.out).values()).get("device", {}).get("controller", LAW)
    return Loop(board, calibration.load(bench.out / CALIBRATION_FILE, board.hello.modes), law)


STEP = bench_step(
    "loop",
    7,
    "close the loop at 0.1 and 1 um, and touch the driven plate",
    "Goggles on, hands off. Rest a finger on the plate when asked, where the first mode moves most.",
    pictures.LOOP + "\n" + pictures.TOUCH,
    _loop,
    back_to="wires",
)
