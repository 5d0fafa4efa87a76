"""Picture of a recording like the paper's figures 9 to 12: positions of the fingers, reference and motion of each mode,
target and amplitude of each finger; markers are vertical lines."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...errors import RecordingError
from ...files import plotting
from ...sim.picture import FINGER_COLOURS, LEAST_UM, MODE_COLOURS
from .references import in_force
from .tables import Column

Table = Mapping[str, Column]
MODE_NAMES = "XYZ"
MORE_MODES = ("tab:olive", "tab:cyan", "tab:pink")


def draw(
    tables: Mapping[str, Table], path: Path, *, title: str = "", start_s: float = 0.0, end_s: float | None = None
) -> None:
    """Write a picture of the part between two instants. Raises RecordingError if it holds nothing to draw."""
    if "passes" not in tables:
        raise RecordingError("The recording holds no passes: there is nothing to draw.")
    last_s = float(tables["passes"]["t_s"][-1])
    end_s = last_s if end_s is None else end_s
    if not (math.isfinite(start_s) and math.isfinite(end_s) and start_s < end_s and start_s < last_s):
        raise RecordingError(f"From {start_s:g} s to {end_s:.4g} s there is nothing: it ends at {last_s:.1f} s.")
    part = {name: _between(table, start_s, end_s) for name, table in tables.items()}
    figure, grid = plotting.subplots(9.0, 10.0, 4, sharex=True, height_ratios=(1, 1, 1.6, 1.6))
    axes = grid[:, 0]
    axes[0].set_title(plotting.plain(title), loc="left")
    _draw_positions(axes[0:2], part)
    _draw_modes(axes[2], part)
    _draw_fingers(axes[3], part)
    _draw_markers(axes, part)
    if not _coloured(part):
        for axis in (*axes[0:2], axes[3]):
            plotting.mark_empty(axis, "no finger touches")
    axes[3].set_xlim(start_s, end_s)
    axes[3].set_xlabel("time, s")
    plotting.save(figure, path)


def _between(table: Table, start_s: float, end_s: float) -> Table:
    part = (table["t_s"] >= start_s) & (table["t_s"] <= end_s)
    return {name: column[part] for name, column in table.items()}


def _draw_positions(axes: Any, tables: Mapping[str, Table]) -> None:
    """Samples as dots, at the instants they were taken; where each pass took the finger to be as a line."""
    begin_s = _begin_s(tables)
    for axis, name in zip(axes, ("x_mm", "y_mm"), strict=True):
        for colour, key in _coloured(tables):
            predicted = _of(tables.get("predictions"), "finger_id", key)
            if predicted:
                axis.plot(_seconds(predicted["t_plate_ns"], begin_s), predicted[name], color=colour, lw=0.9)
            seen = _of(tables.get("fingers"), "finger_id", int(key) if key.isdigit() else -1)
            if seen:
                axis.plot(_seconds(seen["t_sample_ns"], begin_s), seen[name], ".", color=colour, ms=2.5)
        axis.set_ylabel(f"{name[0]}, mm")
    axes[0].plot([], [], ".", color="grey", ms=4, label="samples")
    axes[0].plot([], [], color="grey", lw=0.9, label="predicted")
    _legend(axes[0])


def _draw_modes(axis: Any, tables: Mapping[str, Table]) -> None:
    """References dashed; what the plate did as a line: by its truth where the recording has it, else by the board."""
    begin_s = _begin_s(tables)
    did, name = (tables["truth_modes"], "plate") if "truth_modes" in tables else (tables.get("modes"), "measured")
    references = tables.get("references")
    modes = sorted({int(mode) for table in (did, references) if table for mode in table["mode"]})
    for mode in modes:
        colour = (*MODE_COLOURS, *MORE_MODES)[mode % (len(MODE_COLOURS) + len(MORE_MODES))]
        label = MODE_NAMES[mode] if mode < len(MODE_NAMES) else str(mode + 1)
        found = _of(did, "mode", mode)
        if found:
            axis.plot(found["t_s"], found[f"{name}_d_um"], color=colour, lw=1.1, label=f"$W_{{{label}d}}$ {name}")
        wanted = _of(references, "mode", mode)
        if wanted:
            t_ns, reference_um = in_force(wanted)
            axis.plot(_seconds(t_ns, begin_s), reference_um.real, "--", color="black", lw=0.7)
    axis.plot([], [], "--", color="black", lw=0.7, label="references")
    plotting.show_at_least(axis, -LEAST_UM, LEAST_UM)
    axis.set_ylabel("modal amplitude, µm")
    _legend(axis)


def _draw_fingers(axis: Any, tables: Mapping[str, Table]) -> None:
    """Targets dashed; the amplitude at each finger as a line: the truth, else what the solved modes give it."""
    for colour, key in _coloured(tables):
        table = _of(tables.get("targets"), "finger_id", key)
        if not table:
            continue
        axis.plot(table["t_s"], table["target_um"], "--", color=colour, lw=0.8)
        if "truth" not in tables:
            label = f"$|W|$, finger {plotting.plain(key)}: solved"
            axis.plot(table["t_s"], table["achieved_um"], color=colour, lw=1.0, label=label)
    truth = tables.get("truth")
    for finger in sorted(set(truth["path"].tolist())) if truth else []:
        felt = _of(truth, "path", finger)
        colour = FINGER_COLOURS[finger % len(FINGER_COLOURS)]
        amplitude_um = np.hypot(felt["plate_d_um"], felt["plate_q_um"])
        axis.plot(felt["t_s"], amplitude_um, color=colour, lw=1.0, label=f"$|W_{finger + 1}|$ of the plate")
    axis.plot([], [], "--", color="grey", lw=0.8, label="targets")
    plotting.show_at_least(axis, 0.0, LEAST_UM)
    axis.set_ylabel("vibration at the finger, µm")
    _legend(axis)


def _draw_markers(axes: Any, tables: Mapping[str, Table]) -> None:
    markers = tables.get("markers")
    if not markers:
        return
    for t_s, text in zip(markers["t_s"], markers["text"], strict=True):
        for axis in axes:
            axis.axvline(t_s, color="grey", lw=0.8, ls=":")
        label, place = plotting.plain(text[:24]), ("data", "axes fraction")
        axes[0].annotate(label, (t_s, 1.0), xycoords=place, rotation=45, fontsize="x-small", va="bottom")


def _coloured(tables: Mapping[str, Table]) -> list[tuple[str, str]]:
    """The fingers in the order in which they came, each with its colour."""
    keys: dict[str, None] = {}
    for name, column in (("fingers", "finger_id"), ("targets", "finger_id")):
        if name in tables:
            keys |= dict.fromkeys(map(str, tables[name][column].tolist()))
    return [(FINGER_COLOURS[index % len(FINGER_COLOURS)], key) for index, key in enumerate(keys)]


def _of(table: Table | None, column: str, value: object) -> Table:
    """The rows with this value; empty where there is no such table or no such row."""
    if table is None:
        return {}
    part = table[column] == value
    return {name: values[part] for name, values in table.items()} if part.any() else {}


def _begin_s(tables: Mapping[str, Table]) -> float:
    passes = tables["passes"]
    return float(passes["t_ns"][0]) * 1e-9 - float(passes["t_s"][0]) if len(passes["t_s"]) else 0.0


def _seconds(t_ns: Column, begin_s: float) -> npt.NDArray[np.float64]:
    return t_ns * 1e-9 - begin_s


def _legend(axis: Any) -> None:
    """Above the axes, on the right: nothing is hidden."""
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), fontsize="small", ncols=5, frameon=False, borderpad=0.1)
