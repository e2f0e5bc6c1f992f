"""One style for all plots: legible on light and on dark pages, small, with units."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from PIL import Image

mpl.use("Agg")
import matplotlib.pyplot as plt

# Of medium lightness, with a contrast of at least 3 to white and to GitHub's dark background.
COLORS = ("#2f81f7", "#d4720b", "#2c974b", "#a475f9", "#e5484d", "#0d9aa8")
TEXT = "#7d8590"
STYLE = {
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "text.color": TEXT,
    "axes.labelcolor": TEXT,
    "axes.edgecolor": TEXT,
    "axes.titlecolor": TEXT,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": TEXT,
    "grid.alpha": 0.25,
    "xtick.color": TEXT,
    "ytick.color": TEXT,
    "font.size": 10,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.linewidth": 1.8,
    "lines.markersize": 4.5,
}
SIZE = (4.6, 3.1)  # inches of one panel
DPI = 110
PALETTE = 160  # colours with their transparency


@contextmanager
def figure(path: Path, rows: int = 1, columns: int = 1, width: float = 1.0) -> Iterator[Any]:
    """Yield the axes of a figure (an array, where there are several), and save it at the end.

    ``width`` is that of a panel, as a multiple of the usual one.
    """
    with mpl.rc_context(STYLE):
        drawn, axes = plt.subplots(
            rows, columns, figsize=(SIZE[0] * columns * width, SIZE[1] * rows), layout="constrained"
        )
        yield axes
        image = BytesIO()
        drawn.savefig(image, dpi=DPI, format="png")
        plt.close(drawn)
    # A palette: a third of the size.
    few = Image.open(image).quantize(PALETTE, method=Image.Quantize.FASTOCTREE)
    few.save(path, optimize=True)


def line(
    axes: Any,
    x: Sequence[float],
    y: Sequence[float],
    label: str,
    color: str,
    *,
    spread: tuple[Sequence[float], Sequence[float]] | None = None,
    style: str = "-",
) -> None:
    """Draw a line with its points; ``spread`` is the lowest and highest of each point."""
    axes.plot(x, y, style, marker="o", color=color, label=label)
    if spread is not None:
        axes.fill_between(x, *spread, color=color, alpha=0.2, linewidth=0)


def label(axes: Any, x: str, y: str, *, log: bool = False, logx: bool = False) -> None:
    """Name the axes, with units; add the legend; ``log``: both are logarithmic."""
    if log or logx:
        axes.set_xscale("log")
    if log:
        axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis) if log else (axes.xaxis,) if logx else ():
        axis.set_major_formatter(mpl.ticker.FuncFormatter(lambda value, _: f"{value:,g}"))
        axis.set_minor_formatter(mpl.ticker.NullFormatter())
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.legend()
