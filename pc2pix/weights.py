"""Trained weights of pc2pix as files: how they are written, read and checked.

A file has what drawing needs and nothing else: the encoder, the averaged generator, and mean and
standard deviation of the codes. The names of the bundled files are in `learning.weights.FILES`.

A decoder has a file of its own, in the folder of the weights that it belongs to, because drawing
does not need it. Its header has the sha256 of these weights, because a decoder fits the codes of no
others.

Importing this module does not load PyTorch; reading and writing files does.
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
from learning.tensor_files import sub_state, understanding_header
from learning.weights import (
    FILES,
    check_sha256,
    check_tensors,
    expected_shapes,
    fill_network,
    read_weights,
)

if TYPE_CHECKING:
    from torch import Tensor

    from pc2pix.model import Decoder, Encoder, Generator, ModelConfig, PointNet

PACKAGE = "pc2pix"
# The sha256 of the file weights/NAME-decoder.safetensors, for each bundled name that has a decoder.
BUNDLED_DECODERS = {
    "chair": "f5b7f4233c03c155535049dd17928a1b4cdc89fe10cce72b9ce2ec83dd9d68a6",
}
DECODER = "decoder"  # kind of the checkpoints of a decoder's training
_DECODER_FORMAT = "pc2pix-decoder-1"  # of a decoder's file, in its header
# What a header names the kinds of encoder, `pc2pix.model.Encoder` and `PointNet`. A changed encoder
# gets a new name, so that weights of the old one are refused.
ENCODER_NAMES = {"paper": "dilated-conv-k5", "pointnet": "pointnet-max-mean"}
# Bounds of what a header may state, so that a damaged or malicious file cannot ask for huge memory.
_MOST_WIDTH = 4.0  # four times the paper's
_MOST_LATENT_DIM = 4096  # eight times the paper's largest


@dataclass(frozen=True, eq=False)
class Weights:
    """Trained networks in float32 and evaluation mode, on the CPU.

    code_mean, code_std  float32 [latent_dim]: the generator takes (code - code_mean) / code_std
    card                 how they were trained: objective, steps, learning rates, seed, ...
    sha256               of their file
    """

    encoder: Encoder | PointNet
    generator: Generator
    code_mean: Tensor
    code_std: Tensor
    card: Mapping[str, Any]
    sha256: str


def export(checkpoint_path: Path, path: Path) -> str:
    """Write the weights of a checkpoint of the GAN's training, and return the file's sha256.

    They are the averaged encoder and generator, and mean and standard deviation of the codes.

    Raises BadInput as `learning.weights.WeightFiles.export` does.
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
    """Return the weights of a bundled name, or of a file by its path.

    Raises BadInput as `learning.weights.WeightFiles.find` and `load` do, and where the file has
    another kind of encoder.
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
    # On "meta" tensors have shapes but no memory: a file that states huge networks, without having
    # their tensors, is refused before memory is taken for them.
    with torch.device("meta"):
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
    """Return the configuration unchanged; raise ValueError where a number is out of bounds."""
    if not isinstance(config.latent_dim, int) or config.latent_dim > _MOST_LATENT_DIM:
        raise ValueError(f"latent_dim {config.latent_dim}, expected up to {_MOST_LATENT_DIM}")
    if config.width > _MOST_WIDTH:
        raise ValueError(f"width {config.width}, expected up to {_MOST_WIDTH}")
    return config


def decoder_path(name_or_path: str | Path) -> Path:
    """Return the path of the decoder of these weights, in their folder, whether it exists or not.

    name_or_path  of the weights: a bundled name or a path
    """
    name = str(name_or_path)
    files = FILES[PACKAGE]
    bundled = files.folder / f"{name}.safetensors"
    weights = bundled if name in files.bundled else Path(name_or_path)
    return weights.with_name(f"{weights.stem}-decoder.safetensors")


def _training_command(name_or_path: str | Path) -> str:
    """Return the command that trains a decoder for these weights."""
    return f"bench train decoder --weights {name_or_path}"


def _find_decoder(name_or_path: str | Path) -> Path:
    """Return the path of the decoder of these weights.

    Raises BadInput, with the command that makes it, where the file is missing, and where a bundled
    one has not its checksum.
    """
    path = decoder_path(name_or_path)
    if not is_regular_file(path):
        raise BadInput(
            f"{path}: there is no decoder for these weights; "
            f"make it with '{_training_command(name_or_path)}'"
        )
    if expected := BUNDLED_DECODERS.get(str(name_or_path)):
        remedy = f"reinstall the package, or put the new checksum into {Path(__file__).name}"
        check_sha256(path, expected, remedy)
    return path


def export_decoder(checkpoint_path: Path, path: Path) -> str:
    """Write the decoder of a checkpoint, and return the file's sha256.

    Raises BadInput as `learning.weights.WeightFiles.export` does.
    """

    def select(
        state: dict[str, Tensor], config: dict[str, Any]
    ) -> tuple[dict[str, Tensor], dict[str, Any]]:
        header = {"weights": config["weights"], "model": config["model"]}
        return sub_state(state, "decoder"), header

    files = replace(FILES[PACKAGE], kind=DECODER, format=_DECODER_FORMAT)
    remedy = "train again with other settings"
    return files.export(checkpoint_path, path, select, remedy=remedy)


def load_decoder(name_or_path: str | Path, weights: Weights) -> tuple[Decoder, str]:
    """Return the decoder of weights, and the sha256 of its file.

    name_or_path  what the weights were loaded from, a bundled name or a path
    weights       the weights

    The decoder is in float32 and evaluation mode, on the CPU.

    Raises BadInput, with the command that makes the right one, where the decoder's file is missing,
    damaged, of another format or of other weights.
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
