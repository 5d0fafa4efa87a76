"""The board's self-test before it is first driven: the port is the test's meanwhile, and what it found decides."""

from __future__ import annotations

import asyncio
import itertools
import json
import logging
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from asynchronous import asynchronous, until
from machine_bench import PLATE, Bench
from terminal import Terminal

from hapticd.board_protocol import HelloRequest
from hapticd.config.sections import Config
from hapticd.core.board.supervisor import DRIVING
from hapticd.daemon import self_test
from hapticd.daemon.board_gateway import MOVED, PASSED, RUNNING, UNKNOWN, UNSAFE
from hapticd.daemon.daemon import Daemon
from hapticd.io.devices.socket_trackpad import SocketTrackpad
from hapticd.tools.service import SELF_TEST
from hapticd.wire import device

CONFIG = replace(Config(), device=replace(Config().device, calibration_file="plate.toml"))
SHIFTED = "Mode 0 has moved by +30.0 Hz to 29225.0 Hz."
SWAPPED = "Amplifiers 0 and 1, or their sensors, are swapped: amplifier 0 moves sensor 1."


def document(*, moved: tuple[str, ...] = (), unsafe: tuple[str, ...] = ()) -> str:
    return json.dumps({"modes": [], "known": [], "moved": moved, "unsafe": unsafe})


def prints(text: str, code: int = 0) -> list[str]:
    return [sys.executable, "-c", f"import sys; print({text!r}, end=''); sys.exit({code} and 'hapticd: No board.')"]


@pytest.mark.parametrize(
    ("found", "outcome", "text"),
    [
        (document(), PASSED, "nothing has moved since the calibration."),
        (
            document(moved=(SHIFTED, "Mode 1 has turned its loop phase by +9 degrees: calibrate again.")),
            MOVED,
            "Mode 0 has moved by +30.0 Hz to 29225.0 Hz; Mode 1 has turned its loop phase by +9 degrees: calibrate "
            "again: run hapticd calibrate resonance, unless that was meant.",
        ),
        (
            document(moved=(SWAPPED,), unsafe=(SWAPPED,)),
            UNSAFE,
            f"{SWAPPED[:-1]}: the plate stays quiet. Check the wires or calibrate again, then plug the board in "
            "again or restart hapticd.",
        ),
    ],
)
def test_what_was_found_is_one_sentence_with_what_to_do(found: str, outcome: str, text: str) -> None:
    assert asyncio.run(self_test._outcome(prints(found, code=1))) == (outcome, text)


@pytest.mark.parametrize("said", ["", "no document", "[]", "[" * 50_000, '{"moved": []}', '{"moved": 1, "unsafe": 2}'])
def test_a_test_that_could_not_be_made_says_why_and_forbids_nothing(said: str) -> None:
    outcome, text = asyncio.run(self_test._outcome(prints(said, code=1)))
    assert (outcome, text) == (UNKNOWN, "No board. The board is driven untested.")


def test_a_test_that_never_ends_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(self_test, "WITHIN_S", 0.05)
    outcome, text = asyncio.run(self_test._outcome([sys.executable, "-c", "while True: pass"]))
    assert (outcome, text) == (UNKNOWN, "not done within 0.05 s: the board is driven untested.")
    assert asyncio.run(self_test._outcome(["/no/such/program"]))[0] == UNKNOWN


