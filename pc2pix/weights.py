"""Trained weights as files: what is bundled, how a file is written, and how it is checked.

A file holds what drawing needs and nothing else: the encoder, the averaged generator, and mean and
standard deviation of the code. Kernels are float16, everything of one dimension (biases, BatchNorm,
code statistics) is float32. The safetensors header says how it was made.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from data_prep.failures import BadInput
from learning import checkpoint, weight_tensors
from learning.weight_files import file_sha256
from pc2pix.model import Encoder, Generator, ModelConfig, PointNet, build_encoder
from pc2pix.train_gan import KIND as GAN
from pc2pix.weight_files import find_weights

FORMAT = "pc2pix-weights-1"
# `pc2pix.model.Encoder` and `PointNet`; a renamed or changed encoder gets a new name
ENCODER_NAMES = {"paper": "dilated-conv-k5", "pointnet": "pointnet-max-mean"}
REMEDY = "write the file again with pc2pix.weights.export"
MOST_WIDTH = 4.0  # four times the paper's
MOST_LATENT_DIM = 4096  # eight times the paper's largest


@dataclass(frozen=True, eq=False)
class Weights:
    """Networks in float32 and evaluation mode, on the CPU.

    code_mean, code_std  float32 [latent_dim]: the generator's input is (code - mean) / std
    card                 how they were trained: objective, steps, seed, ...
    sha256               of the file
    """

    encoder: Encoder | PointNet
    generator: Generator
    code_mean: Tensor
    code_std: Tensor
    card: Mapping[str, Any]
    sha256: str


def export(checkpoint_path: Path, path: Path) -> str:
    """Write the weights of a GAN checkpoint to `path`, atomically; the file's sha256.

    Raises BadInput where the checkpoint is not one of a GAN, or a weight does not fit float16.
    """
    state, step, config = checkpoint.load(checkpoint_path, GAN)
    tensors = {"code_mean": state["code_mean"], "code_std": state["code_std"]}
    for name in ("encoder", "generator"):
        part = checkpoint.sub_state(state, f"average.{name}")
        tensors |= {f"{name}.{k}": v for k, v in weight_tensors.without_counters(part).items()}
    stored = checkpoint.halved(tensors, checkpoint_path, "export an earlier checkpoint")
    header = {
        "format": FORMAT,
        "encoder": ENCODER_NAMES[config["model"]["encoder"]],
        "model": json.dumps(config["model"]),
        "training": checkpoint.training_header(config, step, ["model"]),
    }
    checkpoint.write_atomically(path, stored, header)
    return file_sha256(path)


def load_weights(name_or_path: str | Path = "chair") -> Weights:
    """Weights by bundled name or by path.

    Raises BadInput, naming file, value and remedy, where a name is unknown, a bundled file differs
    from its checksum, the file is no safetensors file or of another format, or tensors are missing,
    superfluous, of the wrong shape or not finite.
    """
    path = find_weights(name_or_path)
    tensors, header = checkpoint.read_weights(path, FORMAT, REMEDY)
    with checkpoint.understanding_header(path, REMEDY):
        model, training = json.loads(header["model"]), json.loads(header["training"])
        config = _sane(ModelConfig(**model))
        card = {"model": model, **training}
    if header.get("encoder") != ENCODER_NAMES[config.encoder]:
        raise BadInput(
            f"{path}: expected encoder {ENCODER_NAMES[config.encoder]!r} in the header, found "
            f"{header.get('encoder')!r}; {REMEDY}"
        )
    expected = {"code_mean": (config.latent_dim,), "code_std": (config.latent_dim,)}
    with torch.device("meta"):  # shapes without memory: the file has yet to prove its size
        outlines = {"encoder": build_encoder(config), "generator": Generator(config)}
    for prefix, network in outlines.items():
        expected |= weight_tensors.shapes(network, f"{prefix}.")
    weight_tensors.check(path, tensors, expected, REMEDY)
    encoder, generator = build_encoder(config), Generator(config)
    weight_tensors.fill(encoder, checkpoint.sub_state(tensors, "encoder"))
    weight_tensors.fill(generator, checkpoint.sub_state(tensors, "generator"))
    return Weights(
        encoder=encoder,
        generator=generator,
        code_mean=tensors["code_mean"].float(),
        code_std=tensors["code_std"].float(),
        card=card,
        sha256=file_sha256(path),
    )


def _sane(config: ModelConfig) -> ModelConfig:
    """The configuration. Raises ValueError where its numbers are none that anybody has trained."""
    if not isinstance(config.latent_dim, int) or config.latent_dim > MOST_LATENT_DIM:
        raise ValueError(f"latent_dim {config.latent_dim}, expected up to {MOST_LATENT_DIM}")
    if config.width > MOST_WIDTH:
        raise ValueError(f"width {config.width}, expected up to {MOST_WIDTH}")
    return config
