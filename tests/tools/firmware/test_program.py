"""`hapticd firmware` against the firmware's C in virtual time."""

from __future__ import annotations

import asyncio
import json
import math
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from carrier_board import fake_measurement
from virtual_board import BoardLink, in_virtual_time

from hapticd import __version__
from hapticd.__main__ import main
from hapticd.board_protocol import BoardState, RawVoltage
from hapticd.board_values import BoardStatus, SetController, SweepPoint
from hapticd.errors import DeviceError, UsageError
from hapticd.sim.board.board import BoardConfig
from hapticd.sim.board.virtual_link import LINK_S
from hapticd.tools.firmware.conversation import Conversation
from hapticd.wire.device import Decoder

from .conftest import converse

TypeIn = Callable[..., str]
SWEEP = ("sweep", "--points", "9", "--dwell", "100")


def test_info_shows_identity_and_status_and_all_of_them_as_json(link: BoardLink, type_in: TypeIn) -> None:
    output = type_in(link, "info")
    assert f"firmware  {__version__}, protocol 2" in output
    assert "modes     2, limits 4, 4 um and 150 V" in output
    assert "state     quiet" in output
    assert re.search(r"mode 1 +decay 183\.\d 1/s, \+10\.00 Hz from the drive", output)
    assert "events    0 logged" in output
    found = json.loads(type_in(link, "info", "--json"))
    assert (found["hello"]["boot_id"], found["status"]["state"]) == (7, "QUIET")
    assert [model["loop"] for model in found["controller"]["models"]] == [[1.0, 0.0]] * 2
    assert 0 < found["round_trip_ms"] < 20


def test_a_sweep_fits_the_resonance_that_is_there(link: BoardLink, type_in: TypeIn, tmp_path: Path) -> None:
    """The bench's plate is exactly what the firmware believes: 10 Hz off the drive, Q 500."""
    drawn, truth = tmp_path / "sweep.png", BoardConfig()
    assert type_in(link, *SWEEP, "--mode", "0", "--plot", str(drawn)).count("\n 29") == 9
    for k in range(2):
        found = json.loads(type_in(link, *SWEEP, "--mode", str(k), "--json"))
        fit = found["resonance"]
        assert math.pi * fit["frequency_hz"] / fit["q_factor"] == pytest.approx(truth.decay_1_s[k], rel=0.01)
        off_rad_s = 2 * math.pi * (fit["frequency_hz"] - truth.drive_hz)
        assert off_rad_s == pytest.approx(truth.detuning_rad_s[k], abs=2 * math.pi * 0.3)
        assert fit["gain_um_per_v_s"] == pytest.approx(truth.gain_um_per_v_s[k], rel=0.01)
        assert abs(fit["loop_phase_rad"]) < math.radians(1)
        assert fit["residual_frac"] < 0.01
        assert (len(found["points"]), found["sweep"]["voltage_v"]) == (9, 15.0)
    assert drawn.read_bytes().startswith(b"\x89PNG")
    assert link.peak_v <= 15.0001
    assert not link.voltage_v.any()


def test_a_sweep_whose_reader_has_gone_still_draws_it_and_without_one_it_ends(
    link: BoardLink, type_in: TypeIn, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reading, writing = os.pipe()
    os.close(reading)  # as `| head` does
    with os.fdopen(writing, "w") as output:
        monkeypatch.setattr(sys, "stdout", output)
        with pytest.raises(BrokenPipeError):
            type_in(link, *SWEEP)
        assert not link.voltage_v.any()
        type_in(BoardLink(), *SWEEP, "--plot", str(tmp_path / "sweep.png"))
    assert (tmp_path / "sweep.png").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--mode", "2"), "There is no mode 2: the board has modes 0 to 1"),
        (("--volts", "31"), "--volts is 31: open loop the board takes more than 0 and at most 30 V"),
        (("--volts", "nan"), "--volts: nan is out of bounds, it must be above 0"),
        (("--to", "40000"), "--to is 40000 Hz: the board sweeps 2000 Hz at most"),
        (("--points", "3000"), "--points: 3000 is out of bounds, it must be 5 .. 2001"),
        (("--dwell", "1001"), "dwell_ms is 1001, not within 1..1000"),
    ],
)
def test_a_sweep_that_cannot_be_is_refused_in_one_sentence(
    link: BoardLink, type_in: TypeIn, arguments: tuple[str, ...], sentence: str
) -> None:
    with pytest.raises((UsageError, DeviceError), match=re.escape(sentence)):
        type_in(link, *SWEEP, *arguments)
    assert link.peak_v == 0.0


def test_a_sweep_that_is_interrupted_leaves_a_quiet_plate(link: BoardLink) -> None:
    async def interrupted(board: Conversation) -> None:
        with board.driving():
            await board.demand(RawVoltage(0, 10 + 0j, 1000))
            await asyncio.sleep(0.03)
            assert abs(link.voltage_v[0]) == pytest.approx(10)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        converse(link, interrupted)
    assert not link.voltage_v.any()


