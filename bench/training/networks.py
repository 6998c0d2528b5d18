"""The trainings of the networks that draw: data of a dataset, the loops of their packages.

Each goes on with the training that is in its folder.
"""

from __future__ import annotations

import hashlib
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar

import torch

from baselines.fused_net.config import FusedNetConfig
from baselines.fused_net.data import FOLDER, fused_set, occupancy_weights
from baselines.fused_net.train import FusedNetTrainer
from baselines.fused_net.weights import PACKAGE as FUSED_NET
from baselines.fused_net.weights import check_meshes
from baselines.occupancy_net import weights as occupancy_net_weights
from baselines.occupancy_net.config import OccupancyNetConfig
from baselines.occupancy_net.train import OccupancyNetTrainer
from baselines.splat_net import weights as splat_net_weights
from baselines.splat_net.config import SplatNetConfig
from baselines.splat_net.losses import OBJECTIVES, FeatureMaps
from baselines.splat_net.network import COLOUR_HEADS, DEFAULT, NETWORKS, Material, NetworkConfig
from baselines.splat_net.start import grey_beside, read_start
from baselines.splat_net.train import SplatNetTrainer
from baselines.upsampler import weights as upsampler_weights
from baselines.upsampler.config import UpsamplerTrainingConfig
from baselines.upsampler.data import upsampler_set
from baselines.upsampler.train import UpsamplerTrainer
from bench.metrics.inception_weights import WeightsUnavailable
from bench.training import efficientnet
from bench.training.options import DEFAULT_OBJECTS
from data_prep.datasets.occupancy_set import occupancy_set
from data_prep.datasets.registry import ProceduralObject, SceneObject, open_dataset
from data_prep.datasets.training_set import (
    SurfaceSet,
    add_surfaces,
    training_clouds,
    training_set,
)
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.progress import log, progress, step_progress
from learning import training_loop
from learning.configuration import TimeLimit
from learning.processes import is_first
from learning.trainer import CooledTrainer, NetworkTrainer
from learning.training_loop import StepReport
from pc2pix.model_config import HALF, LITE, PAPER
from pc2pix.train_autoencoder import AutoencoderTrainer, load_encoder
from pc2pix.train_decoder import DecoderTrainer
from pc2pix.train_gan import GanTrainer
from pc2pix.training_configs import AutoencoderConfig, DecoderConfig, GanConfig
from pc2pix.training_data import AutoencoderData, GanData
from pc2pix.weights import decoder_path, export, export_decoder, load_weights

Config = TypeVar("Config")


def train(name: str, options: Any) -> Path:
    """Train a network with options of `bench.training.options.OPTIONS`; return its file.

    That is the file of exported weights; of the autoencoder it is the checkpoint, and of a decoder
    it stands beside the weights that it belongs to. Beside those of splat-net and fused-net in
    colour stand those in grey; fused-net with no steps returns the folder of its maps.

    Raises BadInput for options that no training can have, before data are made.
    """
    for option, least in (("steps", 0 if name == "fused-net" else 1), ("batch", 1)):
        _check_least(option, getattr(options, option), least)
    if options.threads is not None:
        torch.set_num_threads(options.threads)
    training_loop.prepare_device(options.device)  # data take minutes: refuse before them
    with _data_in_time(options.limit, options.out):
        return _TRAININGS[name](options)


@contextmanager
def _data_in_time(limit: TimeLimit | None, out: Path) -> Iterator[None]:
    """Raise BadInput inside where the time is over before the steps begin: `_train` calls it off.

    As Ctrl-C does it interrupts whatever is done, and what is written stays whole.
    """
    if limit is None:
        yield
        return
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    # again and again: packages that are being imported may swallow an exception
    signal.setitimer(signal.ITIMER_REAL, max(limit.left_s(), 1e-3), 1.0)
    try:
        yield
    except KeyboardInterrupt:
        if limit.left_s() > 0:
            raise
        raise BadInput(
            f"--for {limit.text}: over before the first step, while the data were made; what {out} "
            "has is kept; give more time, or fewer --objects"
        ) from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _autoencoder(options: Any) -> Path:
    sizes = {"encoder": options.encoder, "latent_dim": options.latent_dim}
    model = replace({"lite": LITE, "half": HALF, "paper": PAPER}[options.width], **sizes)
    objects = training_objects(options)
    clouds = training_clouds(objects, **_making())
    config = _config(AutoencoderConfig, options, model=model)
    return _train(AutoencoderTrainer, AutoencoderData(clouds), config, options, objects)


