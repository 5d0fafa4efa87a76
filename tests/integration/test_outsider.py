"""An outsider's client against the running service: what clients/PROTOCOL.md promises, and what it refuses."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

import msgpack
import pytest
import zmq
from outsider import Outsider, finger
from service import drive, opened

MOVING = {"name": "walker", "path_mm": [[-40, 20], [40, 20]], "speed_mm_s": 80.0, "loop": True}


@pytest.fixture(scope="module")
def directory() -> Iterator[Path]:
    """A service whose two fingers are down."""
    with opened() as bench:
        bench.rig("rest")
        bench.service()
        drive(bench.client())  # it is driven once
        bench.close_clients()
        yield bench.runtime_dir


@pytest.fixture
def client(directory: Path) -> Iterator[Outsider]:
    made = Outsider(directory, "outsider")
    yield made
    made.release()
    made.close()


@pytest.fixture
def fingers(client: Outsider) -> list[int]:
    """The ids of the two fingers."""
    state = client.state(lambda state: len(state["fingers"]) == 2)
    return [one["id"] for one in state["fingers"]]


def test_hello_and_capabilities_say_what_the_protocol_says(client: Outsider) -> None:
    hello = client.request("hello")["body"]
    assert (hello["protocol"], "stamp" in hello["optional"], type(hello["instance"])) == (1, True, int)
    assert client.reply(msgpack.packb({"v": 1, "id": 9, "op": "hello", "body": {}}))["ok"]
    bounds = client.request("capabilities")["body"]
    assert (bounds["max_targets"], bounds["max_virtuals"], bounds["max_message_bytes"]) == (16, 16, 65536)


def test_the_plate_has_its_shapes_on_their_grid(client: Outsider) -> None:
    plate = client.request("plate")["body"]
    assert len(plate["shapes"]) == 4 * plate["modes"] * len(plate["y_mm"]) * len(plate["x_mm"])
    assert len(plate["w_limit_um"]) == plate["modes"]


def test_states_count_up_and_tell_of_every_finger(client: Outsider, fingers: list[int]) -> None:
    first, second = client.state(), client.state()
    assert (second["instance"], second["seq"]) == (first["instance"], first["seq"] + 1)
    assert second["t_ns"] > first["t_ns"]
    assert all(type(one) is int and one >= 1 for one in fingers)
    assert set(finger(second, fingers[0])) == {
        *("id", "x_mm", "y_mm", "predicted_x_mm", "predicted_y_mm", "target_um", "achieved_um", "virtual", "owner"),
        *("friction_change", "weber_frac", "contact_um", "felt_friction", "error_jnd", "misses_target"),
        *("contact_major_mm", "contact_minor_mm", "contact_angle_rad", "pressure_frac", "area_mm2"),
        *(f"{name}_{end}" for name in ("contact_um", "felt_friction", "achieved_um") for end in ("low", "high")),
    }


def test_targets_come_into_force_and_end_with_their_time_to_live(client: Outsider, fingers: list[int]) -> None:
    left, right = fingers
    client.push({"finger": left, "amplitude_um": 1.0}, {"finger": right, "friction": 1.0}, ttl_s=0.2)
    state = client.state(lambda state: finger(state, left)["target_um"] == 1.0)
    assert finger(state, right)["target_um"] == 0.0
    assert {one["owner"] for one in state["fingers"]} == {"outsider"}
    state = client.state(lambda state: finger(state, left)["owner"] is None)
    assert finger(state, left)["target_um"] == 0.0


def test_a_held_finger_is_refused_to_another_client_and_an_older_stamp_to_the_same(
    client: Outsider, fingers: list[int], directory: Path
) -> None:
    target = {"finger": fingers[0], "amplitude_um": 1.0}
    assert client.set(target, stamp=100, ttl_s=5.0)["ok"]
    assert "newer message" in client.set(target, stamp=99)["error"]
    other = Outsider(directory, "another")
    try:
        expected = f"finger {fingers[0]} is held by 'outsider': wait until that client releases it."
        assert other.set(target)["error"] == expected
        assert other.request("release", client="another", finger=fingers[0])["body"] == {"released": False}
    finally:
        other.release()
        other.close()


def test_a_finger_that_never_was_is_refused(client: Outsider) -> None:
    assert "has not touched the plate" in client.set({"finger": 77, "amplitude_um": 1.0})["error"]


def test_a_virtual_finger_walks_on_the_plate_and_not_beside_it(client: Outsider) -> None:
    assert client.set({"finger": "walker", "amplitude_um": 0.0}, virtuals=[MOVING], ttl_s=5.0)["ok"]
    state = client.state(lambda state: finger(state, "walker") != {})
    assert (finger(state, "walker")["virtual"], finger(state, "walker")["owner"]) == (True, "outsider")
    x_mm = finger(state, "walker")["x_mm"]
    client.state(lambda state: finger(state, "walker")["x_mm"] != x_mm)
    outside = MOVING | {"path_mm": [[500, 0]]}
    assert "leaves the plate" in client.set({"finger": "walker", "amplitude_um": 1.0}, virtuals=[outside])["error"]


def test_a_marker_is_in_one_state(client: Outsider) -> None:
    client.state()  # it is subscribed: what comes before is not kept for it
    t_ns = client.request("marker", client="outsider", text="trial 12 begins")["body"]["t_ns"]
    marked = client.state(lambda state: "markers" in state)
    assert marked["markers"] == [{"t_ns": t_ns, "client": "outsider", "text": "trial 12 begins"}]


@pytest.mark.parametrize(
    ("parts", "request_id"),
    [
        ([b""], 0),
        ([b"\x81"], 0),
        ([b"\x91" * 60_000], 0),
        ([b"\xc1"], 0),
        ([msgpack.packb({"v": 1, "id": 7, "op": "hello"}), b"and more"], 0),
        ([msgpack.packb({"v": 1, "id": 7, "op": "hello"}) + b"\x00"], 7),
        ([msgpack.packb([1, 2, 3])], 0),
        ([msgpack.packb({"v": 1, "id": 0, "op": "hello"})], 0),
        ([msgpack.packb({"v": 2, "id": 7, "op": "hello"})], 7),
        ([msgpack.packb({"v": 1, "id": 7, "op": "dance"})], 7),
        ([msgpack.packb({"v": 1, "id": 7, "op": "x" * 60_000})], 7),
        ([msgpack.packb({"v": 1, "id": 7, "op": "hello", "extra": 1})], 7),
        ([msgpack.packb({"v": 1, "id": 7, "op": "set", "body": {"client": "outsider", "targets": [{}] * 17}})], 7),
        ([msgpack.packb({"v": 1, "id": 7, "op": "set", "body": {"client": "outsider", "ttl_s": float("nan")}})], 7),
        ([msgpack.packb({"v": 1, "id": 7, "op": "set", "body": {"client": "\x1b[2J"}})], 7),
        ([msgpack.packb({"v": 1, "id": 7, "op": "marker", "body": {"client": "outsider", "text": "x" * 101}})], 7),
    ],
)
def test_what_is_wrong_is_refused_in_one_sentence_with_its_id(
    client: Outsider, parts: list[bytes], request_id: int
) -> None:
    reply = client.reply(*parts)
    assert (reply["ok"], reply["id"]) == (False, request_id)
    assert reply["error"].isprintable()
    assert client.request("hello")["ok"]


@pytest.mark.long
def test_thousands_of_subscriptions_and_of_bad_targets_stop_no_states(client: Outsider, directory: Path) -> None:
    hostile = Outsider(directory, "hostile")
    try:
        for n in range(3000):
            hostile.telemetry.subscribe(b"%d" % n + os.urandom(900))
            hostile.targets.send(b"\xc1" * 100, zmq.DONTWAIT) if hostile.targets.poll(0, zmq.POLLOUT) else None
        before = client.state()["seq"]
        t_end_s = time.monotonic() + 1.0
        while time.monotonic() < t_end_s:
            after = client.state()["seq"]
        assert after - before >= 30
    finally:
        hostile.close()
