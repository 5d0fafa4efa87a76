"""What a person would see in a drawn figure: texts that cover each other, or that are cut off."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

SLACK_PX = 1.0


def faults(figure: Any) -> list[str]:
    """Lay the figure out; return each text that reaches out of it, and each pair of texts that overlap."""
    figure.canvas.draw()
    shown = [text for text in _texts(figure) if text.get_visible() and text.get_text().strip()]
    boxes = [(text.get_text(), text.get_window_extent().padded(-SLACK_PX)) for text in shown]
    width, height = figure.canvas.get_width_height()
    cut = [text for text, box in boxes if box.x0 < 0 or box.y0 < 0 or box.x1 > width or box.y1 > height]
    covered = [f"{one} / {other}" for (one, a), (other, b) in combinations(boxes, 2) if a.overlaps(b)]
    return cut + covered


def _texts(figure: Any) -> Iterator[Any]:
    yield from figure.texts
    for legend in (*figure.legends, *(axes.get_legend() for axes in figure.axes)):
        yield from legend.get_texts() if legend is not None else ()
    for axes in figure.axes:
        yield from axes.texts
        if not axes.axison:
            continue
        yield from (axes.title, axes._left_title, axes._right_title)
        for axis, limits in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
            yield axis.label
            yield from (tick.label1 for tick in axis.get_major_ticks() if min(limits) <= tick.get_loc() <= max(limits))
            yield from (tick.label2 for tick in axis.get_major_ticks() if min(limits) <= tick.get_loc() <= max(limits))