def test_a_fault_during_a_sweep_ends_it_with_a_sentence(link: BoardLink, type_in: TypeIn) -> None:
    def broken_after_a_point(output: bytes) -> bytes:
        if any(isinstance(message, SweepPoint) for message in Decoder().feed(output)):
            fake_measurement(link.board, np.array([7.0 + 0j, 0j]))
        return output

    link.says = broken_after_a_point
    with pytest.raises(DeviceError, match="The board ended the sweep"):
        type_in(link, *SWEEP)
    output = type_in(link, "info")
    assert "state     fault: the measured amplitude stayed far above its limit" in output
    assert re.search(r"this boot, at \d+\.\d+ s, mode 0: the measured amplitude .* \(7\)", output)
    with pytest.raises(DeviceError, match="it is busy or has a fault"):
        type_in(link, *SWEEP)
    link.says = lambda output: output
    fake_measurement(link.board, None)
    assert type_in(link, "clear-fault") == "The board is quiet.\n"
    assert "1 logged" in type_in(link, "info")


def test_a_raw_voltage_is_held_for_its_time_and_its_amplitude_is_printed(link: BoardLink, type_in: TypeIn) -> None:
    output = type_in(link, "raw", "--volts", "12", "--phase", "90", "--ms", "400")
    gain, decay = link.board.config.gain_um_per_v_s[0], link.board.config.decay_1_s[0]
    expected_um = 12 * gain / math.hypot(decay, 20 * math.pi)
    assert float(re.search(r"mode 0 +([\d.]+) um", output)[1]) == pytest.approx(expected_um, rel=0.01)  # type: ignore[index]
    assert link.peak_v == pytest.approx(12)
    assert not link.voltage_v.any()


def test_telemetry_is_a_table_of_control_ticks(link: BoardLink, type_in: TypeIn) -> None:
    header, *rows = type_in(link, "telemetry", "--rate", "100", "--seconds", "0.5").splitlines()
    names = header.split(",")
    assert names[:2] == ["t_s", "t_board_us"]
    assert len(names) == 6 + 2 * 8
    table = np.array([[float(cell) for cell in row.split(",") if cell != "QUIET"] for row in rows])
    assert 45 <= len(table) <= 51
    np.testing.assert_allclose(np.diff(table[:, 0]), 0.01, atol=1e-9)
    assert all(len(row.split(",")) == len(names) for row in rows)


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ({"mute": True}, "No board answers on the bench"),
        (
            {"refuses": "ttyX cannot be opened: another program holds it"},
            "ttyX cannot be opened: another program holds it: stop the service first",
        ),
        ({"refuses": "ttyX cannot be opened: No such file or directory"}, "No such file or directory: check --port"),
    ],
)
def test_a_board_that_cannot_be_reached_is_named_in_one_sentence(
    type_in: TypeIn, setting: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(DeviceError, match=re.escape(sentence)):
        type_in(BoardLink(**setting), "info")


def test_a_wrong_baud_rate_is_recognised_by_the_noise(link: BoardLink, type_in: TypeIn) -> None:
    link.says = lambda data: bytes(byte ^ 0x5A for byte in data[:-1]) + b"\0"
    with pytest.raises(DeviceError, match="is damaged: check --baud"):
        type_in(link, "info")


def test_a_plug_that_is_pulled_ends_the_conversation(link: BoardLink) -> None:
    async def pulled(board: Conversation) -> None:
        asyncio.get_running_loop().call_later(0.05, link.pull)
        while await board.receive(1.0) is not None:
            pass

    with pytest.raises(DeviceError, match="The board disconnected: the cable was pulled"):
        converse(link, pulled)


def test_a_lost_reply_is_requested_again(link: BoardLink) -> None:
    async def talk(board: Conversation) -> BoardState | None:
        lost = iter((b"", b""))
        link.says = lambda data: next(lost, data)
        await board.demand(SetController("pi"))
        status = await board.wait_for(BoardStatus, 1.0)
        return None if status is None else status.state

    assert converse(link, talk) is BoardState.QUIET


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [((), "add --port or --config, or --sim")]
    + [
        (("--port", "/dev/null", "--baud", baud), "it must be 9600 .. 5250000")
        for baud in ("0", "-5", "99999999999999")
    ],
)
def test_a_board_that_is_not_named_or_a_speed_that_none_has_is_refused(
    arguments: tuple[str, ...], sentence: str, refused: Callable[..., str]
) -> None:
    assert sentence in refused("firmware", "info", *arguments)


def test_the_simulated_board_answers_through_its_pseudo_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["firmware", "info", "--sim"]) == 0
    assert "29205.00 Hz" in capsys.readouterr().out


@pytest.mark.parametrize("turns", range(6))
def test_a_cancellation_that_comes_with_a_message_is_not_lost(link: BoardLink, turns: int) -> None:
    async def listens_for_ever() -> None:
        async with Conversation(link, "the bench") as board:  # type: ignore[arg-type]
            link.says = cancelling
            while True:
                await board.receive(1.0)

    def cancelling(said: bytes) -> bytes:
        link.says = lambda data: data
        asyncio.get_running_loop().call_later(LINK_S, cancel, turns)
        return said

    def cancel(left: int) -> None:
        if left:
            asyncio.get_running_loop().call_soon(cancel, left - 1)
        else:
            listening.cancel()

    listening: asyncio.Task[None]

    async def whole() -> bool:
        nonlocal listening
        listening = asyncio.ensure_future(listens_for_ever())
        await asyncio.wait((listening,), timeout=2.0)
        return listening.cancelled()

    assert in_virtual_time(whole())
