"""Trained weights as files: how a file is written, and how it is checked.

A file holds what drawing needs and nothing else: the encoder, the averaged generator, and mean and
standard deviation of the code. What is bundled stands in `learning.weights.FILES`.

A decoder has a file of its own beside the weights it belongs to, because drawing never needs it.
Its header names the weights by their sha256, for codes of other weights mean nothing to a decoder.

PyTorch is imported by what handles tensors only.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.files.safe_read import is_regular_file
from learning.weights import (
    FILES,
    check_sha256,
    check_tensors,
    expected_shapes,
    fill_network,
    read_weights,
    sub_state,
    understanding_header,
)

if TYPE_CHECKING:
    from torch import Tensor

    from pc2pix.model import Decoder, Encoder, Generator, ModelConfig, PointNet

PACKAGE = "pc2pix"
BUNDLED_DECODERS = {  # name -> sha256 of weights/<name>-decoder.safetensors
    "chair": "f5b7f4233c03c155535049dd17928a1b4cdc89fe10cce72b9ce2ec83dd9d68a6",
}
DECODER = "decoder"  # the kind of the checkpoints of its training
_DECODER_FORMAT = "pc2pix-decoder-1"
# `pc2pix.model.Encoder` and `PointNet`; a renamed or changed encoder gets a new name
ENCODER_NAMES = {"paper": "dilated-conv-k5", "pointnet": "pointnet-max-mean"}
_MOST_WIDTH = 4.0  # four times the paper's
_MOST_LATENT_DIM = 4096  # eight times the paper's largest


@dataclass(frozen=True, eq=False)
class Weights:
    """The trained networks in float32 and evaluation mode, on the CPU.

    code_mean, code_std  float32 [latent_dim]: the generator's input is (code - mean) / std
    card                 how they were trained: objective, steps, learning rates, seed, ...
    sha256               of the file
    """

    encoder: Encoder | PointNet
    generator: Generator
    code_mean: Tensor
    code_std: Tensor
    card: Mapping[str, Any]
    sha256: str


def export(checkpoint_path: Path, path: Path) -> str:
    """Write encoder, averaged generator and code statistics of a GAN checkpoint.

    Returns the sha256. Raises BadInput as `learning.weights.WeightFiles.export`.
    """

    def select(
        state: dict[str, Tensor], config: dict[str, Any]
    ) -> tuple[dict[str, Tensor], dict[str, Any]]:
        tensors = {"code_mean": state["code_mean"], "code_std": state["code_std"]}
        tensors |= sub_state(state, "average")
        model = config["model"]
        return tensors, {"encoder": ENCODER_NAMES[model["encoder"]], "model": model}

    return FILES[PACKAGE].export(checkpoint_path, path, select)


def load_weights(name_or_path: str | Path = "chair") -> Weights:
    """Return the weights of a bundled name or a path.

    Raises BadInput as `learning.weights.WeightFiles.find` and `load`.
    """
    import torch

    from pc2pix.model import Generator, ModelConfig, build_encoder

    files = FILES[PACKAGE]
    path, remedy = files.find(name_or_path), files.remedy
    tensors, header = read_weights(path, files.format, remedy)
    with understanding_header(path, remedy):
        model, training = json.loads(header["model"]), json.loads(header["training"])
        config = _sane(ModelConfig(**model))
        card = {"model": model, **training}
    if header.get("encoder") != ENCODER_NAMES[config.encoder]:
        raise BadInput(
            f"{path}: expected encoder {ENCODER_NAMES[config.encoder]!r} in the header, found "
            f"{header.get('encoder')!r}; {remedy}"
        )
    expected = {"code_mean": (config.latent_dim,), "code_std": (config.latent_dim,)}
    with torch.device("meta"):  # shapes without memory: the file has yet to prove its size
        outlines = {"encoder": build_encoder(config), "generator": Generator(config)}
    for prefix, network in outlines.items():
        expected |= expected_shapes(network, f"{prefix}.")
    check_tensors(path, tensors, expected, remedy)
    encoder, generator = build_encoder(config), Generator(config)
    fill_network(encoder, sub_state(tensors, "encoder"))
    fill_network(generator, sub_state(tensors, "generator"))
    return Weights(
        encoder=encoder,
        generator=generator,
        code_mean=tensors["code_mean"].float(),
        code_std=tensors["code_std"].float(),
        card=card,
        sha256=file_sha256(path),
    )


def _sane(config: ModelConfig) -> ModelConfig:
    """Return the configuration unchanged.

    Raises ValueError where its numbers are none that anybody has trained.
    """
    if not isinstance(config.latent_dim, int) or config.latent_dim > _MOST_LATENT_DIM:
        raise ValueError(f"latent_dim {config.latent_dim}, expected up to {_MOST_LATENT_DIM}")
    if config.width > _MOST_WIDTH:
        raise ValueError(f"width {config.width}, expected up to {_MOST_WIDTH}")
    return config


def decoder_path(name_or_path: str | Path) -> Path:
    """Return the place of these weights' decoder, beside them, whether it exists or not."""
    name = str(name_or_path)
    files = FILES[PACKAGE]
    bundled = files.folder / f"{name}.safetensors"
    weights = bundled if name in files.bundled else Path(name_or_path)
    return weights.with_name(f"{weights.stem}-decoder.safetensors")


