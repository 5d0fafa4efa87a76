"""Picture of a recording like the paper's figures 9 to 12: positions of the fingers, reference and motion of each mode,
target and amplitude of each finger, and what other devices measured; markers are vertical lines with their texts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ...errors import RecordingError
from .. import plotting
from .tables import Column

_Table = Mapping[str, Column]
# As in the paper: blue is mode X, green mode Y.
MODE_COLOURS = ("tab:blue", "tab:green", "tab:cyan", "tab:olive", "tab:pink", "tab:gray", "tab:brown", "tab:red")
FINGER_COLOURS = ("tab:orange", "tab:purple", "tab:red", "tab:brown")
REFERENCE = {"lw": 4.0, "alpha": 0.3, "solid_capstyle": "butt"}  # behind the amplitude that follows it
LEAST_UM = 0.1  # that the axes show: a still plate's noise is 0.002 um
MODE_NAMES = "XYZ"
MOST_LABELS = 9  # two rows, with the line style
MOST_CHARS = 24  # of a marker's text
STREAM_IN = 1.9
MOST_STREAMS, MOST_CHANNELS = 6, 8  # that are drawn
LIFTED_S = 0.1  # without ground truth of a finger; it comes every 10 ms at least


def draw(
    tables: Mapping[str, _Table], path: Path, *, title: str = "", start_s: float = 0.0, end_s: float | None = None
) -> None:
    """Write a picture of the part between two instants. Raises RecordingError if it holds nothing to draw."""
    if "passes" not in tables:
        raise RecordingError("The recording holds no passes: there is nothing to draw.")
    last_s = float(tables["passes"]["t_s"][-1])
    end_s = last_s if end_s is None else end_s
    if not (math.isfinite(start_s) and math.isfinite(end_s) and start_s < end_s and start_s < last_s):
        raise RecordingError(f"From {start_s:g} s to {end_s:.4g} s there is nothing: it ends at {last_s:.1f} s.")
    part = _Part(start_s, end_s)
    streams = _streams(tables)
    heights_in = [1.9, 1.9, 3.1, 3.1, *[STREAM_IN] * len(streams)]
    figure, grid = plotting.subplots(9.0, sum(heights_in), len(heights_in), sharex=True, height_ratios=heights_in)
    figure.suptitle(plotting.plain(title), x=0.01, ha="left", fontsize="large")
    axes = grid[:, 0]
    for axis, name in zip(axes[4:], streams, strict=True):
        _draw_stream(axis, tables, name, part)
    _draw_positions(axes[0:2], tables, part)
    _draw_modes(axes[2], tables, part)
    _draw_fingers(axes[3], tables, part)
    _draw_markers(axes, tables, part)
    if not any(len(line.get_xdata()) for line in axes[0].lines):
        for axis in (*axes[0:2], axes[3]):
            plotting.mark_empty(axis, "no finger touches")
    axes[0].plot([], [], ".", color="grey", ms=4, label="samples")
    axes[0].plot([], [], color="grey", lw=0.9, label="predicted")
    for axis in (axes[0], *axes[2:]):
        _legend(axis)
    axes[3].set_xlim(start_s, end_s)
    axes[-1].set_xlabel("time, s")
    plotting.save(figure, path)


class _Part(NamedTuple):
    """The instants that are drawn."""

    start_s: float
    end_s: float

    def contains(self, t_s: Column) -> npt.NDArray[np.bool_]:
        """Return which instants are drawn."""
        return np.asarray((t_s >= self.start_s) & (t_s <= self.end_s))

    def draw(self, axis: Any, t_s: Column, values: Column, **options: Any) -> None:
        """Draw a line through points before and behind the edges too; one that does not reach into the part has no
        label."""
        order = np.argsort(t_s, kind="stable")
        t_s, values = t_s[order], values[order]
        edges_s = np.array([edge_s for edge_s in self if t_s[0] < edge_s < t_s[-1]])
        inside = self.contains(t_s)
        at_s = np.concatenate([edges_s, t_s[inside]])
        if len(at_s):
            drawn = np.concatenate([np.interp(edges_s, t_s, values), values[inside]])
            order = np.argsort(at_s, kind="stable")
            axis.plot(at_s[order], drawn[order], **options)


def _draw_positions(axes: Any, tables: Mapping[str, _Table], part: _Part) -> None:
    """Samples as dots, at the instants they were taken; where each pass took the finger to be as a line."""
    begin_s = _begin_s(tables)
    for axis, name in zip(axes, ("x_mm", "y_mm"), strict=True):
        for colour, key in _coloured(tables):
            predicted = _of(tables.get("predictions"), "finger_id", key)
            if predicted:
                part.draw(axis, _seconds(predicted["t_plate_ns"], begin_s), predicted[name], color=colour, lw=0.9)
            seen = _of(tables.get("fingers"), "finger_id", int(key) if key.isdigit() else -1)
            if seen:
                t_s = _seconds(seen["t_sample_ns"], begin_s)
                inside = part.contains(t_s)
                if inside.any():
                    axis.plot(t_s[inside], seen[name][inside], ".", color=colour, ms=2.5)
        axis.set_ylabel(f"{name[0]}, mm")


def _streams(tables: Mapping[str, _Table]) -> list[str]:
    """Return the streams of other devices that are drawn."""
    return list(dict.fromkeys(tables["measured"]["stream"].tolist()))[:MOST_STREAMS] if "measured" in tables else []


def _draw_stream(axis: Any, tables: Mapping[str, _Table], name: str, part: _Part) -> None:
    """One line for each channel of a stream."""
    described = _of(tables.get("streams"), "stream", name)
    measured = _of(tables["measured"], "stream", name)
    channels = sorted(set(measured["channel"].tolist()))
    units: list[str] = []
    for channel in channels[:MOST_CHANNELS]:
        found, about = _of(measured, "channel", channel), _of(described, "channel", channel)
        label = about["name"][0] if about else ""
        units += [about["unit"][0]] if about else []
        part.draw(axis, found["t_s"], found["value"], label=plotting.plain(label or f"{name} {channel}"), lw=0.9)
    unit = units[0] if len(set(units)) == 1 else ""
    axis.set_ylabel(plotting.plain(", ".join(filter(None, (name, unit)))))


def _draw_modes(axis: Any, tables: Mapping[str, _Table], part: _Part) -> None:
    """References as broad bands; what the plate did as lines: by its truth where there is one, else by the board."""
    begin_s = _begin_s(tables)
    did, name = (tables["truth_modes"], "plate") if "truth_modes" in tables else (tables.get("modes"), "measured")
    references = tables.get("references")
    modes = sorted({int(mode) for table in (did, references) if table for mode in table["mode"]})
    for mode in modes:
        colour = MODE_COLOURS[mode % len(MODE_COLOURS)]
        mark = MODE_NAMES[mode] if mode < len(MODE_NAMES) else str(mode)
        asked = _of(references, "mode", mode)
        if asked:
            t_ns, reference_um = in_force(asked)
            part.draw(axis, _seconds(t_ns, begin_s), reference_um.real, color=colour, **REFERENCE)
        found = _of(did, "mode", mode)
        if found:
            label = f"$W_{{{mark}d}}$ {name}"
            part.draw(axis, found["t_s"], found[f"{name}_d_um"], label=label, color=colour, lw=1.0)
    axis.plot([], [], color="grey", label="references", **REFERENCE)
    plotting.show_at_least(axis, -LEAST_UM, LEAST_UM)
    axis.set_ylabel("modal amplitude, µm")


def _draw_fingers(axis: Any, tables: Mapping[str, _Table], part: _Part) -> None:
    """Targets dashed; the amplitude at each finger as a line: the truth, else what the solved modes give it."""
    for colour, key in _coloured(tables):
        table = _of(tables.get("targets"), "finger_id", key)
        if table:
            part.draw(axis, table["t_s"], table["target_um"], ls="--", color=colour, lw=0.8)
        if table and "truth" not in tables:
            label = f"$|W|$, finger {plotting.plain(key)}: solved"
            part.draw(axis, table["t_s"], table["achieved_um"], label=label, color=colour, lw=1.0)
    colours = {key: colour for colour, key in _coloured(tables)}
    for touch in _touches(tables.get("truth")):
        key = next(filter(None, touch["finger_id"].tolist()), "")
        amplitude_um = np.hypot(touch["plate_d_um"], touch["plate_q_um"])
        label = f"$|W|$, finger {plotting.plain(key)}: plate" if key else ""
        part.draw(axis, touch["t_s"], amplitude_um, label=label, color=colours.get(key, "grey"), lw=1.0)
    axis.plot([], [], "--", color="grey", lw=0.8, label="targets")
    plotting.show_at_least(axis, 0.0, LEAST_UM)
    axis.set_ylabel("vibration at the finger, µm")


def in_force(references: Mapping[str, Column]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.complex128]]:
    """Return the corners of the line that the board followed, `t_ns` (K,) and `modal_um` (K,), from one mode's
    rows in the table's order.

    A frame ends where the next one begins: between two of its knots, or held beyond the last.
    """
    modal_um = references["reference_d_um"] + 1j * references["reference_q_um"]
    bounds = [*np.flatnonzero(references["knot"] == 0).tolist(), len(modal_um)]
    rows = [slice(begin, end) for begin, end in pairwise(bounds)]
    frames = [(references["t_knot_ns"][part], modal_um[part]) for part in rows]
    frames.sort(key=lambda frame: int(frame[0][0]))
    t_ns, line_um = [], []
    for place, (at_ns, at_um) in enumerate(frames):
        end_ns = frames[place + 1][0][0] if place + 1 < len(frames) else at_ns[-1]
        kept = at_ns < end_ns
        t_ns.append(np.append(at_ns[kept], end_ns))
        line_um.append(np.append(at_um[kept], np.interp(end_ns, at_ns, at_um)))
    return np.concatenate(t_ns), np.concatenate(line_um)


def _legend(axis: Any) -> None:
    """Above the axes, on the right, where nothing is hidden: of many touches the first ones, and the line style."""
    handles = {label: handle for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    labels = [*list(handles)[:-1][:MOST_LABELS], *list(handles)[-1:]]
    place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0)}
    axis.legend(
        [handles[label] for label in labels], labels, **place, fontsize="small", ncols=5, frameon=False, borderpad=0.1
    )


def _touches(truth: _Table | None) -> Iterator[_Table]:
    """The ground truth of each finger, apart where it was lifted."""
    for path in sorted(set(truth["path"].tolist())) if truth else []:
        felt = _of(truth, "path", path)
        cuts = np.flatnonzero(np.diff(felt["t_s"]) > LIFTED_S) + 1
        for rows in np.split(np.arange(len(felt["t_s"])), cuts):
            yield {name: column[rows] for name, column in felt.items()}


def _draw_markers(axes: Any, tables: Mapping[str, _Table], part: _Part) -> None:
    """Draw a line through all pictures for each marker, with its text at the top."""
    table = tables.get("markers")
    for t_s, text in zip(table["t_s"], table["text"], strict=True) if table else ():
        if not part.contains(t_s):
            continue
        for axis in axes:
            axis.axvline(t_s, color="grey", lw=0.8, ls=":")
        label = plotting.plain(text if len(text) <= MOST_CHARS else text[: MOST_CHARS - 1] + "…")
        place = {"xycoords": ("data", "axes fraction"), "rotation": 90, "ha": "right", "va": "top"}
        axes[0].annotate(label, (t_s, 0.98), **place, fontsize="x-small", annotation_clip=True)


def _coloured(tables: Mapping[str, _Table]) -> list[tuple[str, str]]:
    """The fingers in the order in which they came, each with its colour."""
    keys: dict[str, None] = {}
    for name, column in (("fingers", "finger_id"), ("targets", "finger_id")):
        if name in tables:
            keys |= dict.fromkeys(map(str, tables[name][column].tolist()))
    return [(FINGER_COLOURS[index % len(FINGER_COLOURS)], key) for index, key in enumerate(keys)]


def _of(table: _Table | None, column: str, value: object) -> _Table:
    """The rows with this value; empty where there is no such table or no such row."""
    if table is None:
        return {}
    part = table[column] == value
    return {name: values[part] for name, values in table.items()} if part.any() else {}


def _begin_s(tables: Mapping[str, _Table]) -> float:
    passes = tables["passes"]
    return float(passes["t_ns"][0]) * 1e-9 - float(passes["t_s"][0])


def _seconds(t_ns: Column, begin_s: float) -> npt.NDArray[np.float64]:
    return t_ns * 1e-9 - begin_s
