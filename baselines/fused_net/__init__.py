"""fused-net: a splat-net that also sees meshes of the cloud, from the same camera.

What becomes of a cloud, step by step:

1. A network for occupancy in 3D gives the first mesh: `baselines/occupancy_net/renderer.py`.
2. A network for small pieces gives the second: `baselines/upsampler/renderer.py`.
3. Points get normals and become surfels: `baselines/splat_net/surfels.py`.
4. For each view meshes become maps of depth and normals: `data_prep/rendering/raycast.py`.
5. Surfels are projected; these and the maps are channels: `baselines/splat_net/projection.py`.
6. The network draws coverage and grey of each pixel: `baselines/splat_net/engine.py`.
7. Where drawing and mesh agree the mesh's edges are taken: `baselines/splat_net/sharpening.py`.

`renderer.py` calls these steps, and `load` gives a renderer with bundled weights or your own.
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
        For an unknown name and a damaged file, and for weights of a splat-net without meshes.
    ValueError
        For another precision or size.
    """
    from baselines.fused_net.renderer import FusedNetRenderer
    from baselines.fused_net.weights import load_weights

    return FusedNetRenderer(
        load_weights(name_or_path), device=device, precision=precision, size=size
    )
