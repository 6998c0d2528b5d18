"""The paper's Figures 5 and 6: clouds above the images that are drawn of the same codes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from baselines.splat import Splat
from bench.report.figure import TEXT, WIDTH_IN, bare, drawing, panels, show
from data_prep.rendering.images import to_uint8
from data_prep.scene import PointCloud, Points, View

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CLOUD, IMAGE, TRUTH = "decoded", "drawn", "true"


@dataclass(frozen=True, eq=False)
class StripTile:
    """A cloud [N, 3] above an image uint8 [128, 128, 3] and perhaps the true one, with a title."""

    title: str
    cloud: Points
    image: NDArray[np.uint8]
    truth: NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class Strip:
    """The tiles of one path or sum from left to right, with its description."""

    label: str
    tiles: tuple[StripTile, ...]


@drawing()
def strips_figure(strips: Sequence[Strip], view: View) -> Figure:
    """Return rows of clouds, images, and true images if any, for each strip.

    All strips have the titles of the first.
    """
    columns = len(strips[0].tiles)
    rows = []
    for strip in strips:
        has_truth = any(tile.truth is not None for tile in strip.tiles)
        rows += [(strip, name) for name in (CLOUD, IMAGE, *([TRUTH] if has_truth else []))]
    cell_in = (WIDTH_IN - 0.4) / columns
    size_in = (WIDTH_IN, (cell_in + 0.05) * len(rows) + 0.4)
    figure, axes = panels(len(rows), columns, size_in)
    for axis, tile in zip(axes[0], strips[0].tiles, strict=True):
        axis.set_title(tile.title, fontsize=TEXT)
    for axis_row, (strip, name) in zip(axes, rows, strict=True):
        axis_row[0].set_ylabel(f"{strip.label}\n{name}", fontsize=TEXT)
        for axis, tile in zip(axis_row, strip.tiles, strict=True):
            shown = {
                CLOUD: draw_cloud(tile.cloud, view) if name == CLOUD else None,
                IMAGE: tile.image,
                TRUTH: tile.truth,
            }[name]
            if shown is None:
                bare(axis)
            else:
                show(axis, shown)
    return figure


def draw_cloud(cloud: Points, view: View) -> NDArray[np.uint8]:
    """Return a cloud as discs, grey by depth: uint8 [128, 128, 3]."""
    splat = Splat()
    return to_uint8(splat.draw(splat.prepare(PointCloud(cloud)), [view]))[0]
