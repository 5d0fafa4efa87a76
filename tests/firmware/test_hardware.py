"""firmware/HARDWARE.md and its netlist: what is drawn, ordered and wired is what is simulated, flashed and computed."""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace

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


@pytest.fixture(scope="module")
def measured(hardware: SimpleNamespace) -> dict[str, float]:
    found: dict[str, float] = hardware.simulate.measured()
    return found


@pytest.mark.long
@needs_ngspice
def test_every_measure_of_the_benches_is_within_its_bounds(
    hardware: SimpleNamespace, measured: dict[str, float]
) -> None:
    assert hardware.simulate.beyond(measured) == []
    for name in measured:
        assert any(re.fullmatch(rf"{bound.name}(_[\d.]+n)?", name) for bound in hardware.simulate.BOUNDS), name


@pytest.mark.parametrize(
    ("bench", "old", "new", "broken"),
    [
        ("spark", "D1 in vdda bat54", "D1 in nowhere bat54", "spark.input_top_v"),
        ("spark", "R2 a b 4.99k", "R2 a b 1", "spark.clamp_ma"),
        ("sensor", "C1 lead 0 47n", "C1 lead 0 1p", "sensor.open_drive_v"),
        ("sensor", "R1 lead 0 10k", "R1 lead 0 10g", "sensor.open_mains_v"),
        ("sensor", "C5 adc 0 3.3n", "C5 adc 0 1p", "sensor.image_db"),
        ("amplifier", "R6 out p 3.3", "R6 out p 0.01", "amplifier.peaking"),
        ("amplifier", "R4 fb g 1.5k", "R4 fb g 15k", "amplifier.margin_deg"),
        ("enable", "C1 rc 0 100n", "C1 rc 0 10n", "enable.least_q_v"),
        ("enable", "XU1 pulses rc q v33 0 ahc123", "R9 pulses q 1", "enable.high_end_v"),
        ("enable", "S1 v5 led stop 0 contact", "S1 v5 led v5 0 contact", "enable.stop_end_v"),
    ],
)
@pytest.mark.long
@needs_ngspice
def test_a_wrong_part_breaks_a_bound(
    hardware: SimpleNamespace,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    bench: str,
    old: str,
    new: str,
    broken: str,
) -> None:
    for path in (FIRMWARE / "hardware").iterdir():
        if path.suffix in (".cir", ".lib"):
            content = path.read_text(encoding="utf-8")
            is_schematic = path.name == "schematic.cir"
            assert not is_schematic or old in content
            (tmp_path / path.name).write_text(content.replace(old, new) if is_schematic else content, encoding="utf-8")
    monkeypatch.setattr(hardware.simulate, "HERE", tmp_path)
    values = hardware.simulate.run(bench)
    bounds = {bound.name: bound for bound in hardware.simulate.BOUNDS}
    assert not bounds[broken].holds(values), bounds[broken].values(values)


def test_a_bench_that_does_not_run_is_one_sentence(
    hardware: SimpleNamespace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate: ModuleType = hardware.simulate
    monkeypatch.setattr(simulate.shutil, "which", lambda _: None)
    with pytest.raises(simulate.SimulationFailure, match=r"^ngspice is not installed \(apt: ngspice\)\.$"):
        simulate.run("sensor")
    monkeypatch.undo()
    if shutil.which("ngspice") is not None:
        monkeypatch.setattr(simulate, "HERE", tmp_path)
        with pytest.raises(simulate.SimulationFailure, match=r"^bench_sensor\.cir: "):
            simulate.run("sensor")


def test_every_part_says_what_to_order_and_every_net_is_met_twice(hardware: SimpleNamespace) -> None:
    for circuit in hardware.netlist.read():
        assert all(part.order for part in circuit.parts)
        ends = [net for part in circuit.parts for net in part.nets] + list(circuit.ports)
        assert [net for net in circuit.nets if ends.count(net) < 2] == []
        assert set(circuit.ports) <= set(circuit.nets)


def test_a_line_without_an_order_and_a_box_with_a_missing_pin_are_refused(hardware: SimpleNamespace) -> None:
    with pytest.raises(ValueError, match="does not end with what to order"):
        hardware.netlist.circuits(".subckt one a\nR1 a 0 1k\n.ends\n", "")
    with pytest.raises(ValueError, match="U1: amp has 3 pins, not 2"):
        hardware.netlist.circuits(".subckt one a\nXU1 a 0 amp ; any\n.ends\n", ".subckt amp a b c\n.ends\n")


def test_each_mode_of_an_image_has_a_drive_and_a_sensor(hardware: SimpleNamespace) -> None:
    makefile = (FIRMWARE / "Makefile").read_text(encoding="utf-8")
    modes = {board: int(n) for board, n in re.findall(r"^modes_of_(\w+) := (\d)$", makefile, re.MULTILINE)}
    assert set(modes) == set(hardware.pins.boards())
    for board, n in modes.items():
        purposes = [pin.purpose for pin in hardware.pins.pins(board)]
        assert sum("sensor of mode" in purpose for purpose in purposes) >= n, board
        drives = sum("drive of mode" in purpose for purpose in purposes)
        chips = sum(re.match("DIN of the DACs of modes . to", purpose) is not None for purpose in purposes)
        assert drives + 4 * chips >= n, board
