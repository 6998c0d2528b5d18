"""The configuration of the networks of pc2pix."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

EncoderKind = Literal["paper", "pointnet"]
AzimuthKind = Literal["scalar", "sine-cosine"]


@dataclass(frozen=True)
class ModelConfig:
    """The widths and variants of all networks.

    Parameters
    ----------
    width : float
        Factor on every hidden width but PointNet's; 1.0 is the paper's.
    latent_dim : int
        Length of the code rho: 32 for chairs, 512 for all classes in the paper.
    encoder : {"paper", "pointnet"}
        "paper": dilated convolutions along the order of 2,048 points. "pointnet": ours,
        independent of order, any number of points.
    azimuth : {"scalar", "sine-cosine"}
        Form in which networks give and take the azimuth. "scalar": as in the paper, one number
        that jumps at the back of the object. "sine-cosine": ours, two numbers without a jump.

    Raises
    ------
    ValueError
        Where a number is not positive or a kind is unknown.
    """

    width: float = 1.0
    latent_dim: int = 32
    encoder: EncoderKind = "paper"
    azimuth: AzimuthKind = "scalar"

    def __post_init__(self) -> None:
        if not self.width > 0:
            raise ValueError(f"width must be positive, got {self.width}")
        if self.latent_dim < 1:
            raise ValueError(f"latent_dim must be at least 1, got {self.latent_dim}")
        if self.encoder not in ("paper", "pointnet"):
            raise ValueError(f"encoder must be paper or pointnet, got {self.encoder!r}")
        if self.azimuth not in ("scalar", "sine-cosine"):
            raise ValueError(f"azimuth must be scalar or sine-cosine, got {self.azimuth!r}")

    def scaled(self, channels: int) -> int:
        """Return a width of the paper scaled to this configuration, at least 1."""
        return max(1, round(channels * self.width))

    @property
    def azimuth_numbers(self) -> int:
        """Return the number of values that stand for an azimuth, 1 or 2."""
        return 1 if self.azimuth == "scalar" else 2


PAPER = ModelConfig()
HALF = ModelConfig(width=0.5)
LITE = ModelConfig(width=0.25)
