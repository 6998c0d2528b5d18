"""splat-net: a small network that draws images from the projected points of a cloud.

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
    name_or_path: str | Path = "all",
    *,
    device: str = "cpu",
    precision: Precision = "float32",
    size: int = 128,
) -> SplatNetRenderer:
    """Return a renderer with trained weights.

    Parameters
    ----------
    name_or_path : str or Path
        A bundled name (`learning.weights.FILES`) or the path of an exported file.
        The default is the network for objects of any kind.
    device : str
        PyTorch's name of the device, "cpu" or "cuda" for example.
    precision : {"float32", "bfloat16"}
        The network's precision, see `SplatNetRenderer`.
    size : int
        Side of the images in pixels, a multiple of 16.

    Returns
    -------
    SplatNetRenderer
        Renderer of images [V, size, size, 3].

    Raises
    ------
    data_prep.failures.BadInput
        For an unknown name and a damaged file.
    ValueError
        For another precision or size.
    """
    from baselines.splat_net.renderer import SplatNetRenderer
    from baselines.splat_net.weights import load_weights

    return SplatNetRenderer(
        load_weights(name_or_path), device=device, precision=precision, size=size
    )
