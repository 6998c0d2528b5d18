"""occupancy-net: a convolutional occupancy network (Peng et al. 2020), learned in 3D.

`load` gives a renderer with bundled weights or with your own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from baselines.occupancy_net.renderer import OccupancyNetRenderer

__all__ = ["load"]


def load(name_or_path: str | Path = "all", *, device: str = "cpu") -> OccupancyNetRenderer:
    """Return a renderer with trained weights.

    Parameters
    ----------
    name_or_path : str or Path
        A bundled name (`learning.weights.FILES`) or the path of an exported file.
    device : str
        PyTorch's name of the device, "cpu" or "cuda" for example.

    Returns
    -------
    OccupancyNetRenderer
        Renderer of images [V, 128, 128, 3].

    Raises
    ------
    data_prep.failures.BadInput
        For an unknown name and a damaged file.
    """
    from baselines.occupancy_net.renderer import OccupancyNetRenderer
    from baselines.occupancy_net.weights import load_weights

    return OccupancyNetRenderer(load_weights(name_or_path), device=device)
