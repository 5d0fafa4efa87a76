"""The board's self-test before it is first driven, and whenever its port was lost: `hapticd firmware selftest` as a
process, while the port is its own.

The plate is quiet meanwhile, and touches go on. What was found is a sentence and an input of the machine: a recording
has it, and replay decides the same.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
from collections.abc import Callable, Sequence
from typing import Any

from ..config.sections import DeviceConfig
from .board_gateway import MOVED, PASSED, RUNNING, UNKNOWN, UNSAFE

WITHIN_S = 20.0  # six amplifiers take 5 s, and a busy host some more to begin
SHOWN_CHARACTERS = 600
TRIES = 3  # while the plate is touched: fingers damp, detune and couple the modes
LOOK_S = 0.2  # after these, whether fingers have lifted


class SelfTest:
    """One self-test of the board on `port`; `result` is its outcome and sentence, RUNNING while it is under way."""

    def __init__(self, program: Sequence[str], device: DeviceConfig, port: str) -> None:
        """`program` is the command that tests, up to its arguments."""
        where = ["--port", port, "--baud", str(device.baud), "--calibration", device.calibration_file]
        self._command = [*program, *where, "--json"]
        self.result: tuple[str, str] | None = None
        self._task: asyncio.Task[None] | None = None

    def start(
        self,
        loop: asyncio.AbstractEventLoop,
        on_result: Callable[[str, str], None],
        touches: Callable[[], tuple[int, int]],
    ) -> None:
        """Begin, and call `on_result` with RUNNING now and with the outcome at the end. `touches` returns the newest
        finger's id and how many are down."""

        def report(outcome: str, text: str) -> None:
            self.result = outcome, text
            on_result(outcome, text)

        async def run() -> None:
            unsafe = ""
            for test in itertools.count(1):
                before = touches()
                outcome, text = await _outcome(self._command)
                unsafe = text if outcome == UNSAFE else unsafe
                if outcome == UNKNOWN and unsafe:  # what was found unsafe is not driven untested
                    report(UNSAFE, unsafe)
                    return
                if outcome not in (MOVED, UNSAFE) or touches() == (before[0], 0) == before:
                    report(outcome, text)
                    return
                if test >= TRIES and not unsafe:
                    report(UNKNOWN, f"the plate was touched in {test} tests, so that nothing is known: it is driven.")
                    return
                if test == TRIES:
                    report(RUNNING, f"the plate was touched in {test} tests, and stays quiet: take all fingers off.")
                while test >= TRIES and touches()[1] > 0:
                    await asyncio.sleep(LOOK_S)

        report(RUNNING, "measuring modes and wires; the plate stays quiet until that is done")
        self._task = loop.create_task(run())

    def forget(self) -> None:
        """Discard the result: the port was lost, and who is plugged in next is to be tested again."""
        self.result = None

    async def close(self) -> None:
        """End a test that is under way; the board silences its plate within 60 ms."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task


async def _outcome(command: Sequence[str]) -> tuple[str, str]:
    """Return outcome and sentence of the test that `command` makes; UNKNOWN where it could not be made."""
    try:
        process = await asyncio.create_subprocess_exec(
            *command, stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
        )
    except OSError as error:
        return UNKNOWN, f"it cannot be started ({error.strerror}): the board is driven untested."
    try:
        output, complaint = await asyncio.wait_for(process.communicate(), WITHIN_S)
    except TimeoutError:
        return UNKNOWN, f"not done within {WITHIN_S:g} s: the board is driven untested."
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    try:
        return judged(json.loads(output))
    except (ValueError, KeyError, TypeError, RecursionError):
        lines = complaint.decode(errors="replace").strip().splitlines()
        reason = lines[-1].removeprefix("hapticd: ") if lines else "It ended without a result."
        return UNKNOWN, f"{reason[:SHOWN_CHARACTERS]} The board is driven untested."


def judged(found: Any) -> tuple[str, str]:
    """Return outcome and sentence of the test's document. Raises ValueError, KeyError or TypeError for another."""
    moved, unsafe = ([str(line) for line in found[name]] for name in ("moved", "unsafe"))
    if unsafe:
        remedy = "Check the wires or calibrate again, then plug the board in again or restart hapticd."
        return UNSAFE, f"{_sentence(unsafe)}: the plate stays quiet. {remedy}"
    if moved:
        return MOVED, f"{_sentence(moved)}: run hapticd calibrate resonance, unless that was meant."
    return PASSED, "nothing has moved since the calibration."


def _sentence(lines: Sequence[str]) -> str:
    return "; ".join(line.rstrip(".") for line in lines)[:SHOWN_CHARACTERS]
