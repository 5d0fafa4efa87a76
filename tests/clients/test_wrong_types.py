"""An argument of a wrong type is refused in one sentence, before anything is sent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from fake_daemon import FakeDaemon

from hapticd_client import Client, Grating, Map, RefusedError


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda c: c.set(1, amplitude_um="a"), "amplitude_um: must be a number, not 'a'."),
        (lambda c: c.set(1, amplitude_um=[1.0]), "amplitude_um: must be a number, not [1.0]."),
        (lambda c: c.set(1, friction=1j), "friction: must be a number, not 1j."),
        (lambda c: c.set(1, friction=0.5, ttl_s=None), "ttl_s: must be a number, not None."),
        (lambda c: c.set(1, grating=6.0), "grating: must be a Grating, not 6.0."),
        (lambda c: c.set(1, grating=Grating("wide", 1.0)), "period_mm: must be a number, not 'wide'."),
        (lambda c: c.set(1, map=[[1]]), "map: must be a Map, not [[1]]."),
        (lambda c: c.set(1, map=Map([1, 2], 1.0)), "map: must have rows of numbers, such as a two-dimensional array."),
        (lambda c: c.set(1, map=Map(7, 1.0)), "map: must have rows of numbers, such as a two-dimensional array."),
        (lambda _: Map.from_um([1, 2, 3]), "map: must have rows of numbers, such as a two-dimensional array."),
        (lambda _: Map.from_um([["a"]]), "map: must be a number, not 'a'."),
        (lambda c: c.set(None, friction=0.5), "finger: must be one of fingers(), its id or a name, not None."),
        (lambda c: c.set(True, friction=0.5), "finger: must be one of fingers(), its id or a name, not True."),
        (lambda c: c.set(1.5, friction=0.5), "finger: must be one of fingers(), its id or a name, not 1.5."),
        (lambda c: c.release([1]), "finger: must be one of fingers(), its id or a name, not [1]."),
        (lambda c: c.virtual(7, (0, 0)), "name: must have 1 .. 32 printable characters."),
        (lambda c: c.virtual("a", 5.0), "path: a point has two numbers, x and y."),
        (lambda c: c.virtual("a", ("x", "y")), "position: must be a number, not 'x'."),
        (lambda c: c.virtual("a", path=7), "path: a point has two numbers, x and y."),
        (lambda c: c.virtual("a", (0, 0), speed_mm_s="fast"), "speed_mm_s: must be a number, not 'fast'."),
        (lambda _: Client(name=7), "name: must have 1 .. 32 printable characters."),
    ],
)
def test_a_wrong_type_is_one_sentence(
    call: Callable[[Any], object], sentence: str, daemon: FakeDaemon, client: Client
) -> None:
    with pytest.raises(RefusedError) as raised:
        call(client)
    assert str(raised.value) == sentence
    assert daemon.scene.owner_of(1) is None
