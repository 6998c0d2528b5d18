"""Parts that all figures share: panels, files, cells with images, labels beside lines.

matplotlib is imported where something is drawn, and without pyplot: nothing is global.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from bench.tables.markdown import visible
from data_prep.files.atomic_write import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.text import Annotation

FIGURES = "figures"  # folder of a run
DPI = 110
# Figures fit a page: they are 800 px wide, sheets of images at most 1,600 px high.
WIDTH_IN, MOST_HIGH_IN = 800 / DPI, 1600 / DPI
TEXT = 8.0  # points, the smallest in a figure
# Text of an SVG stays text, its ids are the same every time, and a $ in a name is a $.
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "pc2pix-bench",
    "text.parse_math": False,
}
NAMES_APART = 0.055  # of the height of an axis: names closer than this would touch

Image = NDArray[np.uint8]


@contextmanager
def drawing() -> Iterator[None]:
    """Set the style of figures; names are drawn as they stand, whatever their characters are."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)
        yield


def panels(
    rows: int,
    columns: int,
    size_in: tuple[float, float],
    *,
    layout: str | None = "constrained",
    **shared: Any,
) -> tuple[Figure, NDArray[Any]]:
    """Return a figure of `size_in` inches (width, height) and its axes [rows, columns]."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size_in, layout=layout)  # type: ignore[arg-type]
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


def save(figure: Figure, path: Path, dpi: float = DPI) -> None:
    """Write a figure as the suffix says, PNG or SVG; the same figure gives the same bytes.

    Raises OSError.
    """
    kind = path.suffix.removeprefix(".")
    metadata = {"Date": None} if kind == "svg" else None
    with drawing(), atomic_write(path) as new:
        figure.savefig(new, format=kind, dpi=dpi, metadata=metadata)


def show(axis: Any, image: Image | None, interpolation: str | None = None) -> None:
    """Show an image without a frame; None as the word "failed"."""
    bare(axis)
    if image is None:
        axis.text(0.5, 0.5, "failed", ha="center", va="center", transform=axis.transAxes)
    else:
        axis.imshow(image, interpolation=interpolation)


def bare(axis: Any) -> None:
    """Take ticks and frame away."""
    axis.set_xticks([])
    axis.set_yticks([])
    axis.spines[:].set_visible(False)


@drawing()
def image_grid(
    titles: Sequence[str],
    rows: Sequence[tuple[str, Iterable[Image | None]]],
    size_in: tuple[float, float],
    interpolation: str | None = None,
) -> Figure:
    """Return a figure of images in rows, with labels at the left, under titles of columns.

    rows  (label, an image or None for each title)
    """
    figure, axes = panels(len(rows), len(titles), size_in, layout=None)
    for axis_row, (label, images) in zip(axes, rows, strict=True):
        for axis, image in zip(axis_row, images, strict=True):
            show(axis, image, interpolation)
        axis_row[0].set_ylabel("\n".join(map(visible, label.split("\n"))), fontsize=TEXT)
    for axis, title in zip(axes[0], titles, strict=True):
        axis.set_title(title, fontsize=TEXT)
    figure.tight_layout(pad=0.3)
    return figure


def name_lines(
    axis: Any,
    lines: Sequence[Any],
    at: float,
    *,
    apart: float = NAMES_APART,
    fontsize: float = 8,
    linewidth: float = 0.5,
) -> list[Annotation]:
    """Write the label of each line beside its last point, with a leader in its colour.

    The names stand at `at` of the width of the axis, moved apart where they would touch. The
    limits of the axis must be those that it keeps.
    """
    ends = [np.asarray(line.get_xydata())[-1] for line in lines]
    axis.autoscale_view()
    to_fraction = axis.transData - axis.transAxes
    heights = [float(to_fraction.transform(end)[1]) for end in ends]
    return [
        axis.annotate(
            line.get_label(),
            xy=end,
            xytext=(at, height),
            textcoords="axes fraction",
            fontsize=fontsize,
            va="center",
            arrowprops={"arrowstyle": "-", "color": line.get_color(), "lw": linewidth},
        )
        for line, end, height in zip(lines, ends, spread(heights, apart), strict=True)
    ]


def spread(places: Sequence[float], apart: float) -> list[float]:
    """Return places moved as little as a distance `apart` between neighbours in order allows.

    By least squares (isotonic regression): places that would touch stand evenly about their mean.
    """
    if not places:
        return []
    # Less its share of the distance, a place must not be lower than the one before.
    order, steps = np.argsort(places, kind="stable"), apart * np.arange(len(places))
    moved = np.empty(len(places))
    moved[order] = isotonic_regression(np.asarray(places)[order] - steps).x + steps
    return moved.tolist()
