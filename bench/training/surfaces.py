"""Trainings of the networks that make surfaces: occupancy-net and the up-sampler."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from baselines.occupancy_net import weights as occupancy_net_weights
from baselines.occupancy_net.config import OccupancyNetConfig
from baselines.occupancy_net.train import OccupancyNetTrainer
from baselines.upsampler import weights as upsampler_weights
from baselines.upsampler.config import UpsamplerTrainingConfig
from baselines.upsampler.data import upsampler_set
from baselines.upsampler.train import UpsamplerTrainer
from bench.training.session import (
    configuration,
    exported,
    open_training_objects,
    run_training,
)
from data_prep.datasets.occupancy_set import occupancy_set
from data_prep.failures import BadInput
from learning.processes import is_first


def train_occupancy_net(options: Any) -> Path:
    """Train occupancy-net and return the file of its weights."""
    objects = open_training_objects(options)
    data = occupancy_set(objects, quiet=not is_first())
    config = configuration(OccupancyNetConfig, options)
    checkpoint = run_training(OccupancyNetTrainer, data, config, options, objects)
    return exported(checkpoint, options.out / "weights.safetensors", occupancy_net_weights.export)


def train_upsampler(options: Any) -> Path:
    """Train the up-sampler and return the file of its weights."""
    objects = open_training_objects(options)
    if len(objects) < 2:
        raise BadInput(
            "1 object: at least 2 are needed, as one is held out for validation; give more with "
            "--objects"
        )
    data = upsampler_set(objects, quiet=not is_first())
    config = configuration(UpsamplerTrainingConfig, options)
    checkpoint = run_training(UpsamplerTrainer, data, config, options, objects)
    return exported(checkpoint, options.out / "weights.safetensors", upsampler_weights.export)
