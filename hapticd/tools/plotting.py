"""Pictures: open a matplotlib figure without a window, save it, and explain in one sentence why that cannot be done."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Literal

from .. import __version__
from ..errors import HapticdError, reason
from ..regular_file import opened
from .outputs import PICTURE, check_suffix, require_matplotlib

DPI = 110
SIGNATURE_PT = 7
SIGNED_BYTES = 512  # of a PNG, which has its title among the first


def subplots(
    width_in: float,
    height_in: float,
    rows: int = 1,
    columns: int = 1,
    *,
    source: str = "",
    layout: Literal["constrained", "compressed"] = "constrained",
    **options: Any,
) -> tuple[Any, Any]:
    """Return a figure and its axes (rows, columns); `options` are those of `Figure.subplots`. Raises HapticdError.

    The version, and the `source` of what is shown, such as scenario and seed, stand below the figure.
    """
    require_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout=layout, dpi=DPI)
    FigureCanvasAgg(figure)
    signature = ", ".join(filter(None, (f"hapticd {__version__}", source)))
    figure.supxlabel(plain(signature), x=0.995, ha="right", fontsize=SIGNATURE_PT, color="grey")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def stepped(name: str, levels: int) -> Any:
    """Return a colour map in so many steps: exact, and a third of the bytes, in a PNG of few colours."""
    from matplotlib import colormaps

    return colormaps[name].resampled(levels)


def show_at_least(axis: Any, low: float, high: float) -> None:
    """Have the vertical axis reach these values at least, so that noise does not fill it."""
    axis.update_datalim([(0.0, low), (0.0, high)], updatex=False)
    axis.autoscale_view(scalex=False)


def mark_empty(axis: Any, text: str) -> None:
    """Say in the middle of an axis why nothing is drawn there."""
    axis.text(0.5, 0.5, text, transform=axis.transAxes, ha="center", va="center", color="grey")
    axis.set_yticks([])


def save(figure: Any, path: Path, *, dpi: int = DPI, colours: int | None = None) -> None:
    """Write the figure in the format of the path's suffix. Raises UsageError, HapticdError.

    A PNG reduced to `colours` takes a third of the bytes. The metadata have the signature as title.
    """
    check_suffix(path, PICTURE)
    form = path.suffix.lower()[1:] or "png"  # without a suffix: a device or a pipe
    try:
        with opened(path) as file:
            if colours is None or form != "png":
                figure.savefig(file, dpi=dpi, format=form, metadata={"Title": figure.get_supxlabel()})
                return
            from PIL import Image  # a dependency of matplotlib
            from PIL.PngImagePlugin import PngInfo

            drawn = io.BytesIO()
            figure.savefig(drawn, dpi=dpi, format="png")
            few = Image.open(drawn).convert("RGB").quantize(colours, method=Image.Quantize.MAXCOVERAGE)
            signed = PngInfo()
            signed.add_text("Title", figure.get_supxlabel())
            few.save(file, format="png", optimize=True, pnginfo=signed)
    except ValueError as error:
        raise HapticdError(f"The picture cannot be written to {path} ({reason(error)}): choose another form.") from None


def plain(text: str) -> str:
    """A text of somebody else's, not to be set as a formula."""
    return text.replace("$", r"\$")
