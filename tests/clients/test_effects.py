"""Effects through the library: what it sends is what the daemon understands, and each call is one start."""

from __future__ import annotations

from typing import Any

import pytest
from fake_daemon import FakeDaemon

from hapticd.wire import client as wire
from hapticd_client import (
    At,
    Circle,
    Client,
    Envelope,
    Modulation,
    Now,
    OnCrossing,
    OnEntering,
    OnLanding,
    OnLeaving,
    OnLifting,
    OnPressure,
    Pulse,
    RefusedError,
    target_set,
)
from hapticd_client.checks import checked
from hapticd_contract.effects import Effect
from hapticd_contract.states import EventKind
from hapticd_contract.surfaces import Surface

CLICK = Pulse(1.0, 0.01)


@pytest.mark.parametrize("on", [None, 3, "disc"])
@pytest.mark.parametrize("form", [CLICK, Pulse(-2.0, 0.001), Envelope([(0, 0), (1, 2), (1, 0)]), Modulation(250, 0.5)])
@pytest.mark.parametrize(
    "start",
    [
        *(Now(3), At(81), OnLanding(), OnLifting(), OnEntering("tile"), OnLeaving("tile"), OnCrossing("tile")),
        OnPressure(0.4),
    ],
)
def test_every_form_and_start_is_understood_everywhere(form: Any, on: Any, start: Any) -> None:
    targets = target_set.TargetSet()
    for name in ("disc", "tile"):
        targets = targets.with_surface(Surface(name=name, friction=1.0), 0.5)
    if isinstance(start, OnLifting | OnCrossing) and isinstance(form, Modulation):
        form = Modulation(250, 0.5, length_s=1.0)
    effect = checked(Effect.of(form, on, start, name="a"))
    assert wire.decode_targets(targets.with_effect(effect, 0.5).payload("c", None)).effects == (effect,)


def test_an_effect_is_kept_until_it_is_stopped_or_what_it_names_has_gone() -> None:
    full = target_set.TargetSet().with_surface(Surface(name="tile", friction=0.5), 0.5)
    for name, on, start in (("a", "tile", Now()), ("b", None, OnEntering("tile")), ("c", 3, Now()), ("d", None, Now())):
        full = full.with_effect(Effect.of(CLICK, on, start, name=name), 0.2)
    assert (full.ttl_s, full.fingers) == (0.2, {3})
    assert [one.name for one in wire.decode_targets(full.payload("c", None)).effects] == ["a", "b", "c", "d"]
    assert list(full.without_surface("tile").effects) == ["c", "d"]
    assert list(full.without(3).effects) == ["a", "b", "d"]
    assert list(full.without_effect("d").effects) == ["a", "b", "c"]
    with pytest.raises(RefusedError, match="this client has no surface 'patch': lay it first"):
        full.with_effect(Effect.of(CLICK, "patch", name="e"), 0.2)


# --- effects and events with a daemon ---------------------------------------------------------------------------


def held(daemon: FakeDaemon) -> dict[str, Any]:
    return {one.name: one for one in daemon.scene.effects.held}


def test_effects_are_in_force_until_they_are_stopped_or_the_client_ends(daemon: FakeDaemon) -> None:
    with Client(daemon.directory) as client:
        client.surface("disc", Circle(3.0), friction=0.5)
        client.effect("click", CLICK, on="disc", start=OnPressure(0.5))
        client.effect("hum", Modulation(40.0))
        before = held(daemon)
        client.effect("tick", CLICK, start=OnCrossing("disc"))
        assert held(daemon) == before | {"tick": held(daemon)["tick"]}  # the same objects: nothing starts once more
        client.effect("hum", Modulation(40.0))
        assert held(daemon)["hum"] is not before["hum"]
        client.stop("hum")
        client.stop("hum")
        client.remove("disc")
        assert held(daemon) == {}
        client.effect("hum", Modulation(40.0))
    assert held(daemon) == {}


def test_every_event_is_read_in_order_whatever_else_the_reader_does(daemon: FakeDaemon, client: Client) -> None:
    kinds = [EventKind.LANDED, EventKind.PRESSED, EventKind.BEGUN, EventKind.ENDED, EventKind.LIFTED]
    events = client.events(seconds=5.0)
    next(client.states())  # the daemon has a subscriber
    assert [event.kind for event in client.events(seconds=0.05)] == []
    daemon.happens += kinds
    for _ in range(20):
        next(client.states())
    read = [next(events) for _ in kinds]
    assert [(event.seq, event.kind) for event in read] == [(n + 1, kind.value) for n, kind in enumerate(kinds)]
    assert (read[0].finger, read[0].x_mm, read[0].y_mm, read[0].effect) == (1, 2.0, 3.0, "click")
    assert read[0].t_device_ns == read[0].t_ns - 10
