"""fused-net: splat-net that also sees meshes of the cloud from the same camera.

`load` gives a renderer with bundled weights or with your own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from baselines.fused_net.renderer import FusedNetRenderer
    from learning.convolution import Precision

__all__ = ["load"]


def load(
    name_or_path: str | Path = "all",
    *,
    device: str = "cpu",
    precision: Precision = "float32",
    size: int = 128,
) -> FusedNetRenderer:
    """Return a renderer with trained weights.

    Parameters
    ----------
    name_or_path : str or Path
        A bundled name (`learning.weights.FILES`) or the path of an exported file.
    device : str
        PyTorch's name of the device, "cpu" or "cuda" for example.
    precision : {"float32", "bfloat16"}
        Precision of the network that draws, see `baselines.splat_net.renderer.SplatNetRenderer`.
    size : int
        Side of the images in pixels, a multiple of 16.

    Returns
    -------
    FusedNetRenderer
        Renderer of images [V, size, size, 3].

    Raises
    ------
    data_prep.failures.BadInput
        For an unknown name and a damaged file.
    ValueError
        For another precision or size.
    """
    from baselines.fused_net.renderer import FusedNetRenderer
    from baselines.fused_net.weights import load_weights

    return FusedNetRenderer(
        load_weights(name_or_path), device=device, precision=precision, size=size
    )
