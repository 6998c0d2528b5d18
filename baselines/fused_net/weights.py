"""Trained weights as files: those of a splat-net whose inputs name meshes.

The format is that of `baselines.splat_net.weights`. PyTorch is imported by what handles tensors
only.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from data_prep.failures import BadInput
from learning.weights import find_file

if TYPE_CHECKING:
    from baselines.splat_net.weights import SplatNetWeights

FOLDER = Path(__file__).parent / "weights"
_ALL = "e5be7a567f234de205fa6ac03598604c5f51b0fb19e1cf56082234adba13bb33"
BUNDLED: dict[str, str] = {"all": _ALL, "all-grey": _ALL}  # name -> sha256 of its file
IN_GREY = {"all-grey": "all"}  # by name, whose file has that head, too
KIND = "fused-net"  # of the checkpoints of its training
MESHES = ("denoised-wrap", "occupancy-net")  # methods whose meshes it can see


def find_weights(name_or_path: str | Path) -> Path:
    """Return the file of a bundled name, its checksum verified, or the path itself.

    Raises BadInput, naming file, value and remedy, where a name is unknown, a file is missing, or a
    bundled file differs from its checksum.
    """
    return find_file(name_or_path, FOLDER, BUNDLED, IN_GREY)


def load_weights(name_or_path: str | Path = "all") -> SplatNetWeights:
    """Return the weights of a bundled name or a path.

    Raises BadInput as `find_weights` and `baselines.splat_net.weights.read_file`, and for a network
    that sees no meshes, or others than MESHES.
    """
    from baselines.splat_net.weights import read_file

    path = find_weights(name_or_path)
    weights = read_file(path, in_grey=str(name_or_path) in IN_GREY)
    meshes = weights.network.config.inputs.meshes
    if not meshes:
        raise BadInput(f"{path}: the network sees no meshes; use it as splat-net@{path}")
    check_meshes(meshes, str(path))
    return weights


def check_meshes(meshes: tuple[str, ...], where: str) -> None:
    """Check that meshes are different ones of MESHES, at least one.

    Raises BadInput, which begins with `where`, otherwise.
    """
    if not meshes or len({*meshes} & {*MESHES}) != len(meshes):
        raise BadInput(
            f"{where}: meshes of {', '.join(meshes) or 'no method'}; choose from "
            f"{', '.join(MESHES)}, each once"
        )
