"""The options of the trainings, without what a training loads.

Their defaults are those of the trainings' configurations, whose modules load torch: help does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

DEFAULT_OBJECTS = 1500


@dataclass(frozen=True, kw_only=True)
class TrainingOptions:
    """The options of all trainings.

    Attributes
    ----------
    classes : tuple of str
        Classes to train on; empty: all of the dataset.
    objects : int or None
        Objects of each class; None: DEFAULT_OBJECTS, or all of a dataset with an end.
    steps : int
        Steps since the beginning, not since a resume.
    threads : int or None
        CPU threads of torch; None: its choice.
    """

    dataset: str = "procedural"
    classes: tuple[str, ...] = ("chair",)
    objects: int | None = None
    steps: int
    batch: int = 32
    augment: bool = False
    precision: Literal["float32", "bfloat16"] = "float32"
    device: str = "cpu"
    seed: int = 0
    threads: int | None = None
    out: Path


@dataclass(frozen=True, kw_only=True)
class AutoencoderOptions(TrainingOptions):
    """The options of the autoencoder; see `pc2pix.train_autoencoder.AutoencoderConfig`."""

    width: Literal["lite", "paper"] = "lite"
    encoder: Literal["paper", "pointnet"] = "paper"
    latent_dim: int = 32
    steps: int = 10_000
    learning_rate: float = 1e-4
    out: Path = Path("training/autoencoder")


@dataclass(frozen=True, kw_only=True)
class GanOptions(TrainingOptions):
    """The options of the GAN; see `pc2pix.train_gan.GanConfig`. The autoencoder sets its sizes.

    Attributes
    ----------
    start : str or None
        Weights to start from, which stand for the autoencoder, too, and set the form of the
        azimuth; None: random ones.
    """

    autoencoder: Path = Path("training/autoencoder/checkpoint.safetensors")
    views: int = 8
    objective: str = "acgan-code"
    azimuth: Literal["scalar", "sine-cosine"] = "scalar"
    start: str | None = None
    steps: int = 20_000
    warm_up: int = 0
    generator_lr: float = 1e-4
    discriminator_lr: float = 2e-4
    out: Path = Path("training/gan")


@dataclass(frozen=True, kw_only=True)
class _UNetOptions(TrainingOptions):
    """The options that splat-net and fused-net share.

    Attributes
    ----------
    network : str
        A key of `baselines.splat_net.network.NETWORKS`.
    start : str or None
        Weights of splat-net to start from, see `baselines.splat_net.start.read_start`; None:
        random ones.
    """

    network: str = "default"
    views: int
    start: str | None = None
    objective: str = "l1"
    augment: bool = True
    warm_up: int = 0
    cool_down: int = 2000
    batch: int = 24
    learning_rate: float


@dataclass(frozen=True, kw_only=True)
class SplatNetOptions(_UNetOptions):
    """The options of splat-net; see `baselines.splat_net.train.SplatNetConfig`.

    Attributes
    ----------
    colours : str
        One colour for the image, or one for each pixel; points2pix has these always.
    """

    colours: Literal["image", "pixel"] = "image"
    views: int = 8
    steps: int = 8000
    learning_rate: float = 2e-3
    out: Path = Path("training/splat-net")


@dataclass(frozen=True, kw_only=True)
class FusedNetOptions(_UNetOptions):
    """The options of fused-net; see `baselines.fused_net.train.FusedNetConfig`.

    Attributes
    ----------
    meshes : tuple of str
        Methods whose meshes it sees, of `baselines.fused_net.weights.MESHES`.
    steps : int
        0: compute the maps of the meshes and train nothing.
    """

    meshes: tuple[str, ...] = ("denoised-wrap", "occupancy-net")
    views: int = 4
    steps: int = 4000
    learning_rate: float = 1e-3
    out: Path = Path("training/fused-net")


@dataclass(frozen=True, kw_only=True)
class OccupancyNetOptions(TrainingOptions):
    """The options of occupancy-net; see `baselines.occupancy_net.train.OccupancyNetConfig`."""

    augment: bool = True
    steps: int = 8000
    cool_down: int = 3000
    batch: int = 6
    learning_rate: float = 1e-3
    out: Path = Path("training/occupancy-net")


@dataclass(frozen=True, kw_only=True)
class DecoderOptions(TrainingOptions):
    """The options of the decoder of trained weights, which learns from procedural train chairs."""

    weights: str = "chair"
    steps: int = 3000
    out: Path = Path("training/decoder")
