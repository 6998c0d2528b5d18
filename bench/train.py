"""The trainings behind `bench train`: data from a dataset, the loops from their packages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from bench.progress import progress
from data_prep.datasets import SceneObject, open_dataset
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.sampling import sample_surface
from data_prep.training_set import TrainingSet, make_training_set

DEFAULT_OBJECTS = 1500
CLOUD_POINTS = 4096  # twice what the encoder reads: each step takes another half
DATA_SEED = 0


@dataclass(frozen=True)
class TrainingOptions:
    """What all trainings have in common; `steps` counts from the beginning, not from a resume."""

    dataset: str
    class_name: str
    objects: int | None
    width: Literal["lite", "paper"]
    steps: int
    batch: int
    precision: Literal["float32", "bfloat16"]
    device: str
    seed: int
    threads: int | None
    out: Path


def train_autoencoder(options: TrainingOptions) -> Path:
    """Train the point-cloud autoencoder; returns its checkpoint. Resumes what is in `out`."""
    from pc2pix.model import LITE, PAPER
    from pc2pix.progress import ConsoleProgress
    from pc2pix.train_autoencoder import AutoencoderConfig, AutoencoderData
    from pc2pix.train_autoencoder import train_autoencoder as train

    _set_threads(options.threads)
    objects = _objects(options)
    clouds = np.empty((len(objects), CLOUD_POINTS, 3), np.float32)
    with progress("sampling", len(objects)) as advance:
        for i, obj in enumerate(objects):
            rng = generator(DATA_SEED, "training cloud", obj.class_name, obj.object_id)
            clouds[i] = sample_surface(obj.load(), rng, CLOUD_POINTS).points
            advance(0)
    config = AutoencoderConfig(
        model={"lite": LITE, "paper": PAPER}[options.width],
        steps=options.steps,
        batch=options.batch,
        precision=options.precision,
        seed=options.seed,
    )
    with ConsoleProgress("autoencoder") as show:
        return train(
            AutoencoderData(clouds), config, options.out, device=options.device, on_progress=show
        )


def train_gan(options: TrainingOptions, autoencoder: Path, objective: str, views: int) -> Path:
    """Train the rendering GAN on a trained autoencoder; returns the exported weights file."""
    from pc2pix.progress import ConsoleProgress
    from pc2pix.train_autoencoder import load_encoder
    from pc2pix.train_gan import GanConfig, GanData
    from pc2pix.train_gan import train_gan as train
    from pc2pix.weights import export

    _set_threads(options.threads)
    encoder = load_encoder(autoencoder)
    made = training_set(_objects(options), views)
    config = GanConfig(
        model=encoder.config,
        objective=objective,
        steps=options.steps,
        batch=options.batch,
        precision=options.precision,
        seed=options.seed,
    )
    data = GanData(made.images, made.azimuth_deg, made.elevation_deg, made.clouds)
    with ConsoleProgress("gan") as show:
        checkpoint = train(
            data, encoder, config, options.out, device=options.device, on_progress=show
        )
    weights = options.out / "weights.safetensors"
    export(checkpoint, weights)
    return weights


def training_set(objects: tuple[SceneObject, ...], views: int) -> TrainingSet:
    """Sample and render, with progress. The same arguments give the same set."""
    with progress("rendering", len(objects)) as advance:
        step: Callable[[], None] = lambda: advance(0)  # noqa: E731
        return make_training_set(objects, views, DATA_SEED, step)


def _objects(options: TrainingOptions) -> tuple[SceneObject, ...]:
    dataset = open_dataset(options.dataset)
    objects = dataset.objects(options.class_name, options.objects, DEFAULT_OBJECTS, "train")
    if not objects:
        raise BadInput(f"--objects {options.objects}: training needs at least one object")
    return objects


def _set_threads(threads: int | None) -> None:
    if threads is not None:
        import torch

        torch.set_num_threads(threads)
