"""Either device is pulled: a quiet plate, one line in the journal, and when it is back the plate is driven again."""

from __future__ import annotations

import numpy as np
import pytest
from service import Bench, drive, is_quiet, wait_for, wait_state

pytestmark = pytest.mark.long


def test_a_rig_that_dies_is_two_lines_and_the_next_one_is_driven(bench: Bench) -> None:
    rig, service, client, _ = bench.driven()
    rig.kill()
    state = wait_state(client, lambda state: state.state == "IDLE" and is_quiet(state))
    assert state.fingers == ()
    wait_for(lambda: len(service.lines_with("WARNING")) == 2)
    bench.rig()
    drive(client)  # fingers of the new rig are new fingers
    assert len(service.lines_with("WARNING", "board:", "lost")) == 1
    assert len(service.lines_with("WARNING", "trackpad:", "lost")) == 1
    assert len(service.lines_with("WARNING")) == 2
    assert len(service.lines_with("INFO board:", "open")) == 2


def test_a_trackpad_that_is_pulled_alone_leaves_a_quiet_plate_at_once(bench: Bench) -> None:
    rig, service, client, _ = bench.driven(record=True)
    before = len(service.lines)
    rig.replug_trackpad()
    wait_state(client, lambda state: state.state == "IDLE" and is_quiet(state))
    quiet = wait_state(client, lambda state: state.state == "IDLE")
    board = client.status()["board"]
    assert (board["state"], board["deadman_trips"]) == ("LIVE", 0)  # the daemon sent zero, and keeps the board alive
    assert len(service.lines) == before + 1
    assert service.lines[-1].startswith("WARNING trackpad: ")
    rig.replug_trackpad()
    again = drive(client)
    assert {finger.id for finger in again.fingers}.isdisjoint({1, 2})
    assert len(service.lines) == before + 2
    arrays = rig.recording()
    t_s = arrays["t_s"].real + rig.t_start_s
    pulled = (t_s > quiet.t_ns * 1e-9 + 0.06) & (t_s < again.t_ns * 1e-9 - 0.06)
    assert pulled.any()
    assert np.abs(arrays["modal_um"][pulled]).min() < 1e-3


def test_a_board_that_is_pulled_alone_falls_quiet_by_itself_and_is_driven_again(bench: Bench) -> None:
    rig, service, client, state = bench.driven()
    fingers = [finger.id for finger in state.fingers]
    before = len(service.lines)
    rig.replug_board()
    wait_state(client, lambda state: state.state == "IDLE" and is_quiet(state))
    assert client.status()["board"]["ready"] is False
    assert len(service.lines) == before + 1
    assert service.lines[-1].startswith(f"WARNING board: {bench.rig_dir}/board lost: ")
    gone = wait_state(client, lambda state: state.state == "IDLE")
    wait_state(client, lambda later: later.seq > gone.seq + 50)  # it is tried again, in silence
    assert len(service.lines) == before + 1
    rig.replug_board()
    back = wait_state(client, lambda state: state.state == "ACTIVE" and any(state.modal_um))
    assert [finger.id for finger in back.fingers] == fingers  # they never left the pad
    wait_for(lambda: client.status()["board"].get("deadman_trips", 0) >= 1)  # it had fallen quiet by itself
    assert len(service.lines_with("INFO board:", "firmware")) == 2


def test_still_fingers_are_driven_again_after_the_boards_plug_was_pulled(bench: Bench) -> None:
    rig, _, client, _ = bench.driven("rest")
    rig.replug_board()
    wait_state(client, lambda state: state.state == "IDLE")
    rig.replug_board()
    wait_state(client, lambda state: state.state == "ACTIVE" and any(state.modal_um))
    wait_for(lambda: any(abs(complex(*w_um)) > 0.3 for w_um in client.status()["board"].get("measured_um", ())))
