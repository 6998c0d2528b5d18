"""pc2pix (Atienza 2019): pictures of point clouds drawn by a network. See `load`."""

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
    """A renderer with `prepare(cloud)` and `draw(state, views)`, from trained weights.

    name_or_path  a bundled name (`pc2pix.weight_files.BUNDLED`) or the path of an exported file
    z             the generator's noise, see `pc2pix.renderer.Pc2pixRenderer`
    precision     the generator's, "float32" or "bfloat16"; likewise

    Raises `data_prep.failures.BadInput` where the weights cannot be used. PyTorch is imported
    here, not with the package.
    """
    from pc2pix.renderer import Pc2pixRenderer
    from pc2pix.weights import load_weights

    return Pc2pixRenderer(load_weights(name_or_path), z=z, device=device, precision=precision)
