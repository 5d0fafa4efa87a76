"""Markers: from a client's call to the states of all clients and into the recording."""

from __future__ import annotations

import msgpack
import pytest
from machine_bench import SLIPPERY, Bench

import hapticd_client
from hapticd.daemon.client_gateway import MAX_MARKERS
from hapticd.errors import RequestError
from hapticd.wire.client import decode_request
from hapticd_client.messages import decode_state
from hapticd_contract.requests import MAX_MARKER_CHARACTERS


def test_a_marker_is_in_the_next_state_and_in_no_other() -> None:
    bench = Bench(SLIPPERY)
    published: list[bytes] = []
    bench.machine.status.publish = published.append
    reply = bench.ask("marker", client="study", text="trial 1 begins")
    bench.run(60)

    assert reply["ok"]
    markers = [state.markers for state in map(decode_state, published)]
    assert markers[0] == (hapticd_client.Marker(reply["body"]["t_ns"], "study", "trial 1 begins"),)
    assert not any(markers[1:])
    assert b"markers" not in published[-1]


def test_markers_that_nobody_reads_do_not_pile_up() -> None:
    bench = Bench(SLIPPERY)
    for _ in range(2 * MAX_MARKERS):
        bench.ask("marker", client="study", text="again")
    assert len(bench.machine.clients.markers) == MAX_MARKERS
    bench.run(60)
    assert bench.machine.clients.markers == []


def request(text: object) -> bytes:
    return msgpack.packb({"v": 1, "id": 1, "op": "marker", "body": {"client": "study", "text": text}})


@pytest.mark.parametrize("text", ["", "x" * (MAX_MARKER_CHARACTERS + 1), "line\nbreak", 7, None, b"bytes"])
def test_a_text_that_is_none_is_refused_in_a_sentence(text: object) -> None:
    with pytest.raises(RequestError, match=r"body\.text"):
        decode_request(request(text))
