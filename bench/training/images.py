"""Trainings of the networks that draw projected points: splat-net, points2pix and fused-net."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from baselines.fused_net.config import FusedNetConfig
from baselines.fused_net.data import FOLDER, fused_set, mesh_weights
from baselines.fused_net.train import FusedNetTrainer
from baselines.fused_net.weights import MESHES
from baselines.fused_net.weights import PACKAGE as FUSED_NET
from baselines.splat_net import weights as splat_net_weights
from baselines.splat_net.config import SplatNetConfig
from baselines.splat_net.losses import OBJECTIVES, FeatureMaps
from baselines.splat_net.network import COLOUR_HEADS, DEFAULT, NETWORKS, Material, NetworkConfig
from baselines.splat_net.start import grey_beside, read_start
from baselines.splat_net.train import SplatNetTrainer
from bench.metrics.inception_weights import WeightsUnavailable
from bench.training import efficientnet
from bench.training.session import (
    configuration,
    data_processes,
    open_training_objects,
    run_training,
)
from data_prep.datasets.objects import TurnedObject
from data_prep.datasets.registry import SceneObject
from data_prep.datasets.training_set import SurfaceSet, add_surfaces, training_set
from data_prep.failures import BadInput
from data_prep.progress import progress
from learning import training_loop
from learning.processes import is_first


def train_splat_net(options: Any) -> Path:
    """Train a network of baselines.splat_net and return the file of its weights in colour.

    Weights that draw in grey are written beside it.
    """
    features = compared_features(options.objective, device=options.device)
    network = _find_network(options.network)
    if network.body == "splat-net":
        network = replace(network, heads=COLOUR_HEADS[options.colours])
    start = read_start(options.start, network, options.seed) if options.start else None
    config = configuration(
        SplatNetConfig, options, network=network, start=start.sha256 if start else None
    )
    objects = open_training_objects(options)
    data = _surfaces(objects, options.views)
    more = {"start": start.network if start else None, "features": features}
    checkpoint = run_training(SplatNetTrainer, data, config, options, objects, **more)
    return _export_both(checkpoint, options.out, network, splat_net_weights.PACKAGE)


def train_fused_net(options: Any) -> Path:
    """Train fused-net and return the file of its weights in colour; see `train_splat_net`.

    With 0 steps nothing is trained: the maps that it would learn from are made, and their folder is
    returned.
    """
    features = compared_features(options.objective, device=options.device)
    inputs = replace(DEFAULT.inputs, meshes=MESHES)
    network = replace(DEFAULT, inputs=inputs, heads=COLOUR_HEADS["image"])
    start = read_start(options.start, network, options.seed) if options.start else None
    config = configuration(
        FusedNetConfig,
        options,
        network=network,
        start=start.sha256 if start else None,
        mesh_weights=mesh_weights(),
    )
    objects = _some_turned(open_training_objects(options), options.turned)
    surfaces = _surfaces(objects, options.views)
    with progress("meshes", len(objects), quiet=not is_first()) as advance:
        data = fused_set(
            surfaces,
            objects,
            options.out,
            augment=options.augment,
            on_progress=lambda: advance(0),
        )
    if not options.steps:
        return options.out / FOLDER
    more = {"start": start.network if start else None, "features": features}
    checkpoint = run_training(FusedNetTrainer, data, config, options, objects, **more)
    return _export_both(checkpoint, options.out, network, FUSED_NET)


def _some_turned(objects: Sequence[SceneObject], share: float) -> tuple[SceneObject, ...]:
    """Return the objects; so large a share of them, spread evenly, is turned at random."""
    turned = [int((i + 1) * share) > int(i * share) for i in range(len(objects))]
    return tuple(
        TurnedObject(obj) if turn else obj for obj, turn in zip(objects, turned, strict=True)
    )


def _find_network(name: str) -> NetworkConfig:
    if name not in NETWORKS:
        raise BadInput(f"--network: unknown '{name}'; choose one of {', '.join(NETWORKS)}")
    return NETWORKS[name]


def compared_features(
    objective: str, find: Callable[[], Path] = efficientnet.WEIGHTS.find, device: str = "cpu"
) -> FeatureMaps | None:
    """Return the function that computes the feature maps which an objective compares.

    None where the objective compares no maps, or is unknown.

    find    the function that returns the file of the network's weights
    device  where the maps are computed, as `learning.training_loop.train` takes it

    Raises BadInput where the package with the weights is not installed.
    """
    chosen = OBJECTIVES.get(objective)
    if chosen is None or not chosen.features:
        return None
    try:
        place = training_loop.prepare_device(device)
        return efficientnet.load_efficientnet(find(), place).first_maps
    except WeightsUnavailable as error:
        raise BadInput(
            f"--objective {objective}: {error}; or choose --objective relief, which needs no such "
            "weights"
        ) from error


def _surfaces(objects: Sequence[SceneObject], views: int) -> SurfaceSet:
    seen = training_set(objects, views, **data_processes())
    return add_surfaces(seen, objects, quiet=not is_first())


def _export_both(checkpoint: Path, out: Path, network: NetworkConfig, package: str) -> Path:
    """Write weights that draw in colour, and beside them weights that draw in grey.

    Return the file of the weights in colour.
    """
    weights = out / "weights.safetensors"
    if is_first():
        colour: Material = "albedo" if "albedo" in network.heads else "colour"
        splat_net_weights.export(checkpoint, weights, colour, package)
        splat_net_weights.export(checkpoint, grey_beside(weights), "grey", package)
    return weights
