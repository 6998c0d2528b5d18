"""The configuration of a training of fused-net, read by command lines, hence without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass

from baselines.splat_net.config import SplatNetConfig
from data_prep.failures import BadInput


@dataclass(frozen=True)
class FusedNetConfig(SplatNetConfig):
    """The configuration of a training.

    mesh_weights  sha256 of the weights of the networks that make meshes
    turned        share of the objects that are turned at random, 0..1

    Raises BadInput where the share of turned objects is not within 0..1.
    """

    steps: int = 4000
    learning_rate: float = 1e-3
    mesh_weights: str = ""
    turned: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.turned <= 1:
            raise BadInput(f"turned {self.turned}: a share of the objects lies within 0 to 1")
