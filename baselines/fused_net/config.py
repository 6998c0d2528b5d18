"""The configuration of a training; it loads no PyTorch, as command lines need it."""

from __future__ import annotations

from dataclasses import dataclass

from baselines.fused_net.weights import check_meshes
from baselines.splat_net.config import SplatNetConfig


@dataclass(frozen=True)
class FusedNetConfig(SplatNetConfig):
    """The configuration of a training; the meshes are among the inputs of the network.

    occupancy  checksum of the weights of occupancy-net that make its meshes; "" without these
    """

    steps: int = 4000
    learning_rate: float = 1e-3
    occupancy: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_meshes(self.network.inputs.meshes, "meshes")
