"""Fake of pylsl without liblsl: it keeps descriptions and samples."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any


class FakeElement:
    """A node of a stream's description."""

    def __init__(self) -> None:
        self.values: dict[str, str] = {}
        self.children: list[FakeElement] = []

    def append_child(self, _: str) -> FakeElement:
        self.children.append(FakeElement())
        return self.children[-1]

    def append_child_value(self, key: str, value: str) -> FakeElement:
        self.values[key] = value
        return self


class FakeInfo:
    def __init__(self, name: str, kind: str, channels: int, rate_hz: float, form: str, source: str) -> None:
        self.name, self.kind, self.channels = name, kind, channels
        self.rate_hz, self.form, self.source = rate_hz, form, source
        self.description = FakeElement()

    def desc(self) -> FakeElement:
        return self.description


class FakeLsl:
    """The part of pylsl that the stream uses, with the samples of each outlet by name."""

    cf_string, cf_double64, IRREGULAR_RATE = "string", "double64", 0.0
    StreamInfo = FakeInfo

    def __init__(self) -> None:
        self.infos: dict[str, FakeInfo] = {}
        self.pushed: dict[str, list[tuple[list[Any], float]]] = {}

    def StreamOutlet(self, info: FakeInfo) -> Any:
        self.infos[info.name] = info
        samples = self.pushed.setdefault(info.name, [])
        return SimpleNamespace(push_sample=lambda values, t_s: samples.append((values, t_s)))
