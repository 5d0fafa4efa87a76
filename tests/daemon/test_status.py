"""What `status` and telemetry say: plain data, of now, and true."""

from __future__ import annotations

import math
from typing import Any

import msgpack
import numpy as np
import pytest
from machine_bench import MS, SLIPPERY, STICKY, Bench
from msgspec.msgpack import decode, encode

from hapticd.daemon import status


def plain(value: object) -> bool:
    """Whether any language's MessagePack can say it: no NaN, no foreign type, keys that are words."""
    if isinstance(value, dict):
        return all(isinstance(key, str) and plain(item) for key, item in value.items())
    if isinstance(value, (list, tuple)):
        return all(plain(item) for item in value)
    if isinstance(value, float):
        return type(value) is float and math.isfinite(value)
    return value is None or type(value) in (bool, int, str)


@pytest.mark.parametrize("when", ["at the start", "driven", "faulty", "unplugged", "stopped"])
def test_status_is_plain_data_at_any_time(when: str) -> None:
    bench = Bench(SLIPPERY, STICKY)
    if when != "at the start":
        bench.driven().run(300)
    if when == "faulty":
        bench.board.state, bench.board.fault_code = 2, 3
        bench.board.status()
        bench.run(20)
    elif when == "unplugged":
        bench.board.plugged = False
        bench.machine.board_link(False, "pulled", bench.t_ns)
    elif when == "stopped":
        bench.machine.stop(bench.t_ns)
    said = bench.machine.report_status(bench.t_ns)
    assert plain(said)
    assert msgpack.unpackb(msgpack.packb(said)).keys() == said.keys()


def test_status_has_rates_ages_counters_and_the_history_of_the_state() -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    bench.run(95)
    said: Any = bench.machine.report_status(bench.t_ns)
    assert said["state"] == "ACTIVE"
    assert said["fingers"] == 2
    assert said["touch"]["frames"] > 10
    assert 0.0 <= said["trackpad"]["silent_ms"] < 12.0
    assert said["board"]["ready"]
    assert said["board"]["state"] == "LIVE"
    assert [change["to"] for change in said["state_changes"]] == ["ACTIVE", "ARMED"]
    assert said["state_changes"][0]["ago_ms"] == pytest.approx(150, abs=12)
    assert said["state_changes"][1]["why"] == "the board answers and its clock is known"


def test_latencies_are_those_of_now() -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    bench.board.status()
    bench.run(200)
    now: Any = bench.machine.report_status(bench.t_ns)
    assert now["latency_ms"]["frames"] > 0
    assert 9.0 <= now["latency_ms"]["age"]["p50"] <= 12.0
    later: Any = bench.machine.report_status(bench.t_ns + status.RECENT_NS + 1000 * MS)
    assert later["latency_ms"] == {}


def test_a_plate_query_returns_size_limits_drive_and_shapes() -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    said: Any = decode(encode(bench.machine.describe_plate()))
    modes = bench.machine.modes
    assert (said["size_mm"], said["w_limit_um"], said["simulated"]) == ([137.5, 137.5], [4.0, 4.0], None)
    assert said["reference_limit_um"] == list(bench.machine.config.reference_limit_um)
    assert said["contact_radius_mm"] == 0.0  # two modes cannot still a whole contact
    assert said["drive_hz"] == pytest.approx(29205.0)
    shapes = np.frombuffer(said["shapes"], "<f4").reshape(said["modes"], len(said["y_mm"]), len(said["x_mm"]))
    points_mm = np.stack(np.meshgrid(said["x_mm"], said["y_mm"]), axis=-1)
    np.testing.assert_allclose(
        np.moveaxis(shapes, 0, -1), modes.evaluate(points_mm.reshape(-1, 2)).reshape(points_mm.shape), atol=1e-6
    )
    assert (said["x_mm"][0], said["x_mm"][-1]) == (modes.x_mm[0], modes.x_mm[-1])
    assert len(msgpack.packb(said)) < 65536


def test_the_timer_s_lateness_and_the_collector_s_time_are_in_status_and_states() -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    states = bench.published()
    bench.machine.status.loop.ticked(250_000, missed=3)
    for span_ns in (400_000, 2_000_000):
        bench.machine.status.loop.paused(span_ns)
    bench.run(20)
    timing: Any = bench.machine.report_status(bench.t_ns)["timing"]
    assert (timing["missed_ticks"], timing["pauses"]) == (3, 1)
    assert timing["histograms"]["tick_late"]["max_ms"] == 0.25
    assert (timing["histograms"]["pause"]["count"], timing["histograms"]["pause"]["max_ms"]) == (2, 2.0)
    last = states[-1]
    assert (last["tick_late_ms"], last["missed_ticks"], last["pauses"]) == (0.25, 3, 1)