def _gan(options: Any) -> Path:
    start = None if options.start is None else load_weights(options.start)
    encoder_file = ""
    if start is None:
        encoder, encoder_file = load_encoder(options.autoencoder), file_sha256(options.autoencoder)
        model = replace(encoder.config, azimuth=options.azimuth)
    else:
        encoder, model = start.encoder, start.generator.config
    config = _config(GanConfig, options, model=model, start=start.sha256 if start else None)
    objects = training_objects(options)
    views = training_set(objects, options.views, **_making())
    learned, more = (GanData(**vars(views)), encoder), {"start": start, "also": encoder_file}
    checkpoint = _train(GanTrainer, learned, config, options, objects, **more)
    return _exported(checkpoint, options.out / "weights.safetensors", export)


def _splat_net(options: Any) -> Path:
    features = compared_features(options.objective, device=options.device)
    network = _find_network(options.network)
    if network.body == "splat-net":
        network = replace(network, heads=COLOUR_HEADS[options.colours])
    start = read_start(options.start, network, options.seed) if options.start else None
    config = _config(
        SplatNetConfig, options, network=network, start=start.sha256 if start else None
    )
    objects = training_objects(options)
    data = _surfaces(objects, options.views)
    more = {"start": start.network if start else None, "features": features}
    checkpoint = _train(SplatNetTrainer, data, config, options, objects, **more)
    return _export_both(checkpoint, options.out, network, splat_net_weights.PACKAGE)


