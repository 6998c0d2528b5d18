"""The trainings of the networks that draw: data of a dataset, the loops of their packages.

Each goes on with the training that is in its folder.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar

import torch

from baselines.fused_net import train as fused_net
from baselines.fused_net.data import FOLDER, fused_set, occupancy_weights
from baselines.fused_net.weights import KIND as FUSED_NET
from baselines.fused_net.weights import check_meshes
from baselines.occupancy_net import train as occupancy_net
from baselines.occupancy_net import weights as occupancy_net_weights
from baselines.splat_net import train as splat_net
from baselines.splat_net import weights as splat_net_weights
from baselines.splat_net.losses import OBJECTIVES, FeatureMaps
from baselines.splat_net.network import COLOUR_HEADS, NETWORKS, Material, NetworkConfig
from baselines.splat_net.start import grey_beside, read_start
from bench.metrics.inception_weights import WeightsUnavailable
from bench.training import efficientnet
from bench.training.options import (
    DEFAULT_OBJECTS,
    AutoencoderOptions,
    DecoderOptions,
    FusedNetOptions,
    GanOptions,
    OccupancyNetOptions,
    SplatNetOptions,
    TrainingOptions,
)
from data_prep.datasets.occupancy_set import occupancy_set
from data_prep.datasets.registry import ProceduralObject, SceneObject, open_dataset
from data_prep.datasets.training_set import (
    SurfaceSet,
    add_surfaces,
    training_clouds,
    training_set,
)
from data_prep.failures import BadInput
from data_prep.progress import progress
from learning.processes import is_first
from learning.progress import training_progress
from learning.training_loop import OnProgress
from pc2pix import train_autoencoder as autoencoder
from pc2pix import train_decoder as decoder
from pc2pix import train_gan as gan
from pc2pix.model import LITE, PAPER
from pc2pix.weights import decoder_path, export, export_decoder, load_weights

Config = TypeVar("Config")


def train_autoencoder(options: AutoencoderOptions) -> Path:
    """Train the point-cloud autoencoder; return its checkpoint."""
    _set_threads(options)
    clouds = training_clouds(training_objects(options), quiet=not is_first())
    model = replace(
        {"lite": LITE, "paper": PAPER}[options.width],
        encoder=options.encoder,
        latent_dim=options.latent_dim,
    )
    config = _config(autoencoder.AutoencoderConfig, options, model=model)
    data = autoencoder.AutoencoderData(clouds)
    with _progress("autoencoder") as show:
        return autoencoder.train_autoencoder(
            data, config, options.out, device=options.device, on_progress=show
        )


def train_gan(options: GanOptions) -> Path:
    """Train the rendering GAN on a trained autoencoder; return the exported weights file."""
    _set_threads(options)
    start = None if options.start is None else load_weights(options.start)
    if start is None:
        encoder = autoencoder.load_encoder(options.autoencoder)
        model = replace(encoder.config, azimuth=options.azimuth)
    else:
        encoder, model = start.encoder, start.generator.config
    config = _config(gan.GanConfig, options, model=model, start=start.sha256 if start else None)
    views = training_set(training_objects(options), options.views, quiet=not is_first())
    data = gan.GanData(views.images, views.azimuth_deg, views.elevation_deg, views.clouds)
    with _progress("gan") as show:
        checkpoint = gan.train_gan(
            data,
            encoder,
            config,
            options.out,
            start=start,
            device=options.device,
            on_progress=show,
        )
    weights = options.out / "weights.safetensors"
    if is_first():
        export(checkpoint, weights)
    return weights


def train_splat_net(options: SplatNetOptions) -> Path:
    """Train splat-net; return the exported weights file, beside which `weights-grey` stands."""
    _set_threads(options)
    features = compared_features(options.objective)
    network = _find_network(options.network)
    if network.body == "splat-net":
        network = replace(network, heads=COLOUR_HEADS[options.colours])
    start = read_start(options.start, network, options.seed) if options.start else None
    config = _config(
        splat_net.SplatNetConfig, options, network=network, start=start.sha256 if start else None
    )
    data = _surfaces(training_objects(options), options.views)
    with _progress("splat-net") as show:
        checkpoint = splat_net.train_splat_net(
            data,
            config,
            options.out,
            start=start.network if start else None,
            features=features,
            device=options.device,
            on_progress=show,
        )
    return _export_both(checkpoint, options.out, network, splat_net_weights.KIND)


def train_fused_net(options: FusedNetOptions) -> Path:
    """Train fused-net; return the exported weights file, beside which `weights-grey` stands.

    With no steps return the folder of the maps, which a later start takes from there.
    """
    _set_threads(options)
    check_meshes(options.meshes, "--meshes")
    features = compared_features(options.objective)
    network = _find_network(options.network)
    inputs = replace(network.inputs, meshes=options.meshes)
    network = replace(network, inputs=inputs, heads=COLOUR_HEADS["image"])
    start = read_start(options.start, network, options.seed) if options.start else None
    config = _config(
        fused_net.FusedNetConfig,
        options,
        network=network,
        start=start.sha256 if start else None,
        occupancy=occupancy_weights(options.meshes),
    )
    objects = training_objects(options)
    surfaces = _surfaces(objects, options.views)
    with progress("meshes", len(objects), quiet=not is_first()) as advance:
        data = fused_set(
            surfaces,
            objects,
            options.meshes,
            options.out,
            augment=options.augment,
            on_progress=lambda: advance(0),
        )
    if not options.steps:
        return options.out / FOLDER
    with _progress("fused-net") as show:
        checkpoint = fused_net.train_fused_net(
            data,
            config,
            options.out,
            start=start.network if start else None,
            features=features,
            device=options.device,
            on_progress=show,
        )
    return _export_both(checkpoint, options.out, network, FUSED_NET)


def train_occupancy_net(options: OccupancyNetOptions) -> Path:
    """Train occupancy-net; return the exported weights file."""
    _set_threads(options)
    data = occupancy_set(training_objects(options), quiet=not is_first())
    config = _config(occupancy_net.OccupancyNetConfig, options)
    with _progress("occupancy-net") as show:
        checkpoint = occupancy_net.train_occupancy_net(
            data, config, options.out, device=options.device, on_progress=show
        )
    weights = options.out / "weights.safetensors"
    if is_first():
        occupancy_net_weights.export(checkpoint, weights)
    return weights


def train_decoder(options: DecoderOptions) -> Path:
    """Train a decoder for the encoder of `weights`; return its file, which stands beside them.

    The data are the procedural train chairs. Raises BadInput where the weights cannot be used or a
    number is not positive.
    """
    count = DEFAULT_OBJECTS if options.objects is None else options.objects
    for name, value in (("objects", count), ("steps", options.steps), ("batch", options.batch)):
        if value < 1:
            raise BadInput(f"--{name} {value}: must be at least 1")
    _set_threads(options)
    weights = load_weights(options.weights)
    objects = tuple(ProceduralObject("chair", "train", i) for i in range(count))
    data = autoencoder.AutoencoderData(training_clouds(objects, quiet=not is_first()))
    config = _config(
        decoder.DecoderConfig, options, weights=weights.sha256, model=weights.encoder.config
    )
    with _progress("decoder") as show:
        checkpoint = decoder.train_decoder(
            data, weights, config, options.out, device=options.device, on_progress=show
        )
    path = decoder_path(options.weights)
    if is_first():
        export_decoder(checkpoint, path)
    return path


def training_objects(options: TrainingOptions) -> tuple[SceneObject, ...]:
    """Return the objects to train on, class by class. Raises BadInput where there are none."""
    dataset = open_dataset(options.dataset)
    objects = tuple(
        obj
        for name in options.classes or dataset.classes or ("",)  # a folder may have no classes
        for obj in dataset.objects(name, options.objects, DEFAULT_OBJECTS, "train")
    )
    if not objects:
        raise BadInput(f"--objects {options.objects}: must be at least 1")
    return objects


def _find_network(name: str) -> NetworkConfig:
    if name not in NETWORKS:
        raise BadInput(f"--network: unknown '{name}'; choose one of {', '.join(NETWORKS)}")
    return NETWORKS[name]


def compared_features(
    objective: str, find: Callable[[], Path] = efficientnet.WEIGHTS.find
) -> FeatureMaps | None:
    """Return the maps that an objective compares; None where it compares none, or is unknown.

    Raises BadInput where the package with the weights, whose file `find` returns, is absent.
    """
    chosen = OBJECTIVES.get(objective)
    if chosen is None or not chosen.features:
        return None
    try:
        return efficientnet.load_efficientnet(find()).first_maps
    except WeightsUnavailable as error:
        raise BadInput(
            f"--objective {objective}: {error}; or choose --objective relief, which compares none"
        ) from error


def _surfaces(objects: Sequence[SceneObject], views: int) -> SurfaceSet:
    """Return clouds and images of objects; show progress on stderr."""
    seen = training_set(objects, views, quiet=not is_first())
    with progress("silhouettes", len(objects), quiet=not is_first()) as advance:
        return add_surfaces(seen, objects, lambda: advance(0))


def _export_both(checkpoint: Path, out: Path, network: NetworkConfig, kind: str) -> Path:
    """Write the weights in colour, and in grey beside them; return the file in colour."""
    weights = out / "weights.safetensors"
    if is_first():
        colour: Material = "albedo" if "albedo" in network.heads else "colour"
        splat_net_weights.export(checkpoint, weights, colour, kind)
        splat_net_weights.export(checkpoint, grey_beside(weights), "grey", kind)
    return weights


def _config(kind: Callable[..., Config], options: TrainingOptions, **further: Any) -> Config:
    """Return a configuration of `further` fields and of those that it shares with the options."""
    names = {field.name for field in fields(kind)}  # type: ignore[arg-type]
    shared = {name: value for name, value in vars(options).items() if name in names}
    return kind(**shared | further)


def _progress(title: str) -> AbstractContextManager[OnProgress]:
    return training_progress(title, quiet=not is_first())


def _set_threads(options: TrainingOptions) -> None:
    if options.threads is not None:
        torch.set_num_threads(options.threads)
