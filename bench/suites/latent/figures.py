"""The paper's Figures 5 and 6: clouds above the images that are drawn of the same codes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.splat import Splat
from bench.report.sheets import image_sheet
from data_prep.rendering.images import to_uint8
from data_prep.scene import PointCloud, Points, View

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class StripTile(NamedTuple):
    """A cloud [N, 3] above an image uint8 [128, 128, 3] and perhaps the true one, with a title."""

    title: str
    cloud: Points
    image: NDArray[np.uint8]
    truth: NDArray[np.uint8] | None = None


Strip = tuple[str, Sequence[StripTile]]  # the label and the tiles of one path or sum


def strips_figure(strips: Sequence[Strip], view: View) -> Figure:
    """Return rows of clouds, images, and true images if any, for each strip.

    All strips have the titles of the first.
    """
    rows = []
    for label, tiles in strips:
        rows.append((f"{label}\ndecoded", [draw_cloud(tile.cloud, view) for tile in tiles]))
        rows.append((f"{label}\ndrawn", [tile.image for tile in tiles]))
        if any(tile.truth is not None for tile in tiles):
            none = np.full_like(tiles[0].image, 255)
            true = [none if tile.truth is None else tile.truth for tile in tiles]
            rows.append((f"{label}\ntrue", true))
    titles = [tile.title for tile in strips[0][1]]
    return image_sheet(titles, rows)


def draw_cloud(cloud: Points, view: View) -> NDArray[np.uint8]:
    """Return a cloud as discs, grey by depth: uint8 [128, 128, 3]."""
    splat = Splat()
    return to_uint8(splat.draw(splat.prepare(PointCloud(cloud)), [view]))[0]
