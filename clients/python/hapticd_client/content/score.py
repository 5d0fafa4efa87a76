"""Content of a file, ready for the plate: layers that lie there, and effects that play at their time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from hapticd_contract.contents import MAX_MAP_SIDE
from hapticd_contract.effects import At, Form
from hapticd_contract.surfaces import Shape

from ..errors import RefusedError
from ..targets import Map
from .dropped import drop

if TYPE_CHECKING:
    from ..client import Client

AHEAD_S = 0.5  # an effect is sent so long before it begins
LEAD_S = 0.1  # before the first one
STEP_S = 0.02
LOOK_S = 1.0  # between looks whether the daemon still answers
MAX_LIVE = 12  # of the sixteen effects that a client may have


@dataclass(frozen=True, slots=True)
class Timed:
    """A form and when it begins, in seconds from the start."""

    begin_s: float
    form: Form

    @property
    def end_s(self) -> float:
        """The instant of its end."""
        length_s = getattr(self.form, "length_s", None)
        points: Any = getattr(self.form, "points", ())
        return self.begin_s + (points[-1][0] if points else length_s or 0.0)


@dataclass(frozen=True, slots=True)
class Layer:
    """A surface: its shape, its place, and its content as an argument of `Client.surface`.

    `levels` are rows of a map whose other arguments are in `content`.
    """

    content: dict[str, Any]
    shape: Shape | None = None
    position_mm: tuple[float, float] = (0.0, 0.0)
    levels: Any = None


@dataclass(frozen=True, slots=True)
class Score:
    """All of a file. `length_s` is 0 where nothing changes with time; `title` says what it is."""

    title: str
    layers: tuple[Layer, ...] = ()
    effects: tuple[Timed, ...] = ()
    length_s: float = field(default=0.0)

    def lay(self, plate: Client, name: str = "content") -> None:
        """Lay the layers on the plate, one above the other. Raises RefusedError."""
        for z, layer in enumerate(self.layers):
            content = layer.content if layer.levels is None else {"map": _map_of(plate, layer.levels, layer.content)}
            plate.surface(f"{name} {z}", layer.shape, position_mm=layer.position_mm, z=z, **content)

    def play(
        self,
        plate: Client,
        seconds: float = math.inf,
        *,
        loops: bool = False,
        sleep: Callable[[float], None] = time.sleep,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Lay the layers, play the effects under every finger on the plate, and return at their end or after `seconds`.

        Without effects, and with `loops`, that is after `seconds`. An effect that is refused is a DroppedWarning.
        Raises RefusedError for a layer, DaemonGoneError.
        """
        self.lay(plate)
        begin_ns, begin_s = plate.status()["t_ns"] + round(LEAD_S * 1e9), clock() + LEAD_S
        live: dict[str, float] = {}
        waiting, round_s, looked_s, count = list(self.effects), 0.0, begin_s, 0
        while (now_s := clock() - begin_s) < seconds:
            for name in [name for name, end_s in live.items() if end_s < now_s]:
                plate.stop(name)
                del live[name]
            while waiting and round_s + waiting[0].begin_s < now_s + AHEAD_S and len(live) < MAX_LIVE:
                one, name = waiting.pop(0), f"content {count % (MAX_LIVE + 1)}"
                count += 1
                try:
                    plate.effect(name, one.form, start=At(begin_ns + round((round_s + one.begin_s) * 1e9)))
                except RefusedError as error:  # such as a frequency for which this line is too slow
                    drop(str(error).rstrip("."))
                else:
                    live[name] = round_s + one.end_s
            if self.effects and not waiting:
                if loops:
                    waiting, round_s = list(self.effects), round_s + self.length_s
                elif not live:
                    return
            if clock() - looked_s >= LOOK_S:
                plate.status()
                looked_s = clock()
            sleep(STEP_S)


def _map_of(plate: Client, levels: Any, content: Mapping[str, Any]) -> Map:
    """Return a map of levels, as an asset where a message cannot hold them."""
    try:
        is_small = len(levels) <= MAX_MAP_SIDE and len(levels[0]) <= MAX_MAP_SIDE
    except (TypeError, IndexError):
        is_small = True  # what is wrong with it is said there
    return Map(levels if is_small else plate.asset(levels), **content)
