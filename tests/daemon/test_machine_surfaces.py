"""Surfaces in the machine: published by a client, reported in status, and felt from a finger's first report on."""

from __future__ import annotations

import hashlib

import msgpack
from machine_bench import MS, SLIPPERY, STICKY, Bench


def publish(bench: Bench, *surfaces: dict[str, object], client: str = "test", ttl_s: float = 5.0) -> None:
    bench.send(client=client, ttl_s=ttl_s, surfaces=surfaces)
    assert bench.machine.clients.refused == 0, bench.machine.clients.last_refusal


def landing(bench: Bench) -> int:
    """Run until a finger is down; the instant of its first report."""
    while not bench.machine.pipeline.fingers:
        bench.run(1)
    return bench.t_ns


def test_status_lists_all_surfaces_topmost_first_with_their_owners() -> None:
    bench = Bench(SLIPPERY, STICKY)
    publish(bench, {"name": "plate", "friction": 1.0}, {"name": "tile", "amplitude_um": 1.0, "circle_mm": 5.0})
    publish(bench, {"name": "patch", "amplitude_um": 0.5, "z": -1, "blend": "add"}, client="other")
    assert bench.ask("status")["body"]["surfaces"] == [
        {"client": "test", "name": "tile", "z": 0, "blend": "replace"},
        {"client": "test", "name": "plate", "z": 0, "blend": "replace"},
        {"client": "other", "name": "patch", "z": -1, "blend": "add"},
    ]
    assert bench.ask("release", client="test")["body"] == {"released": True}
    assert [one["name"] for one in bench.ask("status")["body"]["surfaces"]] == ["patch"]
    bench.t_ns += 6000 * MS
    assert bench.ask("status")["body"]["surfaces"] == []


def test_an_asset_is_uploaded_in_parts_felt_and_counted_and_a_name_has_one_user() -> None:
    bench = Bench(SLIPPERY)
    levels = bytes(200) + b"\xff" * 200
    body = {"client": "painter", "asset": hashlib.sha256(levels).digest(), "size": 400}
    assert bench.ask("asset", by="uid 1", offset=0, part=levels[:300], **body)["body"] == {"have": 300}
    assert bench.ask("asset", by="uid 2", offset=300, part=levels[300:], **body)["ok"] is False
    assert bench.ask("status")["body"]["assets"] == {"count": 0, "uploads": 1, "bytes": 300}
    assert bench.ask("asset", by="uid 1", offset=300, part=levels[300:], **body)["body"] == {"have": 400}
    image = {"width": 1, "height": 400, "asset": body["asset"], "high_um": 1.0}
    publish(bench, {"name": "photo", "map": image, "position_mm": [0, 70]})
    landing(bench)
    assert [point.target_um for point in bench.machine.last_tick.points] == [1.0]  # type: ignore[union-attr]
    bench.send()
    bench.run(12_000)
    assert bench.ask("status")["body"]["assets"] == {"count": 0, "uploads": 0, "bytes": 0}


def version(bench: Bench) -> int:
    """The version of the surfaces in the next state."""
    sent: list[bytes] = []
    bench.machine.watch(sent.append, bench.t_ns)
    bench.run(30)
    bench.machine.watch(None, bench.t_ns)
    return int(msgpack.unpackb(sent[-1])["surfaces_version"])


def test_a_reader_gets_all_surfaces_as_laid_with_owner_and_instant_of_pose() -> None:
    bench = Bench(SLIPPERY)
    publish(bench, {"name": "plate", "friction": 0.5}, client="other")
    grating = {"period_mm": 4.0, "high_um": 1.5}
    moving = {"position_mm": [1.0, 2.0], "velocity_mm_s": [20.0, 0.0], "angle_rad": 0.5, "z": 3, "blend": "add"}
    publish(bench, {"name": "patch", "grating": grating, "circle_mm": 8.0, **moving})
    t_laid_ns = bench.t_ns
    bench.run(100)
    body = bench.ask("surfaces")["body"]
    patch, plate = body["surfaces"]
    assert (patch["client"], patch["name"], patch["t_pose_ns"]) == ("test", "patch", t_laid_ns)
    assert moving.items() <= patch.items()
    assert (patch["grating"]["period_mm"], patch["circle_mm"]) == (4.0, 8.0)
    assert (plate["client"], plate["friction"]) == ("other", 0.5)
    assert "circle_mm" not in plate
    assert body["version"] == version(bench)