@pytest.mark.parametrize(
    ("touches", "found", "outcomes", "tests"),
    [
        ([(5, 0)] * 2, UNSAFE, [RUNNING, UNSAFE], 1),
        ([(5, 1), (5, 0), (5, 0), (5, 0)], UNSAFE, [RUNNING, UNSAFE], 2),  # a finger that lifts
        (
            [(5, 0), (6, 0), (6, 0), (6, 1), (6, 1), (6, 1)],
            MOVED,
            [RUNNING, UNKNOWN],
            3,
        ),  # comes and goes, lands, rests
        ([(5, 1)] * 6, MOVED, [RUNNING, UNKNOWN], 3),  # rests from the start on
        (
            [(5, 1)] * 6 + [(5, 1), (5, 1), (5, 0), (5, 0), (5, 0), (5, 0)],
            UNSAFE,
            [RUNNING, RUNNING, UNSAFE],
            4,
        ),  # after three tests the next one waits until nothing touches the plate
    ],
)
@asynchronous
async def test_a_test_of_a_touched_plate_is_made_again(
    touches: list[tuple[int, int]],
    found: str,
    outcomes: list[str],
    tests: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    results: list[tuple[str, str]] = []
    made = self_test.SelfTest(SELF_TEST, CONFIG.device, "/dev/none")
    made._command = prints(document(moved=(SWAPPED,), unsafe=(SWAPPED,) if found == UNSAFE else ()))
    monkeypatch.setattr(self_test, "LOOK_S", 0.0)
    left = iter(touches)
    made.start(asyncio.get_running_loop(), lambda *result: results.append(result), lambda: next(left))
    await until(lambda: results[-1][0] != RUNNING)
    assert [result[0] for result in results] == outcomes
    assert made.result == results[-1]
    if outcomes[-1] == UNKNOWN:
        assert results[-1][1] == "the plate was touched in 3 tests, so that nothing is known: it is driven."
    looks = 3 if tests > self_test.TRIES else 0
    assert len(touches) - len(list(left)) == 2 * tests + looks


@pytest.mark.parametrize("last", [UNKNOWN, MOVED])
@asynchronous
async def test_what_a_touched_test_found_unsafe_is_not_driven_untested(
    last: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As when the board is unplugged meanwhile, or a finger rests on it."""
    results: list[tuple[str, str]] = []
    found = iter([(UNSAFE, SWAPPED), (UNSAFE, SWAPPED), (last, SHIFTED), (UNSAFE, SWAPPED), (UNKNOWN, "")])

    async def outcome(_: object) -> tuple[str, str]:
        return next(found)

    monkeypatch.setattr(self_test, "_outcome", outcome)
    monkeypatch.setattr(self_test, "LOOK_S", 0.0)
    down = itertools.chain([1] * 7, itertools.repeat(0))
    made = self_test.SelfTest(SELF_TEST, CONFIG.device, "/dev/none")
    made.start(asyncio.get_running_loop(), lambda *result: results.append(result), lambda: (5, next(down)))
    await until(lambda: results[-1][0] != RUNNING)
    assert results[-1] == (UNSAFE, SWAPPED)


def board_of(bench: Bench) -> Any:
    return bench.machine.report_status(bench.t_ns)["board"]


@pytest.mark.parametrize("outcome", [PASSED, MOVED, UNKNOWN])
def test_a_plate_that_has_moved_is_driven_and_the_status_says_what_has(
    outcome: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    bench = Bench()
    bench.machine.self_test(outcome, SHIFTED, bench.t_ns)
    bench.run(500)
    assert bench.machine.session.ready
    assert board_of(bench)["self_test"] == {"outcome": outcome, "text": SHIFTED}
    (record,) = (record for record in caplog.records if SHIFTED in record.getMessage())
    assert record.levelno == (logging.INFO if outcome == PASSED else logging.WARNING)


def test_wires_unsafe_for_the_loop_keep_the_plate_quiet_until_a_test_passes(
    caplog: pytest.LogCaptureFixture,
) -> None:
    bench = Bench()
    assert "self_test" not in board_of(bench)
    bench.machine.board_link(False, "left to the self-test", bench.t_ns)
    bench.machine.self_test(UNSAFE, SWAPPED, bench.t_ns)
    bench.machine.board_link(True, "open", bench.t_ns)
    bench.run(500)
    assert not bench.machine.session.ready
    assert bench.machine.supervisor.state not in DRIVING
    assert board_of(bench)["refused"] == SWAPPED
    assert len([record for record in caplog.records if record.levelno == logging.ERROR]) == 2  # test and board
    bench.machine.self_test(PASSED, "", bench.t_ns)
    bench.run(500)
    assert bench.machine.session.ready


class Line:
    """A terminal behind which nothing answers, and a daemon that tests it."""

    def __init__(self, folder: Path, command: list[str]) -> None:
        self.terminal = Terminal()
        pad = SocketTrackpad(folder / "trackpad")
        self.daemon = Daemon(CONFIG, folder / "run", board_port=self.terminal.port, trackpad=pad, self_test=SELF_TEST)
        assert self.daemon._self_test is not None
        self.test = self.daemon._self_test
        self.asked, self.test._command = self.test._command, command


@asynchronous
async def test_the_board_is_greeted_only_when_the_test_has_ended(tmp_path: Path) -> None:
    gate = tmp_path / "gate"
    os.mkfifo(gate)
    waits = f"open({str(gate)!r}).read(); print({document(moved=(SHIFTED,))!r})"
    line = Line(tmp_path, [sys.executable, "-c", waits])
    port = line.daemon._link.port
    asked = f"hapticd firmware selftest --port {port} --baud 921600 --calibration plate.toml --json"
    assert line.asked[3:] == asked.split()
    line.daemon.start(asyncio.get_running_loop(), PLATE)
    assert line.test.result is not None
    assert line.test.result[0] == RUNNING
    opened = await asyncio.to_thread(gate.open, "w")  # only once the test reads: the port was free until now
    assert line.terminal.received() == b""
    opened.close()
    await until(lambda: line.terminal.received() == b"\0" + device.encode(HelloRequest()))
    assert line.test.result[0] == MOVED
    line.test._command = prints(document())
    line.daemon._on_board_link(False, "unplugged")
    assert line.test.result is None
    line.daemon._on_board_link(True, "plugged in")
    await until(lambda: line.test.result is not None and line.test.result[0] == PASSED)
    await line.daemon.stop()
    line.terminal.close()
