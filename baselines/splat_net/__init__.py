"""splat-net: a small network whose input is the projected points.

`load` gives a renderer with bundled weights or with your own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from baselines.splat_net.engine import Precision
    from baselines.splat_net.renderer import SplatNetRenderer

__all__ = ["load"]


def load(
    name_or_path: str | Path = "chair",
    *,
    device: str = "cpu",
    precision: Precision = "float32",
    size: int = 128,
) -> SplatNetRenderer:
    """Return a renderer with `prepare` and `draw`; see `SplatNetRenderer`.

    Bundled names are the keys of `baselines.splat_net.weights.BUNDLED`. Raises BadInput for an
    unknown name and a damaged file, ValueError for another precision or size.
    """
    from baselines.splat_net.renderer import SplatNetRenderer
    from baselines.splat_net.weights import load_weights

    return SplatNetRenderer(
        load_weights(name_or_path), device=device, precision=precision, size=size
    )
