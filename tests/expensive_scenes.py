"""Scenes that use every cap of the protocol at once, for tests of what a pass and a message may cost."""

from __future__ import annotations

import random
from typing import Any

from hapticd_contract.base import PROTOCOL_VERSION

Message = dict[str, Any]
CLIENTS = 4


def scene(rng: random.Random) -> list[Message]:
    """Return the messages of CLIENTS clients: all virtual fingers, surfaces, corners and effects that there may be."""
    return [_message(rng, client) for client in range(CLIENTS)]


def _message(rng: random.Random, client: int) -> Message:
    names = [f"v{client}.{n}" for n in range(4)]
    return {
        "v": PROTOCOL_VERSION,
        "client": f"c{client}",
        "ttl_s": 5.0,
        "virtuals": [{"name": name, **_path(rng)} for name in names],
        "targets": [{"finger": name, **_content(rng)} for name in names],
        "surfaces": [_surface(rng, n) for n in range(16)],
        "effects": [_effect(rng, n) for n in range(16)],
    }


def _noise(rng: random.Random) -> Message:
    waves = {"shortest_mm": rng.choice((0.1, 5.0)), "longest_mm": 50.0, "mean_um": 0.5, "rms_um": 0.1}
    return {"noise": {**waves, "seed": rng.randrange(2**32), "exponent": 1.0}}


def _content(rng: random.Random) -> Message:
    grating = {"period_mm": rng.choice((0.1, 2.0)), "low_um": 0.0, "high_um": 1.0, "duty_frac": rng.choice((0.0, 0.5))}
    image = {"width": 40, "height": 40, "levels": rng.randbytes(1600), "friction": [0.1, 0.9]}
    return rng.choice(({"grating": grating}, {"map": image}, _noise(rng)))


def _path(rng: random.Random) -> Message:
    reach_mm = rng.choice((0.5, 60.0))
    points = [[rng.uniform(-reach_mm, reach_mm), rng.uniform(-reach_mm, reach_mm)] for _ in range(64)]
    return {"path_mm": points, "speed_mm_s": rng.choice((200.0, 2000.0)), "loop": True}


def _surface(rng: random.Random, index: int) -> Message:
    """One of four is noise that turns on a path with near corners; all lie over the whole plate, and are added."""
    surface: Message = {"name": f"s{index}", "z": rng.randint(-9, 9), "blend": rng.choice(("add", "add", "max"))}
    surface["rectangle_mm"] = [rng.uniform(20.0, 200.0), rng.uniform(20.0, 200.0)]
    if index % 4 == 0:
        return {**surface, **_noise(rng), **_path(rng), "turning_rad_s": 6.0}
    content = rng.choice(
        ({"amplitude_um": 0.5}, {"map": {"width": 40, "height": 40, "levels": rng.randbytes(1600), "high_um": 1.0}})
    )
    return {**surface, **content, "velocity_mm_s": [rng.uniform(-200.0, 200.0), 50.0]}


def _effect(rng: random.Random, index: int) -> Message:
    form = rng.choice(
        (
            {"modulation": {"frequency_hz": rng.choice((40.0, 200.0)), "depth": 0.5}},
            {"pulse": {"height_um": 0.5, "length_s": 60.0, "rise_s": 1.0}},
        )
    )
    where = {"surface": f"s{rng.randrange(16)}"} if rng.random() < 0.5 else {}
    cause = rng.choice(("now", "landing", "entering"))
    start = {"cause": cause, **({"surface": f"s{rng.randrange(16)}"} if cause == "entering" else {})}
    return {"name": f"e{index}", **form, **where, "start": start}
