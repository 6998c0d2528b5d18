"""occupancy-net: a convolutional occupancy network (Peng et al. 2020), learned in 3D.

`load` gives a renderer with bundled weights or with your own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from baselines.occupancy_net.renderer import OccupancyNetRenderer
    from learning.convolution import Precision

__all__ = ["load"]


def load(
    name_or_path: str | Path = "all", *, device: str = "cpu", precision: Precision = "float32"
) -> OccupancyNetRenderer:
    """Return a renderer with `prepare(cloud)` and `draw(state, views)`, from trained weights.

    Parameters
    ----------
    name_or_path : str or Path
        A bundled name (`baselines.occupancy_net.weights.BUNDLED`) or the path of an exported file.
    device : str
        PyTorch's name of the device, "cpu" or "cuda" for example.
    precision : {"float32"}
        Precision of the network; there is no other.

    Returns
    -------
    OccupancyNetRenderer
        Renderer of images [V, 128, 128, 3].

    Raises
    ------
    data_prep.failures.BadInput
        For an unknown name and a damaged file.
    ValueError
        For another precision.
    """
    from baselines.occupancy_net.renderer import OccupancyNetRenderer
    from baselines.occupancy_net.weights import load_weights

    if precision != "float32":
        raise ValueError(f"precision {precision}: occupancy-net computes in float32")
    return OccupancyNetRenderer(load_weights(name_or_path), device=device)
