"""firmware/HARDWARE.md and its netlist: what is drawn, ordered and wired is what is simulated, flashed and computed."""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

FIRMWARE = Path(__file__).parents[2] / "firmware"
MODULES = ("netlist", "draw", "pins", "simulate", "make_hardware")
needs_ngspice = pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not installed (apt: ngspice)")


@pytest.fixture(scope="module")
def hardware() -> Iterator[SimpleNamespace]:
    sys.path.insert(0, str(FIRMWARE / "hardware"))
    try:
        yield SimpleNamespace(**{name: __import__(name) for name in MODULES})
    finally:
        sys.path.remove(str(FIRMWARE / "hardware"))
        for name in MODULES:
            del sys.modules[name]


def test_drawing_parts_pins_and_currents_are_those_of_netlist_sources_and_design(hardware: SimpleNamespace) -> None:
    stale = [path.name for path, made in hardware.make_hardware.made().items() if path.read_text("utf-8") != made]
    assert stale == [], "run `make -C firmware hardware`"


@pytest.mark.long
@needs_ngspice
def test_every_measure_of_the_benches_is_within_its_bounds(hardware: SimpleNamespace) -> None:
    measured = hardware.simulate.measured()
    assert hardware.simulate.beyond(measured) == []
    for name in measured:
        assert any(re.fullmatch(rf"{bound.name}(_[\d.]+n)?", name) for bound in hardware.simulate.BOUNDS), name


def test_every_part_says_what_to_order_and_every_net_is_met_twice(hardware: SimpleNamespace) -> None:
    for circuit in hardware.netlist.read():
        assert all(part.order for part in circuit.parts)
        ends = [net for part in circuit.parts for net in part.nets] + list(circuit.ports)
        assert [net for net in circuit.nets if ends.count(net) < 2] == []
        assert set(circuit.ports) <= set(circuit.nets)
