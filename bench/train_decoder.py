"""The fit of a decoder to trained weights (`bench train decoder`), for the suite `latent`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bench.train import DEFAULT_OBJECTS, training_clouds
from data_prep.datasets import ProceduralObject
from data_prep.failures import BadInput


@dataclass(frozen=True)
class DecoderOptions:
    """The wishes of the command line. `steps` counts from the beginning, not from a resume."""

    weights: str
    objects: int | None
    steps: int
    batch: int
    precision: Literal["float32", "bfloat16"]
    device: str
    seed: int
    threads: int | None
    out: Path


def train_decoder(options: DecoderOptions) -> Path:
    """Fit a decoder to the encoder of `weights`; returns its file, which stands beside them.

    The data are the procedural train chairs. What is in `out` is continued. Raises BadInput where
    the weights cannot be used or a number is not positive.
    """
    count = DEFAULT_OBJECTS if options.objects is None else options.objects
    for name, value in (("objects", count), ("steps", options.steps), ("batch", options.batch)):
        if value < 1:
            raise BadInput(f"--{name} {value}: must be at least 1")
    import torch

    from learning.processes import is_first
    from learning.progress import ConsoleProgress
    from pc2pix.train_autoencoder import AutoencoderData
    from pc2pix.train_decoder import DecoderConfig
    from pc2pix.train_decoder import train_decoder as train
    from pc2pix.weights import decoder_path, export_decoder, load_weights

    if options.threads is not None:
        torch.set_num_threads(options.threads)
    weights = load_weights(options.weights)
    objects = tuple(ProceduralObject("chair", "train", i) for i in range(count))
    clouds = training_clouds(objects)
    config = DecoderConfig(
        weights=weights.sha256,
        model=weights.encoder.config,
        steps=options.steps,
        batch=options.batch,
        precision=options.precision,
        seed=options.seed,
    )
    with ConsoleProgress("decoder", quiet=not is_first()) as show:
        checkpoint = train(
            AutoencoderData(clouds),
            weights,
            config,
            options.out,
            device=options.device,
            on_progress=show,
        )
    path = decoder_path(options.weights)
    if is_first():
        export_decoder(checkpoint, path)
    return path