def _training_command(name_or_path: str | Path) -> str:
    """Return the command that makes the decoder of these weights."""
    return f"bench train decoder --weights {name_or_path}"


def _find_decoder(name_or_path: str | Path) -> Path:
    """Return the file of these weights' decoder; a bundled one's checksum is verified.

    Raises BadInput, with the command that makes it, where it is missing.
    """
    path = decoder_path(name_or_path)
    if not is_regular_file(path):
        raise BadInput(
            f"{path}: there is no decoder for these weights; "
            f"make it with '{_training_command(name_or_path)}'"
        )
    if expected := BUNDLED_DECODERS.get(str(name_or_path)):
        remedy = f"reinstall the package, or name the new one in {Path(__file__).name}"
        check_sha256(path, expected, remedy)
    return path


def export_decoder(checkpoint_path: Path, path: Path) -> str:
    """Write the decoder of a checkpoint, and return the sha256.

    Raises BadInput as `learning.weights.WeightFiles.export`.
    """
    files = replace(FILES[PACKAGE], kind=DECODER, format=_DECODER_FORMAT)
    return files.export(
        checkpoint_path,
        path,
        lambda state, config: (
            sub_state(state, "decoder"),
            {"weights": config["weights"], "model": config["model"]},
        ),
        "train again with other settings",
    )


def load_decoder(name_or_path: str | Path, weights: Weights) -> tuple[Decoder, str]:
    """Return the decoder of `weights`, loaded from `name_or_path`, and its file's sha256.

    The decoder is in float32 and evaluation mode, on the CPU. Raises BadInput, naming file, value
    and the command that makes the right one, where the file is missing, damaged, of another format
    or of other weights.
    """
    from pc2pix.model import Decoder, ModelConfig

    path = _find_decoder(name_or_path)
    command = _training_command(name_or_path)
    tensors, header = read_weights(path, _DECODER_FORMAT, f"make it with '{command}'")
    if header.get("weights") != weights.sha256:
        raise BadInput(
            f"{path}: belongs to weights of sha256 {header.get('weights')}, not to these of sha256 "
            f"{weights.sha256}; make the right one with '{command}'"
        )
    with understanding_header(path, f"make it again with '{command}'"):
        config = ModelConfig(**json.loads(header["model"]))
    if config != weights.encoder.config:
        raise BadInput(
            f"{path}: its model does not fit ({config}, the encoder's is "
            f"{weights.encoder.config}); make it again with '{command}'"
        )
    decoder = Decoder(config)
    expected = expected_shapes(decoder)
    check_tensors(path, tensors, expected, f"make it again with '{command}'")
    fill_network(decoder, tensors)
    return decoder, file_sha256(path)
