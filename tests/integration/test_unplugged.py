"""Either device is pulled: a quiet plate, one line in the journal, and when it is back the plate is driven again."""

from __future__ import annotations

import pytest
from service import Bench, is_quiet, wait_for, wait_state

pytestmark = pytest.mark.long


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
