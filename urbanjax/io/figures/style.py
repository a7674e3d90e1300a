"""Figures in one style, drawn without a display and without global state."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from urbanjax.types import FileError

STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555555",
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.6,
    "figure.facecolor": "white",
    "savefig.dpi": 150,
    "figure.constrained_layout.use": True,
}
ROAD = "#f2f2f2"  # fill of a road seen from above
LINE = "#9a9a9a"  # its markings
OTHER = "#7f7f7f"  # other vehicles
GOOD, BAD = "#2a7f62", "#c0392b"


@contextlib.contextmanager
def figure(path: Path, width: float, *, height: float) -> Iterator[Any]:
    """A matplotlib figure of width x height inches in the house style, saved to `path` on leaving.

    Args: path of the picture; width, height [inch]. Raises FileError where it cannot be written.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        canvas = Figure(figsize=(width, height))
        FigureCanvasAgg(canvas)
        yield canvas
        try:
            canvas.savefig(path)
        except OSError as error:
            raise FileError(f"{path}: cannot be written ({error.strerror or error})") from error


def shades(count: int) -> list[tuple[float, float, float, float]]:
    """`count` colours from calm to alarming, for a parameter that rises.

    Args: count of colours.
    """
    import matplotlib

    scale = matplotlib.colormaps["plasma"]
    # The ends of the scale are too dark and too bright on white.
    return [scale(0.05 + 0.75 * i / max(count - 1, 1)) for i in range(count)]
