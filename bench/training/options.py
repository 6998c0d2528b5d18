"""The options of the trainings by name; their defaults are those of the configurations.

Neither loads PyTorch: help does not need it.
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

DEFAULT_OBJECTS = 1500


@dataclass(frozen=True, kw_only=True)
class TrainingOptions:
    """The options that trainings share and their configurations have not.

    classes  to train on; empty: all of the dataset
    objects  of each class; None: DEFAULT_OBJECTS, or all of a dataset with an end
    threads  of torch on the CPU; None: its choice
    limit    the time for the whole command; None: none
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
    """Return TrainingOptions with the numbers, words and flags of a configuration, and more.

    further  type and default by name
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


_START = (str | None, None)  # weights, or random ones
OPTIONS: dict[str, type[Any]] = {
    "autoencoder": _options_of(
        "autoencoder",
        AutoencoderConfig,
        width=(Literal["lite", "half", "paper"], "lite"),
        encoder=(Literal["paper", "pointnet"], "paper"),
        latent_dim=(int, 32),
    ),
    # the autoencoder, or the weights in its place, set the sizes
    "gan": _options_of(
        "gan",
        GanConfig,
        autoencoder=(Path, Path("training/autoencoder/checkpoint.safetensors")),
        azimuth=(Literal["scalar", "sine-cosine"], "scalar"),
        start=_START,
    ),
    # points2pix has a colour for each pixel always
    "splat-net": _options_of(
        "splat-net",
        SplatNetConfig,
        network=(str, "default"),  # a key of `baselines.splat_net.network.NETWORKS`
        start=_START,
        colours=(Literal["image", "pixel"], "image"),
    ),
    "fused-net": _options_of(
        "fused-net",
        FusedNetConfig,
        start=_START,
        views=(int, 4),
        meshes=(tuple[str, ...], ("denoised-wrap", "occupancy-net")),
    ),
    "occupancy-net": _options_of("occupancy-net", OccupancyNetConfig),
    "upsampler": _options_of("upsampler", UpsamplerTrainingConfig),
    "decoder": _options_of("decoder", DecoderConfig, weights=(str, "chair")),
}
