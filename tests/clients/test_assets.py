"""Assets through the library: uploaded once, shared by maps, and again when the daemon has been restarted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from asynchronous import wait_for
from fake_daemon import FakeDaemon

from hapticd.core.targets import assets as store
from hapticd_client import Asset, Client, HapticdError, Map, Rectangle, asset

STRIPES = np.tile(np.array([0, 255] * 512, dtype=np.uint8), (1024, 1))
PITCH_MM = 137.5 / 1023


def felt_um(daemon: FakeDaemon, column: float) -> float:
    return daemon.felt_um((column - 511.5) * PITCH_MM)


def test_a_picture_of_1024_pixels_is_felt_at_its_own_resolution_and_shared(daemon: FakeDaemon, client: Client) -> None:
    picture = client.asset(STRIPES)
    client.surface("photo", map=Map(picture, high_um=2.0))
    client.surface("half", Rectangle(10, 10), map=Map(picture, frictions=(1.0, 1.0)), position_mm=(0, 60))
    client.set(1, map=Map(picture, high_um=1.0))
    assert [felt_um(daemon, column) for column in (510, 511, 512, 513)] == pytest.approx([0, 2, 0, 2], abs=1e-9)
    assert daemon.scene.assets.report() == {"count": 1, "uploads": 0, "bytes": 2**20}


def test_a_restarted_daemon_gets_the_assets_in_use_again(daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(asset, "LOOK_S", 0.02)
    with Client(daemon.directory) as client:
        client.surface("photo", map=Map(client.asset([[0, 200]] * 2), high_um=2.55), ttl_s=0.06)
        client.asset([[1, 2, 3]])
        daemon.stop()
        daemon.start()
        wait_for(lambda: len(daemon.scene.surfaces.layers) > 0)
        assert felt_um(daemon, 1023) == pytest.approx(2.0)
        assert daemon.scene.assets.report()["count"] == 1  # what no map uses is not uploaded again


def test_a_client_that_changes_its_picture_all_the_time_always_finds_room(daemon: FakeDaemon, client: Client) -> None:
    for frame in range(store.MAX_BYTES // 2**20 + 2):
        levels = bytes([frame]) * 1024
        client.surface("video", map=Map(client.asset([levels] * 1024), high_um=2.55))
    assert felt_um(daemon, 0) == pytest.approx(0.01 * frame)


def test_the_end_of_a_client_does_not_wait_for_a_daemon_per_asset(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, keeper = list[str](), client._link.keeper

    def unanswered(_: object, what: str, *__: object, **___: object) -> dict[str, Any]:
        asked.append(what)
        keeper._stopped.set()  # as `close` does while it waits
        raise HapticdError("no answer")

    with monkeypatch.context() as patched:
        patched.setattr(asset, "LOOK_S", 0.0)
        patched.setattr(asset.Control, "request", unanswered)
        keeper.keep([Asset(bytes([n]) * 32, 1, 1, bytes([n])) for n in range(16)])
        assert keeper._thread is not None
        keeper._thread.join(20.0)
    assert asked == ["asset"]
