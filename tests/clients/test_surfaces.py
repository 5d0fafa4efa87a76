"""Surfaces through the library: what it sends is what the daemon understands, and they live as long as the client."""

from __future__ import annotations

import pytest
from asynchronous import wait_for
from fake_daemon import FakeDaemon

from hapticd_client import Circle, Client, Gradient, Grating, Noise, Polygon, Rectangle
from hapticd_contract.surfaces import VirtualPath

TRIANGLE = Polygon([(0, 0), (9, 0), (0, 5.5)])


def names(daemon: FakeDaemon) -> list[str]:
    return [layer.name for layer in daemon.scene.surfaces.layers]


def test_surfaces_lie_on_the_plate_until_they_are_removed_or_the_client_ends(daemon: FakeDaemon) -> None:
    with Client(daemon.directory) as client:
        client.surface("track", Rectangle(100, 24), amplitude_um=1.5)
        client.surface("detent", Circle(2.0), friction=1.0, position_mm=(25, 0), z=1)
        client.surface("bow", TRIANGLE, grating=Grating(5.0, 1.0, 1.0), position_mm=(0, 40), scale=2.0)
        assert [daemon.felt_um(x_mm) for x_mm in (0.0, 25.0, 28.0, 51.0)] == [1.5, 0.0, 1.5, 0.0]
        assert daemon.felt_um(1.0, 50.0) == pytest.approx(1.0)
        client.surface("track", Rectangle(100, 24), amplitude_um=0.5)
        client.remove("detent")
        client.remove("detent")
        assert [daemon.felt_um(x_mm) for x_mm in (0.0, 25.0)] == [0.5, 0.5]
    assert names(daemon) == []


def test_a_surface_walks_a_path_and_has_gradients_and_noise(daemon: FakeDaemon, client: Client) -> None:
    client.surface("ramp", gradient=Gradient(100.0, 2.0))
    assert daemon.felt_um(25.0) == pytest.approx(1.5)
    client.surface("walk", Circle(3.0), friction=1.0, path=[(0, 0), (30, 0)], speed_mm_s=0.0, z=1)
    assert [daemon.felt_um(x_mm) for x_mm in (0.0, 10.0)] == pytest.approx([0.0, 1.2])
    client.surface("rough", Circle(3.0), noise=Noise(1.0, 8.0, 0.1, 1.0), position_mm=(0, 40), z=1)
    assert 0.7 <= daemon.felt_um(0.0, 40.0) <= 1.3
    (walk,) = [layer for layer in daemon.scene.surfaces.layers if layer.name == "walk"]
    assert walk.surface.path == VirtualPath(((0.0, 0.0), (30.0, 0.0)), 0.0, True)


def test_surfaces_are_refreshed_without_starting_their_motion_again(daemon: FakeDaemon, client: Client) -> None:
    client.surface("patch", Circle(3.0), amplitude_um=1.0, velocity_mm_s=(1, 0), ttl_s=0.1)
    (layer,) = daemon.scene.surfaces.layers
    before = layer.t_expires_ns
    wait_for(lambda: layer.t_expires_ns >= before + 200_000_000)
    assert daemon.scene.surfaces.layers == [layer]
