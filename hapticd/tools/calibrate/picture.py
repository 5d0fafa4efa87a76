"""Pictures of the steps: one look for all of them, small enough to be sent around."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from ...errors import CalibrationError, reason

DPI = 80
COLOURS = 64  # of a picture: a third of the bytes


def require() -> None:
    """Raises CalibrationError without matplotlib: before a measurement, not after it."""
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise CalibrationError("Pictures need matplotlib: pip install 'hapticd[plot]'.") from None


def canvas(columns: int, rows: int = 1, *, width_in: float = 9.0, height_in: float = 4.0) -> tuple[Any, Any]:
    """A figure without a window, and its axes (rows, columns)."""
    require()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def save(figure: Any, path: Path) -> None:
    """Write the picture; raises CalibrationError for a place that cannot be written."""
    from PIL import Image  # which matplotlib brings

    drawn = io.BytesIO()
    try:
        figure.savefig(drawn, dpi=DPI, format="png")
        Image.open(drawn).convert("RGB").quantize(COLOURS).save(path, optimize=True)
    except (OSError, ValueError) as error:
        raise CalibrationError(
            f"{path}: cannot be drawn ({reason(error)}): name a .png in a folder of yours."
        ) from None
