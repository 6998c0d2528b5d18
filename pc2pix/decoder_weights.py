"""Decoders as files: written beside the weights they belong to, and checked when they are read.

A file of its own, because drawing never needs it. Kernels are float16, biases float32; the header
names the weights by their sha256, for codes of other weights mean nothing to a decoder.
"""

from __future__ import annotations

import json
from pathlib import Path

from data_prep.failures import BadInput
from learning import checkpoint, weight_tensors
from learning.weight_files import file_sha256
from pc2pix.model import Decoder, ModelConfig
from pc2pix.train_decoder import KIND
from pc2pix.weight_files import find_decoder, training_command
from pc2pix.weights import Weights

FORMAT = "pc2pix-decoder-1"


def export_decoder(checkpoint_path: Path, path: Path) -> str:
    """Write the decoder of a checkpoint to `path`, atomically; the file's sha256.

    Raises BadInput where the checkpoint is not one of a decoder, or a weight does not fit float16.
    """
    state, step, config = checkpoint.load(checkpoint_path, KIND)
    tensors = checkpoint.sub_state(state, "decoder")
    stored = checkpoint.halved(tensors, checkpoint_path, "train again with other settings")
    header = {
        "format": FORMAT,
        "weights": config["weights"],
        "model": json.dumps(config["model"]),
        "training": checkpoint.training_header(config, step, ["model", "weights"]),
    }
    checkpoint.write_atomically(path, stored, header)
    return file_sha256(path)


def load_decoder(name_or_path: str | Path, weights: Weights) -> tuple[Decoder, str]:
    """The decoder of `weights`, which were loaded from `name_or_path`, and its file's sha256.

    In float32 and evaluation mode, on the CPU. Raises BadInput, naming file, value and the command
    that makes the right one, where there is none, where it is damaged or of another format, and
    where it belongs to other weights.
    """
    path = find_decoder(name_or_path)
    command = training_command(name_or_path)
    tensors, header = checkpoint.read_weights(path, FORMAT, f"make it with '{command}'")
    if header.get("weights") != weights.sha256:
        raise BadInput(
            f"{path}: belongs to weights of sha256 {header.get('weights')}, not to these of sha256 "
            f"{weights.sha256}; make the right one with '{command}'"
        )
    with checkpoint.understanding_header(path, f"make it again with '{command}'"):
        config = ModelConfig(**json.loads(header["model"]))
    if config != weights.encoder.config:
        raise BadInput(
            f"{path}: its model does not fit ({config}, the encoder's is "
            f"{weights.encoder.config}); make it again with '{command}'"
        )
    decoder = Decoder(config)
    expected = weight_tensors.shapes(decoder)
    weight_tensors.check(path, tensors, expected, f"make it again with '{command}'")
    weight_tensors.fill(decoder, tensors)
    return decoder, file_sha256(path)
