"""The trainings of the networks that draw, by name.

Each goes on with the training that is in its folder.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from bench.training.images import train_fused_net, train_splat_net
from bench.training.pc2pix import train_autoencoder, train_decoder, train_gan
from bench.training.session import check_least, data_in_time
from bench.training.surfaces import train_occupancy_net, train_upsampler
from learning.training_loop import prepare_device

_TRAININGS = {
    "autoencoder": train_autoencoder,
    "gan": train_gan,
    "splat-net": train_splat_net,
    "fused-net": train_fused_net,
    "occupancy-net": train_occupancy_net,
    "upsampler": train_upsampler,
    "decoder": train_decoder,
}


def train(name: str, options: Any) -> Path:
    """Train a network with options of `bench.training.options.OPTIONS`; return its file.

    That is the file of exported weights; of the autoencoder it is the checkpoint, and of a decoder
    it stands beside the weights that it belongs to. Beside those of splat-net and fused-net in
    colour stand those in grey; fused-net with no steps returns the folder of its maps.

    Raises BadInput for options that no training can have, before data are made.
    """
    for option, least in (("steps", 0 if name == "fused-net" else 1), ("batch", 1)):
        check_least(option, getattr(options, option), least)
    if options.threads is not None:
        torch.set_num_threads(options.threads)
    prepare_device(options.device)  # data take minutes: refuse before them
    with data_in_time(options.limit, options.out):
        return _TRAININGS[name](options)
