"""Trained weights as files: those of a splat-net whose inputs name meshes.

What is bundled stands in `learning.weights.FILES`. PyTorch is imported by what handles tensors
only.
"""

from __future__ import annotations

from pathlib import Path

from baselines.splat_net.weights import read_file
from data_prep.failures import BadInput
from learning.weights import FILES, NetworkWeights

PACKAGE = "baselines.fused_net"
MESHES = ("denoised-wrap", "occupancy-net")  # methods whose meshes it can see, in this order


def load_weights(name_or_path: str | Path = "all") -> NetworkWeights:
    """Return the weights of a bundled name or a path.

    Raises BadInput as `learning.weights.WeightFiles.find` and `load`, and for a network that sees
    no meshes, or others than MESHES.
    """
    path = FILES[PACKAGE].find(name_or_path)
    weights = read_file(path, in_grey=str(name_or_path) in FILES[PACKAGE].files)
    meshes = weights.network.config.inputs.meshes
    if not meshes:
        raise BadInput(f"{path}: the network sees no meshes; use it as splat-net@{path}")
    check_meshes(meshes, str(path))
    return weights


def check_meshes(meshes: tuple[str, ...], where: str) -> None:
    """Check that meshes are of MESHES, at least one, in their order.

    Raises BadInput, which begins with `where`, otherwise.
    """
    if not meshes or meshes != tuple(name for name in MESHES if name in meshes):
        raise BadInput(
            f"{where}: meshes of {', '.join(meshes) or 'no method'}; choose from "
            f"{', '.join(MESHES)}, in this order"
        )
