"""The published bytes, and their arrival at a subscriber like PlotJuggler's."""

from __future__ import annotations

import math
import re
import threading
from typing import Any

import msgpack
import pytest
import zmq
from tools.stream.daemon_states import FakeDaemon, finger, plate_state, state_fields

from hapticd.errors import UsageError
from hapticd.tools.stream import plotjuggler
from hapticd.tools.stream.samples import Sampler

# One finger in one slot. By MessagePack's specification: de = map of up to 65535 pairs, ac = text of 12 bytes,
# cb = float of 64 bits, c0 = nil, c2 = false, single bytes = small whole numbers.
GOLDEN = (
    "de002a"  # 42 pairs
    "a974696d657374616d70" "cb4014" "0a3d70a3d70a"  # timestamp 5.01
    "a3745f73" "cb40140a3d70a3d70a"  # t_s 5.01
    "a3736571" "01"
    "a57374617465" "02"  # state ACTIVE
    "a76c696d69746564" "c2"  # limited false
    "ad6d69737365735f746172676574" "c0"
    "a66167655f6d73" "cb4024000000000000"  # age_ms 10
    "aa686f72697a6f6e5f6d73" "cb4030800000000000"  # horizon_ms 16.5
    "a766696e67657273" "01"
    "a76d61726b657273" "00"
    "ab6d6f64655f305f645f756d" "cb3ff8000000000000"  # mode_0_d_um 1.5
    "ab6d6f64655f305f715f756d" "cb0000000000000000"
    "b46d6f64655f305f6d656173757265645f645f756d" "cb3ff4000000000000"  # mode_0_measured_d_um 1.25
    "b46d6f64655f305f6d656173757265645f715f756d" "cb3fe0000000000000"
    "ab6d6f64655f315f645f756d" "cbbfe0000000000000"  # mode_1_d_um -0.5
    "ab6d6f64655f315f715f756d" "cb3fd0000000000000"
    "b46d6f64655f315f6d656173757265645f645f756d" "cbbfe0000000000000"
    "b46d6f64655f315f6d656173757265645f715f756d" "cb0000000000000000"
    "ab66696e6765725f315f6964" "03"  # finger_1_id 3
    "ad66696e6765725f315f785f6d6d" "cbc034800000000000"  # finger_1_x_mm -20.5
    "ad66696e6765725f315f795f6d6d" "cb4000000000000000"  # finger_1_y_mm 2
    "b766696e6765725f315f7072656469637465645f785f6d6d" "c0"
    "b766696e6765725f315f7072656469637465645f795f6d6d" "c0"
    "b266696e6765725f315f7461726765745f756d" "cb3ff0000000000000"  # finger_1_target_um 1
    "b466696e6765725f315f61636869657665645f756d" "c0"
    "b866696e6765725f315f6672696374696f6e5f6368616e6765" "c0"  # finger_1_friction_change
    "b366696e6765725f315f77656265725f66726163" "c0"
    "b366696e6765725f315f636f6e746163745f756d" "c0"  # finger_1_contact_um
    "b666696e6765725f315f66656c745f6672696374696f6e" "c0"
    "b266696e6765725f315f6572726f725f6a6e64" "c0"  # finger_1_error_jnd
    "b766696e6765725f315f636f6e746163745f756d5f6c6f77" "c0"  # finger_1_contact_um_low
    "b866696e6765725f315f636f6e746163745f756d5f68696768" "c0"
    "ba66696e6765725f315f66656c745f6672696374696f6e5f6c6f77" "c0"
    "bb66696e6765725f315f66656c745f6672696374696f6e5f68696768" "c0"
    "b866696e6765725f315f61636869657665645f756d5f6c6f77" "c0"
    "b966696e6765725f315f61636869657665645f756d5f68696768" "c0"
    "b666696e6765725f315f6d69737365735f746172676574" "c0"  # finger_1_misses_target
    "b966696e6765725f315f636f6e746163745f6d616a6f725f6d6d" "c0"  # finger_1_contact_major_mm
    "b966696e6765725f315f636f6e746163745f6d696e6f725f6d6d" "c0"
    "ba66696e6765725f315f636f6e746163745f616e676c655f726164" "c0"
    "b666696e6765725f315f70726573737572655f66726163" "c0"  # finger_1_pressure_frac
    "b166696e6765725f315f617265615f6d6d32" "c0"
)  # fmt: skip


def test_a_state_is_these_bytes() -> None:
    row = Sampler(1).row(plate_state(finger(3, -20.5, target_um=1.0)), 0)
    assert plotjuggler.encode(row).hex() == GOLDEN


def curves(payload: bytes) -> dict[str, float]:
    """Curves that PlotJuggler 3's parser reads: numbers and booleans by name; other values are skipped."""
    message: dict[str, Any] = msgpack.unpackb(payload)
    return {f"/{key}": float(value) for key, value in message.items() if isinstance(value, (int, float))}


def test_the_message_is_flat_and_all_its_values_are_finite_numbers_or_nothing() -> None:
    payload = plotjuggler.encode(Sampler(5).row(plate_state(finger(3), finger("walker", math.nan)), 10**18))
    message = msgpack.unpackb(payload)
    assert all(isinstance(key, str) for key in message)
    assert all(value is None or isinstance(value, (bool, int, float)) for value in message.values())
    assert all(map(math.isfinite, curves(payload).values()))
    assert "/finger_5_x_mm" not in curves(payload)


def test_every_state_reaches_a_subscriber_of_everything_in_one_part(fake_daemon: FakeDaemon) -> None:
    ended = threading.Event()
    context = zmq.Context()

    def run() -> None:
        plotjuggler.run(str(fake_daemon.directory), address, 2, ended.is_set)

    address = f"ipc://{fake_daemon.directory / 'plot'}"
    stream = threading.Thread(target=run)
    stream.start()
    try:
        fake_daemon.wait_for_subscriber()
        plot = context.socket(zmq.SUB)
        plot.connect(address)
        plot.subscribe(b"")
        sent = 0
        while not plot.poll(20):  # until the subscription has arrived
            sent += 1
            fake_daemon.publish(state_fields(sent))
        first = msgpack.unpackb(plot.recv())["seq"]
        for seq in range(sent + 1, sent + 21):
            fake_daemon.publish(state_fields(seq))
        received = []
        while not received or received[-1] < sent + 20:
            assert plot.poll(10_000), f"only {received}"
            parts = plot.recv_multipart()
            assert len(parts) == 1
            received.append(msgpack.unpackb(parts[0])["seq"])
        assert received == list(range(first + 1, sent + 21))
        plot.close(0)
    finally:
        ended.set()
        stream.join()
        context.term()


def test_an_address_that_cannot_be_bound_is_named() -> None:
    with zmq.Context() as context, context.socket(zmq.PUB) as first:
        first.bind("tcp://127.0.0.1:*")
        taken = first.get_string(zmq.LAST_ENDPOINT)
        for address in (taken, "tcp://127.0.0.1", "127.0.0.1:9872", "tcp://nowhere.invalid:1"):
            with pytest.raises(UsageError, match=f"--bind {re.escape(address)}"):
                plotjuggler.run(None, address, 1)
