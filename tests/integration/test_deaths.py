"""Whoever dies, the plate falls quiet: a client within its time to live, the daemon by the board's dead-man."""

from __future__ import annotations

import signal
import stat

import numpy as np
import pytest
from service import PATIENCE_S, Bench, wait_board, wait_state

from hapticd.board_protocol import BoardState
from hapticd_client import DaemonGoneError

pytestmark = pytest.mark.long

DEADMAN_S, RAMP_S, TICK_S = 0.050, 0.010, 0.0005
RING_DOWN_S = 0.060  # ten time constants of the plate


def test_a_killed_daemon_leaves_the_board_to_its_dead_man(bench: Bench) -> None:
    rig, service, client, state = bench.driven(record=True)
    wait_state(client, lambda later: later.seq > state.seq + 50)
    service.process.kill()
    service.process.wait(PATIENCE_S)
    assert wait_board(bench.rig_dir, BoardState.QUIET, 4).deadman_trips >= 1  # more where the machine stood still
    arrays = rig.recording()
    t_s, reference_um = arrays["t_s"].real, np.abs(arrays["reference_um"]).max(axis=1)
    # By the board's time alone, for the simulated rig may be late.
    zero = np.flatnonzero(reference_um)[-1] + 1
    assert zero < len(t_s)
    assert reference_um[(t_s > t_s[zero] - 0.2) & (t_s < t_s[zero])].max() > 0.3
    # The last frame precedes the end of its motion: then the board's dead-man waits and ramps to zero.
    moves = np.flatnonzero(np.abs(np.diff(reference_um[: zero + 1])) > 1e-9)
    waits = np.flatnonzero(np.diff(moves) > 0.02 / TICK_S)
    t_hold_s = t_s[moves[waits[-1]]] if len(waits) else t_s[moves[0]]
    assert t_s[zero] - t_hold_s <= DEADMAN_S + RAMP_S + 2 * TICK_S
    after = t_s > t_s[zero] + RING_DOWN_S
    assert after.any()
    assert np.abs(arrays["modal_um"][after]).max() < 1e-3
    with pytest.raises(DaemonGoneError):
        for _ in client.states(timeout_s=0.3):  # those that came before the end are still read
            pass


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_in_a_quiet_plate(bench: Bench, number: signal.Signals) -> None:
    rig, service, client, state = bench.driven(record=True)
    wait_state(client, lambda later: later.seq > state.seq + 20)
    assert service.end(number) == 0
    wait_board(bench.rig_dir, BoardState.QUIET, 4)
    arrays = rig.recording()
    assert np.abs(arrays["reference_um"]).max() > 0.3
    assert not arrays["reference_um"][-1].any()
    assert np.abs(arrays["modal_um"][-1]).max() < 1e-3
    assert service.lines_with(number.name) == [f"INFO {number.name}: stopping, silencing the plate"]
    last = [line for line in service.lines if "too busy" not in line][-1]
    assert last == service.lines_with(number.name)[0]
    assert not any(stat.S_ISSOCK(path.lstat().st_mode) for path in bench.runtime_dir.iterdir())
