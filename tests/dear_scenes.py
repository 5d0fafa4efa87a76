"""Random client messages of all that the protocol allows, and changes of them, for the search for the dearest.

Each number is drawn at one of its range's ends as often as within it: what is dear is mostly an extreme.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from hapticd.bench.recording import LANDED_NS
from hapticd_contract.base import PROTOCOL_VERSION

Message = dict[str, Any]
Draw = Callable[[random.Random], float]

CLIENTS: Final = 4  # of a user: together they may ask for all surfaces that there are
HALF_PLATE_MM: Final = 60.0
TTL_S: Final = 5.0


class Scene(NamedTuple):
    """Messages of several clients; the users take turns in them."""

    messages: tuple[Message, ...]
    users: int


def scene(rng: random.Random, users: int) -> Scene:
    """Draw a scene: each client asks for as much as a message may hold, or for less."""
    return Scene(tuple(_message(rng, client) for client in range(CLIENTS * users)), users)


def changed(rng: random.Random, one: Scene) -> Scene:
    """Draw one element of a scene again, or let it stand in the place of all others of its kind."""
    index = rng.randrange(len(one.messages))
    message = dict(one.messages[index])
    kind = rng.choice(("virtuals", "targets", "surfaces", "effects"))
    other = _message(rng, index)
    if rng.random() < 0.3 or not message[kind]:
        message[kind] = other[kind]
        if kind in ("virtuals", "surfaces"):
            message["targets"], message["effects"] = other["targets"], other["effects"]
            message["virtuals"], message["surfaces"] = other["virtuals"], other["surfaces"]
    else:
        items = list(message[kind])
        place = rng.randrange(len(items))
        new = {**rng.choice(items)} if rng.random() < 0.5 or not other[kind] else {**rng.choice(other[kind])}
        for name in ("name", "finger"):
            if name in items[place]:
                new[name] = items[place][name]
        if rng.random() < 0.5 and kind != "effects":
            items = [{**new, **{name: item[name] for name in ("name", "finger") if name in item}} for item in items]
        else:
            items[place] = new
        message[kind] = items
    messages = list(one.messages)
    if rng.random() < 0.25:
        messages = [{**message, "client": each["client"], "virtuals": _renamed(message, each)} for each in messages]
        messages = [_own_names(each) for each in messages]
    else:
        messages[index] = message
    return one._replace(messages=tuple(messages))


def _number(low: float, high: float) -> Draw:
    """Draw a number at either end of its range as often as within it, evenly or by its logarithm."""

    def draw(rng: random.Random) -> float:
        kind = rng.random()
        if kind < 0.5:
            return low if kind < 0.25 else high
        if low > 0.0 and kind < 0.75:
            return math.exp(math.log(low) + rng.random() * math.log(high / low))
        return rng.uniform(low, high)

    return draw


_PLACE = _number(-HALF_PLATE_MM, HALF_PLATE_MM)
_UM = _number(0.0, 1.2)


def _content(rng: random.Random) -> Message:
    kind = rng.randrange(6)
    if kind == 0:
        return {"amplitude_um": _UM(rng)}
    if kind == 1:
        return {"friction": rng.random()}
    if kind == 2:
        grating = {
            "period_mm": _number(0.1, 50.0)(rng),
            "high_um": _UM(rng),
            "low_um": _UM(rng),
            "angle_rad": _angle(rng),
        }
        return {"grating": {**grating, "duty_frac": rng.choice((0.0, 0.5, 0.001, 0.999, 1.0, rng.random()))}}
    if kind == 3:
        side = rng.choice((1, 2, 16, 40))
        image: Message = {"width": side, "height": side, "levels": rng.randbytes(side * side)}
        if rng.random() < 0.5:
            return {"map": {**image, "friction": [rng.random(), rng.random()]}}
        return {"map": {**image, "high_um": _UM(rng), "low_um": _UM(rng)}}
    if kind == 4:
        gradient = {"from_um": _UM(rng), "to_um": _UM(rng), "length_mm": _number(0.1, 200.0)(rng)}
        return {"gradient": {**gradient, "angle_rad": _angle(rng)}}
    lengths_mm = sorted((_number(0.1, 100.0)(rng), _number(0.1, 100.0)(rng)))
    noise = {
        "shortest_mm": lengths_mm[0],
        "longest_mm": lengths_mm[1],
        "mean_um": 0.5,
        "rms_um": _number(0.0, 0.1)(rng),
    }
    return {"noise": {**noise, "seed": rng.randrange(2**32), "exponent": _number(0.0, 4.0)(rng)}}


_angle = _number(-6.2, 6.2)


def _path(rng: random.Random) -> Message:
    points = rng.choice((1, 2, 8, 64))
    reach_mm = rng.choice((0.01, 1.0, HALF_PLATE_MM))
    path = [[rng.uniform(-reach_mm, reach_mm), rng.uniform(-reach_mm, reach_mm)] for _ in range(points)]
    return {"path_mm": path, "speed_mm_s": _number(0.0, 2000.0)(rng), "loop": rng.random() < 0.7}


def _surface(rng: random.Random, name: str) -> Message:
    surface = {"name": name, **_content(rng), "angle_rad": _angle(rng), "scale": rng.choice((1.0, 1.0, 0.01, 100.0))}
    surface["z"] = rng.randint(-1000, 1000)
    surface["blend"] = rng.choice(("replace", "add", "max"))
    surface["turning_rad_s"] = rng.choice((0.0, _number(-62.0, 62.0)(rng)))
    if rng.random() < 0.5:
        surface |= _path(rng)
    else:
        surface["position_mm"] = [_PLACE(rng), _PLACE(rng)]
        surface["velocity_mm_s"] = [_number(-2000.0, 2000.0)(rng), rng.choice((0.0, _number(-2000.0, 2000.0)(rng)))]
    shape = rng.randrange(5)
    if shape == 1:
        surface["circle_mm"] = _number(0.1, 100.0)(rng)
    elif shape == 2:
        surface["rectangle_mm"] = [_number(0.1, 200.0)(rng), _number(0.1, 200.0)(rng)]
    elif shape == 3:
        corners = rng.choice((3, 16))
        surface["polygon_mm"] = [[rng.uniform(-60.0, 60.0), rng.uniform(-60.0, 60.0)] for _ in range(corners)]
    if rng.random() < 0.3:
        surface["t_pose_ns"] = LANDED_NS
    return surface


def _effect(rng: random.Random, name: str, surfaces: list[Message]) -> Message:
    effect: Message = {"name": name}
    kind = rng.randrange(3)
    if kind == 0:
        length_s = _number(0.001, 60.0)(rng)
        effect["pulse"] = {
            "height_um": _number(-1.0, 1.0)(rng),
            "length_s": length_s,
            "rise_s": length_s * rng.random() / 2,
        }
    elif kind == 1:
        count = rng.choice((2, 8, 20, 64))
        length_s = _number(0.001, 60.0)(rng)
        times_s = sorted(rng.uniform(0.0, length_s) for _ in range(count - 2))
        values = [[t_s, rng.random()] for t_s in (0.0, *times_s, length_s)]
        effect["envelope"] = {"points": values, "is_factor": rng.random() < 0.5}
    else:
        wave = {
            "frequency_hz": _number(1.0, 300.0)(rng),
            "depth": rng.random(),
            "shape": rng.choice(("sine", "square")),
        }
        effect["modulation"] = {**wave, **({"length_s": _number(0.001, 60.0)(rng)} if rng.random() < 0.5 else {})}
    if surfaces and rng.random() < 0.5:
        effect["surface"] = rng.choice(surfaces)["name"]
    causes = ["now", "landing"] + (["entering", "leaving", "crossing"] if surfaces else [])
    cause = rng.choice(causes)
    start: Message = {"cause": cause}
    if cause in ("entering", "leaving", "crossing"):
        start["surface"] = rng.choice(surfaces)["name"]
    if cause == "now" and rng.random() < 0.5:
        start["id"] = rng.randrange(1000)
    effect["start"] = start
    needs_length = cause == "crossing"
    if needs_length and "modulation" in effect:
        effect["modulation"]["length_s"] = 0.1
    effect["loops"] = rng.random() < 0.3 and not needs_length and "modulation" not in effect
    return effect


def _message(rng: random.Random, client: int) -> Message:
    """Draw a client's message: all of its kinds full, or few."""
    most = [rng.choice((0, 1, 4, 16, 16)) for _ in range(3)]
    virtuals = [{"name": f"v{client}.{index}", **_path(rng)} for index in range(most[0])]
    surfaces = [_surface(rng, f"s{index}") for index in range(most[1])]
    effects = [_effect(rng, f"e{index}", surfaces) for index in range(most[2])]
    targets = [{"finger": virtual["name"], **_content(rng)} for virtual in virtuals]
    message = {"v": PROTOCOL_VERSION, "client": f"c{client}", "ttl_s": TTL_S, "targets": targets, "virtuals": virtuals}
    message |= {"surfaces": surfaces, "effects": effects}
    return message


def _renamed(message: Message, each: Message) -> list[Message]:
    return [
        {**virtual, "name": virtual["name"].replace(message["client"][1:] + ".", each["client"][1:] + ".", 1)}
        for virtual in message["virtuals"]
    ]


def _own_names(message: Message) -> Message:
    """The message with its targets for its own virtual fingers."""
    names = [virtual["name"] for virtual in message["virtuals"]]
    targets = [{**target, "finger": name} for target, name in zip(message["targets"], names, strict=False)]
    return {**message, "targets": targets}
