"""The figures of the suite `stability`: the matrix of verdicts, and an image of each case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.report.plots import drawing, panels
from bench.suites.stability.expectations import KINDS
from bench.tables.grid import ordered
from data_prep.scene import IMAGE_SIZE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The colour and the letter of each kind of outcome. Kinds differ in lightness and letter, too, as
# not everybody sees colours.
COLOURS = {
    "holds": ("#cfe8cf", ""),
    "refused": ("#f5e6a3", "r"),
    "differs": ("#f0b77c", "d"),
    "contained": ("#9db7de", "c"),
    "unexpected": ("#8f1d2c", "!"),
}
_ROW_IN, _COLUMN_IN = 0.17, 0.55  # height and width of a rectangle of the matrix, in inches
ACROSS = 12  # images side by side in the figure of extremes; further cases stand below
MISSING = 225  # grey level, 0..255, of the square that stands for a missing image


@drawing()
def matrix_figure(outcomes: pd.DataFrame, title: str) -> Figure:
    """Return a matrix with a row for each case and a column for each method, coloured by outcome.

    A rectangle stays white where the method was not tried on the case.
    """
    from matplotlib import patches

    methods = ordered(outcomes["subject"])
    rows = ordered(zip(outcomes["group"], outcomes["case"], strict=True))
    size_in = (3.2 + _COLUMN_IN * len(methods), 1.8 + _ROW_IN * len(rows))
    figure, ((axis,),) = panels(1, 1, size_in)
    for cell in outcomes.itertuples():
        x, y = methods.index(cell.subject), rows.index((cell.group, cell.case))
        colour, letter = COLOURS[str(cell.kind)]
        axis.add_patch(patches.Rectangle((x, y), 1, 1, facecolor=colour, edgecolor="white"))
        dark = "white" if letter == "!" else "black"
        axis.text(x + 0.5, y + 0.52, letter, ha="center", va="center", fontsize=7, color=dark)
    for y, ((group, _), (before, _)) in enumerate(zip(rows[1:], rows, strict=False), 1):
        if group != before:
            axis.axhline(y, color="black", linewidth=0.6)
    axis.set(xlim=(0, len(methods)), ylim=(len(rows), 0))
    axis.set_xticks(np.arange(len(methods)) + 0.5, methods, rotation=45, ha="left", fontsize=8)
    axis.set_yticks(np.arange(len(rows)) + 0.5, [case for _, case in rows], fontsize=7)
    axis.xaxis.tick_top()
    axis.tick_params(length=0)
    axis.spines[:].set_visible(False)
    axis.set_title(title, fontsize=10)
    handles = [
        patches.Patch(facecolor=COLOURS[kind][0], label=f"{COLOURS[kind][1]} {kind}".strip())
        for kind in KINDS
    ]
    place = {"loc": "outside lower center", "ncols": 3}
    figure.legend(handles=handles, fontsize=7, frameon=False, **place)
    return figure


@drawing()
def extremes_figure(
    cases: Sequence[str],
    methods: Sequence[str],
    images: Mapping[tuple[str, str], NDArray[np.uint8]],
) -> Figure:
    """Return images from the first view, with a column for each case and a row for each method.

    A grey square stands for a missing image.

    images  uint8 [IMAGE_SIZE, IMAGE_SIZE, 3] by case and method
    """
    blocks = [cases[i : i + ACROSS] for i in range(0, len(cases), ACROSS)]
    size_in = (0.95 * ACROSS + 0.6, (0.95 * len(methods) + 0.25) * len(blocks))
    figure, axes = panels(len(blocks), 1, size_in)
    centres = IMAGE_SIZE * (np.arange(max(ACROSS, len(methods))) + 0.5)
    for axis, block in zip(axes[:, 0], blocks, strict=True):
        axis.imshow(sheet([[images.get((case, m)) for case in block] for m in methods]))
        axis.set_xticks(centres[: len(block)], block, fontsize=6)
        axis.set_yticks(centres[: len(methods)], methods, fontsize=6, rotation=90, va="center")
        axis.xaxis.tick_top()
        axis.tick_params(length=0, pad=1)
        axis.spines[:].set_visible(False)
    return figure


def sheet(rows: Sequence[Sequence[NDArray[np.uint8] | None]]) -> NDArray[np.uint8]:
    """Return images side by side, uint8 [rows * IMAGE_SIZE, ACROSS * IMAGE_SIZE, 3].

    None becomes a grey square, and the rest of a row is white.
    """
    pixels = np.full((len(rows), IMAGE_SIZE, ACROSS, IMAGE_SIZE, 3), 255, np.uint8)
    for y, row in enumerate(rows):
        for x, image in enumerate(row):
            pixels[y, :, x] = MISSING if image is None else image
    return pixels.reshape(len(rows) * IMAGE_SIZE, ACROSS * IMAGE_SIZE, 3)
