"""The paper's figure 12: what each participant recognised, light, and the average with its standard deviation, dark."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from ...errors import HapticdError
from .analysis import GUESSING_FRAC, Group, Result
from .protocol import StudyError

LIGHT, DARK = "#9ecae1", "#08519c"
BAR_IN = 0.55  # a participant's share of the figure's width
MAX_WIDTH_IN = 16.0


def draw(results: Sequence[Result], group: Group, path: Path) -> None:
    """Write it as PNG. Raises HapticdError where matplotlib is missing, StudyError where the file cannot be written."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise HapticdError('A picture needs matplotlib: install it with `pip install "hapticd[study]"`.') from None
    width_in = min(2.4 + BAR_IN * len(results), MAX_WIDTH_IN)
    figure = Figure(figsize=(max(width_in, 4.0), 3.2), layout="constrained")
    top = max(105.0, 5.0 + 100 * (group.mean_frac + (0.0 if math.isnan(group.sd_frac) else group.sd_frac)))
    axes = figure.add_subplot(ylabel="stimuli recognised, %", ylim=(0, top))
    places = range(1, len(results) + 1)
    axes.bar(places, [100 * one.rate_frac for one in results], width=0.7, color=LIGHT)
    spread = None if math.isnan(group.sd_frac) else 100 * group.sd_frac
    axes.bar(len(results) + 1.5, 100 * group.mean_frac, yerr=spread, width=0.7, color=DARK, capsize=4)
    axes.axhline(100 * GUESSING_FRAC, color="grey", lw=0.8, ls="--")
    axes.annotate(
        "guessing",
        (1.0, 100 * GUESSING_FRAC),
        (4, 0),
        ("axes fraction", "data"),
        "offset points",
        va="center",
        fontsize="small",
        color="grey",
    )
    names = [one.participant for one in results]
    is_crowded = sum(map(len, names)) > 8 * width_in
    axes.set_xticks([*places, len(results) + 1.5], [*names, "average"], rotation=45 if is_crowded else 0)
    axes.spines[["top", "right"]].set_visible(False)
    try:
        figure.savefig(path, dpi=110, format="png")
    except OSError as error:
        raise StudyError(f"{path}: cannot be written ({error.strerror or error}).") from None
