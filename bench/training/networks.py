"""The trainings of the networks that draw, by name.

A training continues an earlier one of the same kind that is in its folder.
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
    """Train a network, and return the file of its weights.

    name     the name of the training, a key of `bench.training.options.OPTIONS`
    options  an instance of the class that OPTIONS has for it

    The autoencoder's file is its checkpoint, and a decoder's stands beside the weights of its
    encoder. Splat-net and fused-net also write weights that draw in grey, beside those in colour.
    Fused-net with 0 steps returns the folder of the maps that it would learn from.

    Raises BadInput for options that no training can have, before any data are made.
    """
    for option, least in (("steps", 0 if name == "fused-net" else 1), ("batch", 1)):
        check_least(option, getattr(options, option), least)
    if options.threads is not None:
        torch.set_num_threads(options.threads)
    prepare_device(options.device)  # refuses a missing GPU now: making the data takes minutes
    with data_in_time(options.limit, options.out):
        return _TRAININGS[name](options)
