"""Trained weights of fused-net as files: they are those of a splat-net whose inputs have meshes.

The names of the bundled files are in `learning.weights.FILES`. Importing this module does not load
PyTorch; reading a file does.
"""

from __future__ import annotations

from pathlib import Path

from baselines.splat_net.weights import read_file
from data_prep.failures import BadInput
from learning.weights import FILES, NetworkWeights

PACKAGE = "baselines.fused_net"
MESHES = ("occupancy-net", "upsampled-wrap")  # methods whose meshes a fused-net sees, in order


def load_weights(name_or_path: str | Path = "all") -> NetworkWeights:
    """Return the weights of a bundled name, or of a file by its path.

    Raises BadInput as `learning.weights.WeightFiles.find` and `load` do, and for a network that
    sees no meshes, or others than MESHES.
    """
    path = FILES[PACKAGE].find(name_or_path)
    weights = read_file(path, in_grey=str(name_or_path) in FILES[PACKAGE].files)
    meshes = weights.network.config.inputs.meshes
    if not meshes:
        raise BadInput(f"{path}: the network sees no meshes; use it as splat-net@{path}")
    if meshes != MESHES:
        raise BadInput(
            f"{path}: the network sees the meshes of {', '.join(meshes)}, and is shown those of "
            f"{', '.join(MESHES)}; train it again"
        )
    return weights
