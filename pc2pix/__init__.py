"""pc2pix (Atienza 2019): images of point clouds drawn by a network.

`load` gives a renderer; `bench.draw_cloud(points, method="pc2pix@all")` an image of points.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from pc2pix.engine import Precision
    from pc2pix.renderer import NoisePolicy, Pc2pixRenderer

__all__ = ["load"]


def load(
    name_or_path: str | Path = "chair",
    *,
    z: NoisePolicy = "zero",
    device: str = "cpu",
    precision: Precision = "float32",
) -> Pc2pixRenderer:
    """Return a renderer with trained weights.

    PyTorch is imported here, not with the package.

    Parameters
    ----------
    name_or_path : str or Path
        A bundled name (`learning.weights.FILES`) or the path of an exported file.
    z : {"zero", "uniform"}
        The generator's noise, see `pc2pix.renderer.Pc2pixRenderer`.
    device : str
        PyTorch's name of the device, "cpu" or "cuda" for example.
    precision : {"float32", "bfloat16"}
        The generator's precision, see `pc2pix.renderer.Pc2pixRenderer`.

    Returns
    -------
    Pc2pixRenderer
        Renderer of images [V, 128, 128, 3].

    Raises
    ------
    data_prep.failures.BadInput
        Where the weights cannot be used.
    ValueError
        For another precision.
    """
    from pc2pix.renderer import Pc2pixRenderer
    from pc2pix.weights import load_weights

    return Pc2pixRenderer(load_weights(name_or_path), z=z, device=device, precision=precision)
