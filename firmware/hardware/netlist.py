"""schematic.cir as it is simulated, for what is drawn and ordered of it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
SCHEMATIC, MODELS = HERE / "schematic.cir", HERE / "models.lib"
PINS = {"M": ("D", "G", "S", "B"), "S": ("", "", "on", "off")}  # of parts that are no subcircuits


@dataclass(frozen=True)
class Part:
    """A line of a circuit: its name in the schematic, its nets, its value or model, and what to order."""

    name: str
    nets: tuple[str, ...]
    value: str
    order: str
    pins: tuple[str, ...]  # of a box; () of a part with two ends

    @property
    def kind(self) -> str:
        return self.name[0]


@dataclass(frozen=True)
class Circuit:
    """A subcircuit, and the comment above it."""

    name: str
    ports: tuple[str, ...]
    parts: tuple[Part, ...]
    comment: str

    @property
    def nets(self) -> tuple[str, ...]:
        """All nets in the order in which the parts meet them; ground is the last."""
        met = dict.fromkeys(net for part in self.parts for net in part.nets)
        return tuple(sorted(met, key="0".__eq__))


def circuits(schematic: str, models: str) -> list[Circuit]:
    """Return the subcircuits of a schematic, whose boxes have the pins that the models name. Raises ValueError."""
    pins = {name: tuple(nets.split()) for name, nets in re.findall(r"(?m)^\.subckt (\w+) (.+)$", models)}
    found = []
    for comment, name, ports, body in re.findall(
        r"(?ms)((?:^\*[^\n]*\n)*)^\.subckt (\w+) ([^\n]+)\n(.*?)^\.ends", schematic
    ):
        parts = tuple(_part(line, pins) for line in body.splitlines() if not line.startswith("*"))
        text = " ".join(line.lstrip("* ") for line in comment.splitlines())
        found.append(Circuit(name, tuple(ports.split()), parts, text))
    return found


def _part(line: str, pins: dict[str, tuple[str, ...]]) -> Part:
    text, separator, order = line.partition(";")
    if not separator:
        raise ValueError(f"{line!r} does not end with what to order.")
    name, *words, value = text.split()
    if name[0] == "X":
        if len(pins[value]) != len(words):
            raise ValueError(f"{name}: {value} has {len(pins[value])} pins, not {len(words)}.")
        return Part(name[1:], tuple(words), value, order.strip(), pins[value])
    return Part(name, tuple(words), "" if name[0] == "V" else value, order.strip(), PINS.get(name[0], ()))


def read() -> list[Circuit]:
    """Return the circuits of the project's schematic."""
    return circuits(SCHEMATIC.read_text(encoding="utf-8"), MODELS.read_text(encoding="utf-8"))
