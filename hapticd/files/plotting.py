"""Pictures: open a matplotlib figure without a window, save it, and explain in one sentence why that cannot be done."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Literal

from ..errors import HapticdError, missing_library, reason
from .outputs import PICTURE, check_suffix, opened

DPI = 110


def check(*paths: Path | None) -> None:
    """Raise UsageError for a suffix that is no picture's, HapticdError without matplotlib; None is not checked.

    Commands call it before they measure, so that no measurement is lost for want of its picture.
    """
    named = [path for path in paths if path is not None]
    for path in named:
        check_suffix(path, PICTURE)
    if named:
        _require_matplotlib()


def subplots(
    width_in: float,
    height_in: float,
    rows: int = 1,
    columns: int = 1,
    *,
    layout: Literal["constrained", "compressed"] = "constrained",
    **options: Any,
) -> tuple[Any, Any]:
    """Return a figure and its axes (rows, columns); `options` are those of `Figure.subplots`. Raises HapticdError."""
    _require_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout=layout, dpi=DPI)
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def save(figure: Any, path: Path, *, dpi: int = DPI, colours: int | None = None) -> None:
    """Write the figure in the format of the path's suffix. Raises UsageError, HapticdError.

    A PNG reduced to `colours` takes a third of the bytes.
    """
    check(path)
    form = path.suffix.lower()[1:] or "png"  # without a suffix: a device or a pipe
    try:
        with opened(path) as file:
            if colours is None or form != "png":
                figure.savefig(file, dpi=dpi, format=form)
                return
            from PIL import Image  # a dependency of matplotlib

            drawn = io.BytesIO()
            figure.savefig(drawn, dpi=dpi, format="png")
            Image.open(drawn).convert("RGB").quantize(colours).save(file, format="png", optimize=True)
    except ValueError as error:
        raise HapticdError(f"The picture cannot be written to {path} ({reason(error)}): choose another form.") from None


def _require_matplotlib() -> None:
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        raise missing_library("A picture needs matplotlib", "plot") from None
