"""Trainings of pc2pix: its autoencoder, its GAN, and a decoder for the suite `latent`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from bench.training.options import DEFAULT_OBJECTS
from bench.training.session import (
    check_least,
    configuration,
    data_processes,
    exported,
    open_training_objects,
    run_training,
)
from data_prep.datasets.registry import ProceduralObject
from data_prep.datasets.training_set import training_clouds, training_set
from data_prep.files.checksums import file_sha256
from pc2pix.model_config import HALF, LITE, PAPER
from pc2pix.train_autoencoder import AutoencoderTrainer, load_encoder
from pc2pix.train_decoder import DecoderTrainer
from pc2pix.train_gan import GanTrainer
from pc2pix.training_configs import AutoencoderConfig, DecoderConfig, GanConfig
from pc2pix.training_data import AutoencoderData, GanData
from pc2pix.weights import decoder_path, export, export_decoder, load_weights


def train_autoencoder(options: Any) -> Path:
    """Train the autoencoder of pc2pix and return its checkpoint."""
    sizes = {"encoder": options.encoder, "latent_dim": options.latent_dim}
    model = replace({"lite": LITE, "half": HALF, "paper": PAPER}[options.width], **sizes)
    objects = open_training_objects(options)
    clouds = training_clouds(objects, **data_processes())
    config = configuration(AutoencoderConfig, options, model=model)
    return run_training(AutoencoderTrainer, AutoencoderData(clouds), config, options, objects)


def train_gan(options: Any) -> Path:
    """Train the encoder and generator of pc2pix and return the file of their weights."""
    start = None if options.start is None else load_weights(options.start)
    encoder_file = ""
    if start is None:
        encoder, encoder_file = load_encoder(options.autoencoder), file_sha256(options.autoencoder)
        model = replace(encoder.config, azimuth=options.azimuth)
    else:
        encoder, model = start.encoder, start.generator.config
    config = configuration(GanConfig, options, model=model, start=start.sha256 if start else None)
    objects = open_training_objects(options)
    views = training_set(objects, options.views, **data_processes())
    learned, more = (GanData(**vars(views)), encoder), {"start": start, "also": encoder_file}
    checkpoint = run_training(GanTrainer, learned, config, options, objects, **more)
    return exported(checkpoint, options.out / "weights.safetensors", export)


def train_decoder(options: Any) -> Path:
    """Train a decoder of clouds for the codes of pc2pix's weights, and return its file.

    The file stands beside those weights. The decoder learns from the procedural chairs of the
    split `train`.
    """
    count = DEFAULT_OBJECTS if options.objects is None else options.objects
    check_least("objects", count, 1)
    weights = load_weights(options.weights)
    objects = tuple(ProceduralObject("chair", "train", i) for i in range(count))
    data = AutoencoderData(training_clouds(objects, **data_processes()))
    config = configuration(
        DecoderConfig, options, weights=weights.sha256, model=weights.encoder.config
    )
    checkpoint = run_training(DecoderTrainer, data, config, options, objects, weights=weights)
    return exported(checkpoint, decoder_path(options.weights), export_decoder)
