"""pc2pix (Atienza 2019): images of point clouds drawn by a network.

`draw_cloud` and `turntable` make images of points, `load` a renderer with weights of your choice.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from pc2pix.engine import Precision
    from pc2pix.images import draw_cloud, turntable
    from pc2pix.renderer import NoisePolicy, Pc2pixRenderer

__all__ = ["draw_cloud", "load", "turntable"]


def __getattr__(name: str) -> Any:
    """Import names that need NumPy when they are asked for.

    The command line has no time for NumPy.
    """
    if name not in ("draw_cloud", "turntable"):
        raise AttributeError(f"module 'pc2pix' has no attribute '{name}'")
    from pc2pix import images

    return getattr(images, name)


def load(
    name_or_path: str | Path = "chair",
    *,
    z: NoisePolicy = "zero",
    device: str = "cpu",
    precision: Precision = "float32",
) -> Pc2pixRenderer:
    """Return a renderer with `prepare(cloud)` and `draw(state, views)`, from trained weights.

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
