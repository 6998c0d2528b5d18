"""The configuration of a training of fused-net, read by command lines, hence without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass

from baselines.fused_net.weights import check_meshes
from baselines.splat_net.config import SplatNetConfig


@dataclass(frozen=True)
class FusedNetConfig(SplatNetConfig):
    """The configuration of a training; `network.inputs.meshes` names the meshes that are seen.

    occupancy  sha256 of the weights of occupancy-net that make meshes; "" where it makes none

    Raises BadInput where the names of meshes are not those of fused-net, in its order.
    """

    steps: int = 4000
    learning_rate: float = 1e-3
    occupancy: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_meshes(self.network.inputs.meshes, "meshes")
