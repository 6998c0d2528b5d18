"""Parts that all figures share: their style, panels and files.

matplotlib is imported where something is drawn, and without pyplot: nothing is global.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data_prep.files.atomic_write import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = "figures"  # folder of figures in that of a run
DPI = 110  # pixels per inch of a PNG
# Figures fit a page: they are 800 px wide, sheets of images at most 1,600 px high.
WIDTH_IN, MOST_HIGH_IN = 800 / DPI, 1600 / DPI
TEXT = 8.0  # points, the smallest in a figure
# Text of an SVG stays text, its ids are the same every time, and a $ in a name is a $.
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "pc2pix-bench",
    "text.parse_math": False,
}

Image = NDArray[np.uint8]


@contextmanager
def drawing() -> Iterator[None]:
    """Set the style of figures; names are drawn as they stand, whatever their characters are."""
    import matplotlib as mpl

    with mpl.rc_context(_STYLE), warnings.catch_warnings():
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
