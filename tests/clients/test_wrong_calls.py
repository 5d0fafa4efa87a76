"""A wrong argument is refused in one sentence, before anything is sent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from fake_daemon import FakeDaemon

from hapticd_client import (
    Client,
    Grating,
    Map,
    Modulation,
    Noise,
    OnEntering,
    OnLanding,
    OnLifting,
    OnPressure,
    Polygon,
    Pulse,
    RefusedError,
)

CLICK = Pulse(1.0, 0.01)
FINGERS: list[tuple[Callable[[Any], object], str]] = [
    (lambda c: c.set(1, amplitude_um="a"), "amplitude_um: must be a number, not a text."),
    (lambda c: c.set(1, friction=1j), "1j: is nothing that a message can have."),
    (lambda c: c.set(1, grating=Grating("wide", 1.0)), "grating.period_mm: must be a number, not a text."),
    (lambda c: c.set(1, map=Map([1, 2], 1.0)), "map: must have rows of numbers, such as a two-dimensional array."),
    (lambda _: Map.from_um([1, 2, 3]), "map: must have rows of numbers, such as a two-dimensional array."),
    (lambda c: c.set(None, friction=0.5), "finger: must be one of fingers(), its id or a name, not None."),
    (lambda c: c.release([1]), "finger: must be one of fingers(), its id or a name, not [1]."),
    (lambda c: c.virtual("a", ("x", "y")), "path_mm[0][0]: must be a number, not a text."),
    (lambda c: c.virtual("a", (0, 0), speed_mm_s="fast"), "speed_mm_s: must be a number, not a text."),
    (lambda _: Client(name="x" * 200), "name: must have 1 .. 32 printable characters."),
    (lambda c: c.marker("two\nlines"), "text: must have 1 .. 100 printable characters."),
]
SURFACES: list[tuple[Callable[[Any], object], str]] = [
    (lambda c: c.surface("a"), "surface: give exactly one of amplitude_um, friction, grating, map, gradient, noise"),
    (lambda c: c.surface("a", (1, 2), friction=1), "shape: must be a Circle, a Rectangle or a Polygon, not (1, 2)."),
    (
        lambda c: c.surface("a", Polygon([(0, 0), (1, 1), 5]), friction=1),
        "polygon_mm[2]: must be a list, not a whole number.",
    ),
    (lambda c: c.surface("a", friction=1, z=1.5), "z: must be a whole number, not 1.5."),
    (lambda c: c.surface("a", friction=1, blend="mix"), "blend: must be one of add, max, replace."),
    (lambda c: c.surface("a", friction=1, path=[(0, 0)], position_mm=(1, 1)), "path: with it there is no"),
    (lambda c: c.surface("a", noise=Noise(2, 1, 1, 1)), "noise.longest_mm: 1 is out of bounds, it must be 2 .. 1000."),
    (lambda c: c.surface("a", gradient=3), "gradient: must be a Gradient, not 3."),
    (lambda c: c.surface("a", map=Map([[1]])), "map: give exactly one of high_um and frictions."),
    (lambda c: c.surface("a", map=Map([[1]], frictions=(1,))), "friction: has 1 items, it must have 2."),
]
EFFECTS: list[tuple[Callable[[Any], object], str]] = [
    (lambda c: c.effect("", CLICK), "name: must have 1 .. 32 printable characters."),
    (lambda c: c.effect("a", 7), "form: must be a Pulse, an Envelope or a Modulation, not 7."),
    (lambda c: c.effect("a", CLICK, start=OnLanding), "start: must be one of Now, At, OnLanding and the other"),
    (lambda c: c.effect("a", CLICK, on="disc"), "effect: this client has no surface 'disc': lay it first."),
    (lambda c: c.effect("a", CLICK, start=OnEntering(3)), "start.surface: must be a text, not a whole number."),
    (lambda c: c.effect("a", CLICK, start=OnPressure(0.5, 0.6)), "start.release: must be below the threshold."),
    (
        lambda c: c.effect("a", CLICK, start=OnLifting(), loops=True),
        "would never end: an effect that starts by lifting needs a length.",
    ),
    (lambda c: c.effect("a", Modulation(9, shape="saw")), "modulation.shape: must be one of sine, square."),
]


@pytest.mark.parametrize(("call", "sentence"), FINGERS + SURFACES + EFFECTS)
def test_a_wrong_call_is_one_sentence_and_nothing_is_sent(
    call: Callable[[Any], object], sentence: str, daemon: FakeDaemon, client: Client
) -> None:
    """Of a sentence without its full stop only the beginning is compared. The daemon has the same bounds: see
    test_contract, and test_client_wire for each of them."""
    with pytest.raises(RefusedError) as refused:
        call(client)
    said = str(refused.value)
    assert said == sentence or (said.startswith(sentence) and not sentence.endswith("."))
    assert daemon.messages == 0
    assert daemon.stamps == []
