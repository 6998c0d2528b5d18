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
    """What needs NumPy is imported when it is asked for: the command line has no time for it."""
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
    """A renderer with `prepare(cloud)` and `draw(state, views)`, from trained weights.

    name_or_path  a bundled name (`pc2pix.weights.BUNDLED`) or the path of an exported file
    z             the generator's noise, see `pc2pix.renderer.Pc2pixRenderer`
    precision     the generator's, "float32" or "bfloat16"; likewise

    Raises `data_prep.failures.BadInput` where the weights cannot be used. PyTorch is imported
    here, not with the package.
    """
    from pc2pix.renderer import Pc2pixRenderer
    from pc2pix.weights import load_weights

    return Pc2pixRenderer(load_weights(name_or_path), z=z, device=device, precision=precision)
