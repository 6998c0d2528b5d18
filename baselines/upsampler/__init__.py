"""The up-sampler: a local network that moves places near a cloud onto its surface.

`load` gives the renderer of `upsampled-wrap`, with bundled weights or with your own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from baselines.upsampler.renderer import UpsampledWrapRenderer

__all__ = ["load"]


def load(name_or_path: str | Path = "all", *, device: str = "cpu") -> UpsampledWrapRenderer:
    """Return a renderer with trained weights.

    Parameters
    ----------
    name_or_path : str or Path
        A bundled name (`learning.weights.FILES`) or the path of an exported file.
    device : str
        PyTorch's name of the device, "cpu" or "cuda" for example.

    Returns
    -------
    UpsampledWrapRenderer
        Renderer of images [V, size, size, 3].

    Raises
    ------
    data_prep.failures.BadInput
        For an unknown name and a damaged file.
    """
    from baselines.upsampler.renderer import UpsampledWrapRenderer
    from baselines.upsampler.weights import load_weights

    return UpsampledWrapRenderer(load_weights(name_or_path), device=device)
