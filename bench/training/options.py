"""The options of each training; their defaults are those of the networks' configurations.

Neither this module nor the configurations import PyTorch, so that the help stays quick.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, make_dataclass
from pathlib import Path
from typing import Any, Literal

from baselines.fused_net.config import FusedNetConfig
from baselines.occupancy_net.config import OccupancyNetConfig
from baselines.splat_net.config import SplatNetConfig
from baselines.upsampler.config import UpsamplerTrainingConfig
from learning.configuration import TimeLimit
from pc2pix.training_configs import AutoencoderConfig, DecoderConfig, GanConfig

# The number of procedural objects of each class that are trained on by default.
DEFAULT_OBJECTS = 1500


@dataclass(frozen=True, kw_only=True)
class TrainingOptions:
    """The options that all trainings have, but not the configurations of the networks.

    dataset    the dataset, as --dataset of `bench run` takes it
    classes    the classes to train on; empty for all of the dataset
    objects    the number of objects of each class; None for all of a dataset with files, and
               DEFAULT_OBJECTS of one that makes its objects
    views      the number of images of each object
    precision  the number format of the training step
    device     "auto", "cpu" or "cuda"
    threads    the number of PyTorch's threads on the CPU; None for PyTorch's choice
    limit      the time for the whole command; None for no limit
    out        the folder of the training
    """

    dataset: str = "procedural"
    classes: tuple[str, ...] = ("chair",)
    objects: int | None = None
    views: int = 8
    precision: Literal["float32", "bfloat16"] = "float32"
    device: str = "cpu"
    threads: int | None = None
    limit: TimeLimit | None = None
    out: Path


def _options_of(name: str, config: type[Any], **further: tuple[Any, Any]) -> type[Any]:
    """Return a subclass of TrainingOptions with the options of one training.

    config   the configuration of the network: its fields that hold a number, a text or a flag
             become options
    further  type and default of each further option, by its name
    """
    shared = {
        field.name: (type(field.default), field.default)
        for field in fields(config)
        if type(field.default) in (bool, int, float, str) and field.name != "precision"
    }
    further = {"out": (Path, Path("training", name)), **shared, **further}
    return make_dataclass(
        f"{config.__name__.removesuffix('Config')}Options",
        [(key, *typed) for key, typed in further.items()],
        bases=(TrainingOptions,),
        frozen=True,
        kw_only=True,
    )


# The type and default of --start: the weights to start from, or None for random ones.
_START = (str | None, None)
# For each training the class of its options.
OPTIONS: dict[str, type[Any]] = {
    "autoencoder": _options_of(
        "autoencoder",
        AutoencoderConfig,
        width=(Literal["lite", "half", "paper"], "lite"),
        encoder=(Literal["paper", "pointnet"], "paper"),
        latent_dim=(int, 32),
    ),
    # The GAN has no options for sizes: they are those of the autoencoder, or of the weights in its
    # place.
    "gan": _options_of(
        "gan",
        GanConfig,
        autoencoder=(Path, Path("training/autoencoder/checkpoint.safetensors")),
        azimuth=(Literal["scalar", "sine-cosine"], "scalar"),
        start=_START,
    ),
    # The option colours does not matter to points2pix, which always has a colour for each pixel.
    "splat-net": _options_of(
        "splat-net",
        SplatNetConfig,
        network=(str, "default"),  # a key of baselines.splat_net.network.NETWORKS
        start=_START,
        colours=(Literal["image", "pixel"], "image"),
    ),
    "fused-net": _options_of(
        "fused-net",
        FusedNetConfig,
        start=_START,
        views=(int, 4),
    ),
    "occupancy-net": _options_of("occupancy-net", OccupancyNetConfig),
    "upsampler": _options_of("upsampler", UpsamplerTrainingConfig),
    "decoder": _options_of("decoder", DecoderConfig, weights=(str, "chair")),
}
