"""The trainings behind `bench train`: data from a dataset, the loops from their packages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from bench.running.progress import progress
from data_prep.datasets import SceneObject, open_dataset
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.training_set import TrainingSet, add_surfaces, make_training_set

if TYPE_CHECKING:
    from baselines.splat_net.network import NetworkConfig

DEFAULT_OBJECTS = 1500
CLOUD_POINTS = 4096  # twice what the encoder reads: each step takes another half
DATA_SEED = 0


@dataclass(frozen=True)
class TrainingOptions:
    """What all trainings have in common; `steps` counts from the beginning, not from a resume.

    classes  to train on; empty: all that the dataset has
    objects  of each class
    """

    dataset: str
    classes: tuple[str, ...]
    objects: int | None
    steps: int
    batch: int
    augment: bool
    precision: Literal["float32", "bfloat16"]
    device: str
    seed: int
    threads: int | None
    out: Path


@dataclass(frozen=True)
class NetworkOptions:
    """What the networks look like; a GAN takes its own from its autoencoder, but for `azimuth`."""

    width: Literal["lite", "paper"]
    encoder: Literal["paper", "pointnet"]
    latent_dim: int


@dataclass(frozen=True)
class GanOptions:
    """What is particular to the GAN; see `pc2pix.train_gan.GanConfig`."""

    autoencoder: Path
    views: int
    objective: str
    azimuth: Literal["scalar", "sine-cosine"]
    warm_up: int
    generator_lr: float


@dataclass(frozen=True)
class SplatNetOptions:
    """What is particular to splat-net; see `baselines.splat_net.train.SplatNetConfig`.

    size     a key of `baselines.splat_net.network.SIZES`
    without  what it has to do without, see `do_without`
    start    weights to start from, see `baselines.splat_net.start.read_start`; None: random ones
    """

    size: str
    objective: str
    views: int
    warm_up: int
    cool_down: int
    learning_rate: float
    without: tuple[str, ...]
    start: str | None


def train_autoencoder(
    options: TrainingOptions, networks: NetworkOptions, learning_rate: float
) -> Path:
    """Train the point-cloud autoencoder; returns its checkpoint. Resumes what is in `out`."""
    from learning.processes import is_first
    from learning.progress import ConsoleProgress
    from pc2pix.model import LITE, PAPER
    from pc2pix.train_autoencoder import AutoencoderConfig, AutoencoderData
    from pc2pix.train_autoencoder import train_autoencoder as train

    _set_threads(options.threads)
    clouds = training_clouds(training_objects(options))
    config = AutoencoderConfig(
        model=replace(
            {"lite": LITE, "paper": PAPER}[networks.width],
            encoder=networks.encoder,
            latent_dim=networks.latent_dim,
        ),
        steps=options.steps,
        batch=options.batch,
        learning_rate=learning_rate,
        augment=options.augment,
        precision=options.precision,
        seed=options.seed,
    )
    with ConsoleProgress("autoencoder", quiet=not is_first()) as show:
        return train(
            AutoencoderData(clouds), config, options.out, device=options.device, on_progress=show
        )


def train_gan(options: TrainingOptions, gan: GanOptions) -> Path:
    """Train the rendering GAN on a trained autoencoder; returns the exported weights file."""
    from learning.processes import is_first
    from learning.progress import ConsoleProgress
    from pc2pix.train_autoencoder import load_encoder
    from pc2pix.train_gan import GanConfig, GanData
    from pc2pix.train_gan import train_gan as train
    from pc2pix.weights import export

    _set_threads(options.threads)
    encoder = load_encoder(gan.autoencoder)
    made = training_set(training_objects(options), gan.views)
    config = GanConfig(
        model=replace(encoder.config, azimuth=gan.azimuth),
        objective=gan.objective,
        steps=options.steps,
        warm_up=gan.warm_up,
        batch=options.batch,
        augment=options.augment,
        generator_lr=gan.generator_lr,
        precision=options.precision,
        seed=options.seed,
    )
    data = GanData(made.images, made.azimuth_deg, made.elevation_deg, made.clouds)
    with ConsoleProgress("gan", quiet=not is_first()) as show:
        checkpoint = train(
            data, encoder, config, options.out, device=options.device, on_progress=show
        )
    weights = options.out / "weights.safetensors"
    if is_first():
        export(checkpoint, weights)
    return weights


def train_splat_net(options: TrainingOptions, splat_net: SplatNetOptions) -> Path:
    """Train splat-net; returns the exported weights file, `weights-grey` stands beside it."""
    from baselines.splat_net.network import SIZES
    from baselines.splat_net.start import grey_beside, read_start
    from baselines.splat_net.train import SplatNetConfig, train_splat_net
    from baselines.splat_net.weights import export
    from learning.processes import is_first
    from learning.progress import ConsoleProgress

    _set_threads(options.threads)
    if splat_net.size not in SIZES:
        raise BadInput(f"--size: unknown '{splat_net.size}'; choose one of {', '.join(SIZES)}")
    network = do_without(SIZES[splat_net.size], splat_net.without)
    start = None
    if splat_net.start is not None:
        start = read_start(splat_net.start, network, options.seed)
    config = SplatNetConfig(
        network=network,
        objective=splat_net.objective,
        steps=options.steps,
        warm_up=splat_net.warm_up,
        cool_down=splat_net.cool_down,
        batch=options.batch,
        augment=options.augment,
        learning_rate=splat_net.learning_rate,
        precision=options.precision,
        seed=options.seed,
        start=start.sha256 if start else None,
    )
    objects = training_objects(options)
    seen = training_set(objects, splat_net.views)
    with _progress("silhouettes", len(objects)) as advance:
        data = add_surfaces(seen, objects, lambda: advance(0))
    with ConsoleProgress("splat-net", quiet=not is_first()) as show:
        checkpoint = train_splat_net(
            data,
            config,
            options.out,
            start=start.network if start else None,
            device=options.device,
            on_progress=show,
        )
    weights = options.out / "weights.safetensors"
    if is_first():
        export(checkpoint, weights, "colour")
        export(checkpoint, grey_beside(weights), "grey")
    return weights


def do_without(network: NetworkConfig, parts: Sequence[str]) -> NetworkConfig:
    """The network without these parts. Raises BadInput for one that there is not."""
    inputs = network.inputs
    for part in parts:
        if part == "discs":
            inputs = replace(inputs, windows=inputs.windows[:1])
        elif part in ("normals", "density", "flattened", "far"):
            inputs = replace(inputs, **{part: False})
        else:
            raise BadInput(
                f"--without {part}: there are normals, density, flattened, far and discs (all but "
                "the narrowest)"
            )
    return replace(network, inputs=inputs)


def training_clouds(objects: tuple[SceneObject, ...]) -> NDArray[np.float32]:
    """Clouds [N, M, 3], with progress. The same objects give the same clouds.

    M is CLOUD_POINTS, or what the objects have where they are clouds themselves.
    """
    clouds = []
    with _progress("sampling", len(objects)) as advance:
        for obj in objects:
            rng = generator(DATA_SEED, "training cloud", obj.class_name, obj.object_id)
            clouds.append(obj.cloud(rng, CLOUD_POINTS).points)
            advance(0)
    return np.stack(clouds)


def training_set(objects: tuple[SceneObject, ...], views: int) -> TrainingSet:
    """Sample and render, with progress. The same arguments give the same set."""
    with _progress("rendering", len(objects)) as advance:
        step: Callable[[], None] = lambda: advance(0)  # noqa: E731
        return make_training_set(objects, views, DATA_SEED, step)


def _progress(title: str, total: int) -> AbstractContextManager[Callable[[int], None]]:
    """On standard error, but for one process only."""
    from learning.processes import is_first

    return progress(title, total) if is_first() else nullcontext(lambda failed: None)


def training_objects(options: TrainingOptions) -> tuple[SceneObject, ...]:
    """The objects to train on, class by class. Raises BadInput where there are none."""
    dataset = open_dataset(options.dataset)
    objects = tuple(
        obj
        for name in options.classes or dataset.classes or ("",)  # a folder may have no classes
        for obj in dataset.objects(name, options.objects, DEFAULT_OBJECTS, "train")
    )
    if not objects:
        raise BadInput(f"--objects {options.objects}: training needs at least one object")
    return objects


def _set_threads(threads: int | None) -> None:
    if threads is not None:
        import torch

        torch.set_num_threads(threads)
