"""Both sides of the contract in one process: the client library against the daemon's sockets, decoder and scene."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zmq
from fake_daemon import FakeDaemon

from hapticd_client import (
    Asset,
    Client,
    DaemonGoneError,
    FingerState,
    Grating,
    HapticdError,
    Map,
    PlateState,
    Pulse,
    RefusedError,
    refresher,
)
from hapticd_client.endpoint import Endpoint
from hapticd_client.recording import Recording
from hapticd_client.target_set import TargetSet, stamp_now
from hapticd_contract.targets import FingerTarget

LIBRARY = Path(__file__).parents[2] / "clients" / "python"
PATIENCE_S = 5.0


def state_when(client: Client, is_so: Callable[[PlateState], bool]) -> PlateState:
    """The first state for which something holds."""
    give_up_s = time.monotonic() + PATIENCE_S
    for state in client.states(timeout_s=PATIENCE_S):
        if is_so(state):
            return state
        assert time.monotonic() < give_up_s, state
    raise AssertionError("states ended")


def finger_of(state: PlateState, finger_id: int | str) -> FingerState | None:
    return next((finger for finger in state.fingers if finger.id == finger_id), None)


def target_um(state: PlateState, finger_id: int | str) -> float | None:
    finger = finger_of(state, finger_id)
    return None if finger is None else finger.target_um


# --- asking -----------------------------------------------------------------------------------------------------


def test_each_finger_gets_what_was_set_by_the_time_set_returns(daemon: FakeDaemon, client: Client) -> None:
    daemon.fingers = dict.fromkeys(range(1, 6), (0.0, 0.0))
    one, *_ = client.fingers()
    client.set(one, amplitude_um=1.25)
    client.set(2, friction=1.0)
    client.set(3, friction=0.0)
    client.set(4, grating=Grating(period_mm=8.0, high_um=3.0, low_um=1.0))
    client.set(5, map=Map([[0, 255], [255, 0]], high_um=2.0))
    at_centre_um = [daemon.scene.amplitude_um(n, 0.0, 0.0) for n in range(1, 6)]
    assert at_centre_um == [1.25, 0.0, 2.0, 3.0, pytest.approx(1.0)]


def test_a_message_of_plain_values_replaces_all_that_was_set(daemon: FakeDaemon, client: Client) -> None:
    client.set(1, amplitude_um=1.0)
    client.surface("old", friction=0.5)
    client.virtual("ghost", position_mm=(0, 0))
    message = {
        "targets": [{"finger": "walker", "friction": 0.0}],
        "virtuals": [{"name": "walker", "path_mm": [[0, 0], [10, 0]]}],
        "surfaces": [{"name": "new", "circle_mm": 10, "friction": 1.0}],
        "effects": [{"name": "click", "surface": "new", "pulse": {"height_um": 1, "length_s": 0.02}}],
    }
    client.put(message)
    assert daemon.scene.owner_of(1) is None
    assert [one["name"] for one in client.surfaces()] == ["new"]
    state = state_when(client, lambda state: target_um(state, "walker") == 2.0)
    assert finger_of(state, "ghost") is None
    client.set(1, friction=1.0)  # goes on from there
    assert daemon.scene.owner_of("walker") == client.name


def test_a_message_that_is_none_is_refused_with_its_place_and_changes_nothing(
    daemon: FakeDaemon, client: Client
) -> None:
    client.set(1, amplitude_um=1.0)
    effect = {"name": "click", "surface": "none", "pulse": {"height_um": 1, "length_s": 0.02}}
    for message, sentence in (
        ({"targets": [{"finger": 1, "friction": 2.0}]}, r"targets\[0\].friction: 2 is out of bounds"),
        ({"effects": [effect]}, "no surface 'none'"),
        ([], "must be a map"),
    ):
        with pytest.raises(RefusedError, match=sentence):
            client.put(message)  # type: ignore[arg-type]
    assert daemon.scene.owner_of(1) == client.name


def test_streaming_ends_with_the_newest(daemon: FakeDaemon, client: Client) -> None:
    daemon.fingers = {1: (0.0, 0.0)}
    for n in range(1000):
        client.set(1, amplitude_um=n / 1000, wait=False)
    state_when(client, lambda state: target_um(state, 1) == 0.999)
    assert daemon.messages < 1000  # what came too fast was never sent
    assert daemon.refusals == []


def test_a_message_that_arrives_after_a_newer_one_changes_nothing(daemon: FakeDaemon) -> None:
    with Client(daemon.directory) as client, zmq.Context() as context, context.socket(zmq.PUSH) as late:
        before = stamp_now()
        client.set(1, amplitude_um=1.0)
        late.connect(f"ipc://{daemon.directory / 'targets'}")
        late.send(TargetSet().with_target(FingerTarget(1, amplitude_um=3.0), 0.5).payload(client.name, before))
        state_when(client, lambda _: daemon.overtaken == 1)
        assert daemon.scene.amplitude_um(1, 0.0, 0.0) == 1.0
        late.linger = 0


def test_refreshes_repeat_the_stamp_of_what_they_repeat(daemon: FakeDaemon, client: Client) -> None:
    daemon.fingers = {1: (0.0, 0.0)}
    client.set(1, amplitude_um=1.0, ttl_s=0.03)
    state_when(client, lambda _: daemon.messages >= 5)
    assert len(set(daemon.stamps)) == 1
    client.set(1, amplitude_um=2.0, ttl_s=0.03)
    state_when(client, lambda _: daemon.stamps.count(max(daemon.stamps)) >= 5 and max(daemon.stamps) > daemon.stamps[0])
    assert len(set(daemon.stamps)) == 2


def test_a_refusal_is_raised_with_the_daemons_sentence_and_changes_nothing(daemon: FakeDaemon, client: Client) -> None:
    daemon.fingers = {1: (0.0, 0.0)}
    client.set(1, amplitude_um=1.0)
    with pytest.raises(RefusedError, match="finger 1 cannot have 5 um: ask for at most 4 um"):
        client.set(1, amplitude_um=5.0)
    state_when(client, lambda state: target_um(state, 1) == 1.0)


@pytest.mark.parametrize(
    ("known", "what", "call"),
    [
        ((), "surfaces", lambda c: c.surface("plate", friction=1.0)),
        (("surfaces",), "effects", lambda c: c.effect("click", Pulse(1.0, 0.01))),
        (("surfaces",), "assets", lambda c: c.asset([[1]])),
        (("surfaces",), "assets", lambda c: c.surface("a", map=Map(Asset(bytes(32), 1, 1, b"a"), 1.0))),
        (("surfaces",), "maps of frictions", lambda c: c.set(1, map=Map([[1]], frictions=(0, 1)))),
        (("surfaces",), "priorities", lambda c: c.set(1, friction=0.5, priority=1)),
    ],
)
def test_an_older_daemon_is_not_sent_what_it_does_not_know(
    known: tuple[str, ...], what: str, call: Callable[[Client], object], daemon: FakeDaemon
) -> None:
    daemon.optional = ("stamp", *known)
    with Client(daemon.directory) as client:
        with pytest.raises(RefusedError, match=f"{what}: this daemon does not have that: update it"):
            call(client)
        client.set(1, friction=0.5, priority=0)  # whose message it understands
    assert daemon.refusals == []


def test_more_maps_than_a_message_holds_are_refused_before_they_cost_the_connection(
    daemon: FakeDaemon, client: Client
) -> None:
    large = Map([[7] * 128] * 128, high_um=1.0)
    for finger in (1, 2, 3):
        client.set(finger, map=large)
    with pytest.raises(RefusedError, match="use smaller maps"):
        client.set(4, map=large)
    assert daemon.scene.owner_of(3) == client.name


# --- virtual fingers --------------------------------------------------------------------------------------------


def test_a_virtual_finger_walks_feels_and_is_released_by_its_name(client: Client) -> None:
    client.virtual("ghost", path=[(-40, 20), (40, 20)], speed_mm_s=2000)
    client.set("ghost", amplitude_um=0.0)
    first = finger_of(state_when(client, lambda state: target_um(state, "ghost") == 0.0), "ghost")
    state_when(client, lambda state: abs(finger_of(state, "ghost").x_mm - first.x_mm) > 5)
    client.release("ghost")
    state_when(client, lambda state: finger_of(state, "ghost") is None)


# --- time to live -----------------------------------------------------------------------------------------------


def test_a_target_outlasts_its_time_to_live_while_its_client_runs(daemon: FakeDaemon, client: Client) -> None:
    daemon.fingers = {1: (0.0, 0.0)}
    client.set(1, amplitude_um=1.0, ttl_s=0.15)
    start = state_when(client, lambda state: target_um(state, 1) == 1.0)
    state_when(client, lambda state: state.t_ns > start.t_ns + 500_000_000 and target_um(state, 1) == 1.0)
    assert daemon.messages >= 4


def test_leaving_the_client_releases_its_fingers_at_once(daemon: FakeDaemon) -> None:
    with Client(daemon.directory) as client:
        client.set(1, amplitude_um=1.0, ttl_s=5.0)
        assert daemon.scene.owner_of(1) == client.name
    assert daemon.scene.owner_of(1) is None
    with Client(daemon.directory) as successor:
        successor.set(1, amplitude_um=2.0)


SET_AND = """
import sys
from hapticd_client import Client
client = Client(sys.argv[1], name="child")
client.set(1, amplitude_um=1.0, ttl_s=float(sys.argv[2]))
print("set", flush=True)
"""


@contextmanager
def child(daemon: FakeDaemon, program: str, ttl_s: float) -> Iterator[subprocess.Popen[str]]:
    """A program of its own that has set finger 1. Its standard input stays open until it is left to itself."""
    environ = {**os.environ, "PYTHONPATH": str(LIBRARY)}
    command = [sys.executable, "-c", program, str(daemon.directory), str(ttl_s)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, env=environ, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout.readline() == "set\n"
        try:
            yield process
        finally:
            process.kill()


def test_a_program_that_just_ends_releases_its_fingers(daemon: FakeDaemon) -> None:
    with child(daemon, SET_AND, ttl_s=5.0) as process:
        assert process.wait(PATIENCE_S) == 0
    assert daemon.scene.owner_of(1) is None


def test_a_killed_program_loses_its_fingers_when_its_time_is_up(daemon: FakeDaemon) -> None:
    daemon.fingers = {1: (0.0, 0.0)}
    with child(daemon, SET_AND + "sys.stdin.read()", ttl_s=0.2) as process, Client(daemon.directory) as client:
        state_when(client, lambda state: target_um(state, 1) == 1.0)
        process.send_signal(signal.SIGKILL)
        process.wait(PATIENCE_S)
        killed_ns = time.monotonic_ns()
        state = state_when(client, lambda state: target_um(state, 1) is None)
        assert state.t_ns - killed_ns < 1_000_000_000


def test_a_stopped_program_loses_its_fingers_and_has_them_again_when_it_goes_on(daemon: FakeDaemon) -> None:
    daemon.fingers = {1: (0.0, 0.0)}
    with child(daemon, SET_AND + "sys.stdin.read()", ttl_s=0.2) as process, Client(daemon.directory) as client:
        state_when(client, lambda state: target_um(state, 1) == 1.0)
        process.send_signal(signal.SIGSTOP)
        state_when(client, lambda state: target_um(state, 1) is None)
        client.set(1, amplitude_um=0.5)  # it has no owner, so another client may
        process.send_signal(signal.SIGCONT)
        state_when(client, lambda _: any("held by" in refusal for refusal in daemon.refusals))
        client.release(1)
        state_when(client, lambda state: target_um(state, 1) == 1.0)


def test_a_client_that_becomes_garbage_on_its_own_thread_releases_its_fingers(
    daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    holder = [Client(daemon.directory)]
    holder[0].set(1, amplitude_um=1.0, ttl_s=5.0)
    sent = refresher._sent

    def forgetting(socket: Any, payload: bytes) -> bool:
        holder.clear()
        return sent(socket, payload)

    with Client(daemon.directory) as watch:
        monkeypatch.setattr(refresher, "_sent", forgetting)
        holder[0].set(2, amplitude_um=1.0, ttl_s=5.0)
        state_when(watch, lambda _: daemon.scene.next_expiry_ns is None)


def test_targets_of_a_lifted_finger_are_dropped(daemon: FakeDaemon, client: Client) -> None:
    daemon.fingers = {1: (0.0, 0.0), 2: (1.0, 1.0)}
    for finger in client.fingers():
        client.set(finger, amplitude_um=1.0)
    del daemon.fingers[1]
    state_when(client, lambda state: finger_of(state, 1) is None)
    state_when(client, lambda _: daemon.scene.owner_of(1) is None)
    assert daemon.scene.owner_of(2) == client.name


# --- daemons that are not there ---------------------------------------------------------------------------------


def test_without_a_daemon_the_error_names_endpoint_and_remedy(tmp_path: Path) -> None:
    with pytest.raises(DaemonGoneError, match=f"No hapticd answers at {tmp_path}: start one") as caught:
        Client(tmp_path, timeout_s=0.05)
    assert isinstance(caught.value, ConnectionError)
    with pytest.raises(HapticdError, match="is not a valid runtime directory"):
        Client(tmp_path / ("d" * 100), timeout_s=0.05)


@pytest.mark.parametrize(
    ("ending", "lines"),
    [
        ("Client(sys.argv[1], timeout_s=1.0)", ["Waiting for hapticd at {}", "No hapticd answers at {}: start one"]),
        ("Client(sys.argv[1], timeout_s=0.1)", ["No hapticd answers at {}: start one"]),
        ("raise HapticdError('other')", ["Traceback", "  File", "hapticd_client.errors.HapticdError: other"]),
    ],
)
def test_a_script_without_a_daemon_says_that_it_waits_and_ends_in_a_sentence(
    tmp_path: Path, ending: str, lines: list[str]
) -> None:
    begin = "import sys; from hapticd_client import Client, HapticdError, connection"
    script = f"{begin}; connection.SILENT_S, connection.SHORT_S = 0.0, 0.5\n{ending}"
    ended = subprocess.run([sys.executable, "-c", script, tmp_path], capture_output=True, text=True, check=False)
    assert (ended.returncode, len(ended.stderr.splitlines())) == (1, len(lines))
    for line, sentence in zip(ended.stderr.splitlines(), lines, strict=True):
        assert line.startswith(sentence.format(tmp_path))


def test_states_end_with_an_error_when_the_daemon_is_gone(daemon: FakeDaemon) -> None:
    with Client(daemon.directory, timeout_s=0.2) as client:
        states = client.states(timeout_s=0.2)
        next(states)
        daemon.stop()
        with pytest.raises(DaemonGoneError, match="No state from"):
            for _ in states:
                pass
        with pytest.raises(DaemonGoneError):
            client.status()
        with pytest.raises(DaemonGoneError):
            client.fingers(timeout_s=0.1)


def test_a_restarted_daemon_gets_every_target_again(daemon: FakeDaemon, client: Client) -> None:
    daemon.fingers = {1: (0.0, 0.0)}
    client.set(1, amplitude_um=1.0)
    client.virtual("ghost", position_mm=(3, 4))
    before = state_when(client, lambda state: target_um(state, 1) == 1.0)
    daemon.stop()
    daemon.start()
    after = state_when(client, lambda state: state.instance != before.instance and target_um(state, 1) == 1.0)
    assert finger_of(after, "ghost") is not None
    client.set(1, amplitude_um=2.0)


def test_a_daemon_of_another_protocol_is_refused(daemon: FakeDaemon) -> None:
    daemon.protocol = 2
    with pytest.raises(HapticdError, match="has protocol version 2, this library 1"):
        Client(daemon.directory)


def test_a_closed_client_raises(daemon: FakeDaemon) -> None:
    client = Client(f"ipc://{daemon.directory}")
    states = client.states()
    next(states)
    client.close()
    client.close()
    for use in (
        lambda: client.set(1, friction=0.5),
        lambda: client.set(1, friction=0.5, wait=False),
        client.status,
        client.fingers,
        lambda: next(states),
        client.release,
    ):
        with pytest.raises(HapticdError, match="This client is closed"):
            use()


def test_a_slow_reader_sees_the_newest_state_and_not_the_oldest(daemon: FakeDaemon) -> None:
    with Client(daemon.directory) as client, Client(daemon.directory) as watch:
        states = client.states()
        first = next(states)
        state_when(watch, lambda state: state.seq > first.seq + 40)
        assert next(states).seq > first.seq + 30


def test_a_marker_may_be_a_map_which_an_older_daemon_refuses(daemon: FakeDaemon) -> None:
    with Client(daemon.directory, name="study") as client:
        client.marker({"event": "begin", "trial": np.int64(7), "level_um": 0.5, "is_new": True})
        with pytest.raises(RefusedError, match="fields: has 17 entries"):
            client.marker({str(number): number for number in range(17)})
    (marker,) = daemon.markers
    assert marker.text == "event=begin trial=7 level_um=0.5 is_new=True"
    assert marker.fields == {"event": "begin", "trial": 7, "level_um": 0.5, "is_new": True}
    daemon.optional = tuple(one for one in daemon.optional if one != "marker_fields")
    with Client(daemon.directory, name="old") as client, pytest.raises(RefusedError, match="a map as a marker: this"):
        client.marker({"trial": 8})


def test_a_trial_has_its_levels_at_its_begin_and_its_result_at_its_end(daemon: FakeDaemon) -> None:
    with Client(daemon.directory, name="study") as client:
        with client.trial(7, level=0.3) as result:
            result["answer"] = "left"
        with pytest.raises(KeyError), client.trial(8):
            raise KeyError
    assert [one.fields for one in daemon.markers] == [
        {"event": "begin", "trial": 7, "level": 0.3},
        {"event": "end", "trial": 7, "answer": "left"},
        {"event": "begin", "trial": 8},
    ]


def test_what_cannot_be_recorded_is_one_sentence(daemon: FakeDaemon, tmp_path: Path) -> None:
    (tmp_path / "taken.mcap").touch()
    with Client(daemon.directory) as client:
        with pytest.raises(HapticdError, match=r"taken\.mcap: exists already: give another name\."):
            client.record(tmp_path / "taken.mcap")
        with pytest.raises(HapticdError, match="No hapticd answers in"), client.record(tmp_path / "a.mcap"):
            pass
    with pytest.raises(HapticdError, match="this daemon is on another machine"):
        Recording(Endpoint(host="10.0.0.1", port=7410), tmp_path / "b.mcap", (), replays=False)


def test_the_reach_is_that_of_a_finger_or_of_a_place(daemon: FakeDaemon, client: Client) -> None:
    daemon.fingers = {1: (-20.0, 0.0)}
    assert client.reach(1) == client.reach(x_mm=3.0, y_mm=-4.0) == (0.25, 0.75)
    assert client.reach(2) is None
    for wrong in ({}, {"x_mm": 1.0}, {"finger": 1, "x_mm": 1.0, "y_mm": 2.0}, {"x_mm": math.nan, "y_mm": 0.0}):
        with pytest.raises(RefusedError):
            client.reach(**wrong)


def test_a_person_is_named_for_the_plate_and_an_unknown_one_leaves_no_client(daemon: FakeDaemon) -> None:
    with Client(daemon.directory) as client:
        with pytest.warns(UserWarning, match=r"It is old\."):
            client.person("anna")
        with pytest.raises(RefusedError, match="There is no bob"):
            client.person("bob")
        assert daemon.person == "anna"
        client.person(None)
        assert daemon.person is None
    with pytest.raises(RefusedError, match="There is no bob"):
        Client(daemon.directory, person="bob")