def _fused_net(options: Any) -> Path:
    check_meshes(options.meshes, "--meshes")
    features = compared_features(options.objective, device=options.device)
    inputs = replace(DEFAULT.inputs, meshes=options.meshes)
    network = replace(DEFAULT, inputs=inputs, heads=COLOUR_HEADS["image"])
    start = read_start(options.start, network, options.seed) if options.start else None
    config = _config(
        FusedNetConfig,
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
    more = {"start": start.network if start else None, "features": features}
    checkpoint = _train(FusedNetTrainer, data, config, options, objects, **more)
    return _export_both(checkpoint, options.out, network, FUSED_NET)


def _occupancy_net(options: Any) -> Path:
    objects = training_objects(options)
    data = occupancy_set(objects, quiet=not is_first())
    config = _config(OccupancyNetConfig, options)
    checkpoint = _train(OccupancyNetTrainer, data, config, options, objects)
    return _exported(checkpoint, options.out / "weights.safetensors", occupancy_net_weights.export)


def _upsampler(options: Any) -> Path:
    objects = training_objects(options)
    if len(objects) < 2:
        raise BadInput("1 object: give at least 2, for one is held out to validate; see --objects")
    data = upsampler_set(objects, quiet=not is_first())
    config = _config(UpsamplerTrainingConfig, options)
    checkpoint = _train(UpsamplerTrainer, data, config, options, objects)
    return _exported(checkpoint, options.out / "weights.safetensors", upsampler_weights.export)


def _decoder(options: Any) -> Path:
    """Train on the procedural train chairs."""
    count = DEFAULT_OBJECTS if options.objects is None else options.objects
    _check_least("objects", count, 1)
    weights = load_weights(options.weights)
    objects = tuple(ProceduralObject("chair", "train", i) for i in range(count))
    data = AutoencoderData(training_clouds(objects, **_making()))
    config = _config(DecoderConfig, options, weights=weights.sha256, model=weights.encoder.config)
    checkpoint = _train(DecoderTrainer, data, config, options, objects, weights=weights)
    return _exported(checkpoint, decoder_path(options.weights), export_decoder)


_OF_IMAGES = ("gan", "splat-net", "fused-net")  # a step's batch; of the others it is of clouds
_TRAININGS = {
    "autoencoder": _autoencoder,
    "gan": _gan,
    "splat-net": _splat_net,
    "fused-net": _fused_net,
    "occupancy-net": _occupancy_net,
    "upsampler": _upsampler,
    "decoder": _decoder,
}


def _train(
    kind: type[NetworkTrainer],
    learned: Any,
    config: Any,
    options: Any,
    objects: Sequence[SceneObject],
    also: str = "",
    **further: Any,
) -> Path:
    """Train and return the checkpoint; show progress on stderr, and how it ended before its end.

    `objects`, and the checksum of what is learned from `also`, name the data on any machine.
    """
    made_of = repr((*(obj.fingerprint() for obj in objects), options.views, also))
    reports: list[StepReport] = []
    if options.limit is not None:
        signal.setitimer(signal.ITIMER_REAL, 0)  # from here on steps watch the clock
    with step_progress(kind.kind, quiet=not is_first()) as show:

        def on_progress(report: StepReport) -> None:
            reports[:] = [report]
            show(report)

        checkpoint = training_loop.train(
            kind,
            learned,
            config,
            options.out,
            device=options.device,
            on_progress=on_progress,
            limit=options.limit,
            source=hashlib.sha256(made_of.encode()).hexdigest(),
            **further,
        )
    if reports and reports[0].step < config.steps:
        log(_ended_early(kind, config, options, reports[0]))
    return checkpoint


def _ended_early(kind: type[NetworkTrainer], config: Any, options: Any, reached: StepReport) -> str:
    """Return the line about a training that its time limit has ended."""
    what = "images" if kind.kind in _OF_IMAGES else "clouds"
    pace = f" ({reached.images_per_s:.1f}/s)" if reached.images_per_s else ""
    seen = f"{reached.images:,} {what}{pace}"
    said = f"{kind.kind}: --for {options.limit.text} ended it after step {reached.step} of "
    said += f"{reached.steps}, {seen}; the same command goes on from {options.out}"
    if issubclass(kind, CooledTrainer) and config.cool_down:
        steps = reached.step + config.cool_down
        said += f"; its learning rate falls over the last {config.cool_down} steps, "
        said += "and has not fallen to the end"
        if steps < config.steps:
            said += f": --steps {steps} ends it with the fall from here"
    return said


def training_objects(options: Any) -> tuple[SceneObject, ...]:
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


def _check_least(option: str, value: int, least: int) -> None:
    if value < least:
        raise BadInput(f"--{option} {value}: must be at least {least}")


def _find_network(name: str) -> NetworkConfig:
    if name not in NETWORKS:
        raise BadInput(f"--network: unknown '{name}'; choose one of {', '.join(NETWORKS)}")
    return NETWORKS[name]


def compared_features(
    objective: str, find: Callable[[], Path] = efficientnet.WEIGHTS.find, device: str = "cpu"
) -> FeatureMaps | None:
    """Return the maps that an objective compares; None where it compares none, or is unknown.

    They are computed on `device`, as `learning.training_loop.train` takes it.

    Raises BadInput where the package with the weights, whose file `find` returns, is absent.
    """
    chosen = OBJECTIVES.get(objective)
    if chosen is None or not chosen.features:
        return None
    try:
        place = training_loop.prepare_device(device)
        return efficientnet.load_efficientnet(find(), place).first_maps
    except WeightsUnavailable as error:
        raise BadInput(
            f"--objective {objective}: {error}; or choose --objective relief, which compares none"
        ) from error


def _surfaces(objects: Sequence[SceneObject], views: int) -> SurfaceSet:
    seen = training_set(objects, views, **_making())
    return add_surfaces(seen, objects, quiet=not is_first())


def _making() -> dict[str, Any]:
    """Return how data are made: by as many processes as PyTorch has threads, which then rest."""
    return {"quiet": not is_first(), "workers": torch.get_num_threads()}


def _exported(checkpoint: Path, weights: Path, write: Callable[[Path, Path], str]) -> Path:
    if is_first():
        write(checkpoint, weights)
    return weights


def _export_both(checkpoint: Path, out: Path, network: NetworkConfig, package: str) -> Path:
    """Write the weights in colour, and in grey beside them; return the file in colour."""
    weights = out / "weights.safetensors"
    if is_first():
        colour: Material = "albedo" if "albedo" in network.heads else "colour"
        splat_net_weights.export(checkpoint, weights, colour, package)
        splat_net_weights.export(checkpoint, grey_beside(weights), "grey", package)
    return weights


def _config(kind: Callable[..., Config], options: Any, **further: Any) -> Config:
    """Return a configuration of `further` fields and of those that it shares with the options."""
    names = {field.name for field in fields(kind)}  # type: ignore[arg-type]
    shared = {name: value for name, value in vars(options).items() if name in names}
    return kind(**shared | further)
