"""Simulate the electronics, and make what follows from them: `make -C firmware hardware`.

The benches run in ngspice, are printed and held against their bounds. The drawing (schematic.svg) and the tables of
HARDWARE.md between their marks are made of the netlist, of the boards' sources and of `hapticd plate`'s own functions.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import draw
import netlist
import pins
import simulate

from hapticd.design.glued_plate import Patch
from hapticd.design.patch_reach import patch_load
from hapticd.sim.plate.glasses import GLASSES

TEXT, PICTURE = netlist.HERE.parent / "HARDWARE.md", netlist.HERE / "schematic.svg"
DRIVE_HZ = max(glass.drive_hz for glass in GLASSES.values())  # loads grow with it
PATCHES_MM = ((10, 10, 0.3), (10, 10, 0.5), (20, 10, 0.3), (20, 10, 0.5), (15, 15, 0.5), (12, 12, 1.0))


def loads() -> str:
    """Return the table of what patches ask of their amplifiers."""
    rows = [
        f"| patch, mm, at {DRIVE_HZ:.0f} Hz | nF free | nF glued | volts | mA peak | mA RMS | VA | W in it | V/us |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for width_mm, depth_mm, thickness_mm in PATCHES_MM:
        of = patch_load(Patch(0.0, 0.0, (width_mm, depth_mm), thickness_mm), DRIVE_HZ)
        rows.append(
            f"| {width_mm} x {depth_mm} x {thickness_mm:g} | {of.free_nf:.1f} | {of.glued_nf:.1f} | {of.volts_v:.0f} "
            f"| {of.peak_ma:.0f} | {of.rms_ma:.0f} | {of.apparent_va:.1f} | {of.loss_w:.2f} | {of.slew_v_us:.0f} |"
        )
    return "\n".join(rows)


def parts() -> str:
    """Return the table of the electronics' parts."""
    alike: dict[tuple[str, str, str], list[str]] = {}
    for circuit in netlist.read():
        for part in circuit.parts:
            alike.setdefault((circuit.name, part.value, part.order), []).append(part.name)
    rows = ["| part | value | order |", "|---|---|---|"]
    rows += [f"| {of} {', '.join(names)} | {value} | {order} |" for (of, value, order), names in alike.items()]
    return "\n".join(rows)


def measures(values: dict[str, float]) -> str:
    """Return the table of what the benches measured."""
    rows = ["| bench and measure | measured | has to be | |", "|---|---|---|---|"]
    for bound in simulate.BOUNDS:
        said = f"{simulate.said(bound, values)} {bound.unit}".strip()
        rows.append(f"| {bound.name} | {said} | {simulate.limits(bound)} | {bound.text} |")
    return "\n".join(rows)


def board_pins(board: str) -> str:
    """Return the table of a board's pins."""
    name, headers = pins.HEADERS.get(board, ("", {}))
    rows = [f"| pin | on the {name} | what |", "|---|---|---|"] if headers else ["| pin | what |", "|---|---|"]
    for pin in pins.pins(board):
        place = f" {headers[pin.name]} |" if headers else ""
        rows.append(f"| {pin.name} |{place} {pin.purpose} |")
    return "\n".join(rows)


def made() -> dict[Path, str]:
    """Return the files as they should be. Raises ValueError."""
    tables = {"loads": loads(), "parts": parts()} | {f"pins of {board}": board_pins(board) for board in pins.boards()}
    text = TEXT.read_text(encoding="utf-8")
    for mark, table in tables.items():
        passage = rf"(<!-- {mark}: [^\n]*-->\n).*?(?=<!-- end -->)"
        text, places = re.subn(passage, lambda at, new=table: f"{at[1]}{new}\n", text, flags=re.DOTALL)
        if places != 1:
            raise ValueError(f"HARDWARE.md has {places} places for the table {mark!r}.")
    return {TEXT: text, PICTURE: draw.picture(netlist.read())}


def main() -> int:
    try:
        values = simulate.measured()
    except simulate.SimulationFailure as error:
        print(error, file=sys.stderr)
        return 1
    for path, content in made().items():
        if not path.exists() or path.read_text(encoding="utf-8") != content:
            path.write_text(content, encoding="utf-8")
            print(path.relative_to(netlist.HERE.parents[1]))
    print(measures(values))
    wrong = simulate.beyond(values)
    print(*wrong, sep="\n", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
