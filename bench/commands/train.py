"""The trainings behind `bench train`: data from a dataset, the loops from their packages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import typer

from bench.commands.options import (
    DEVICE,
    SETTINGS,
    Device,
    Group,
    OptionSpec,
    names,
    options_from_dataclass,
)
from data_prep.datasets.registry import ProceduralObject, SceneObject, open_dataset
from data_prep.datasets.training_set import add_surfaces, training_clouds, training_set
from data_prep.failures import BadInput
from data_prep.progress import progress

if TYPE_CHECKING:
    from baselines.splat_net.network import NetworkConfig
    from learning.training_loop import OnProgress

DEFAULT_OBJECTS = 1500
Config = TypeVar("Config")


@dataclass(frozen=True, kw_only=True)
class TrainingOptions:
    """What all trainings have in common; `steps` counts from the beginning, not from a resume.

    classes  to train on; empty: all that the dataset has
    objects  of each class; None: DEFAULT_OBJECTS, or all of a dataset with an end
    threads  CPU threads of torch; None: its own choice
    """

    dataset: str = "procedural"
    classes: tuple[str, ...] = ("chair",)
    objects: int | None = None
    steps: int
    batch: int = 32
    augment: bool = False
    precision: Literal["float32", "bfloat16"] = "float32"
    device: str = "cpu"
    seed: int = 0
    threads: int | None = None
    out: Path


@dataclass(frozen=True, kw_only=True)
class AutoencoderOptions(TrainingOptions):
    """The point-cloud autoencoder; see `pc2pix.train_autoencoder.AutoencoderConfig`."""

    width: Literal["lite", "paper"] = "lite"
    encoder: Literal["paper", "pointnet"] = "paper"
    latent_dim: int = 32
    steps: int = 10_000
    learning_rate: float = 1e-4
    out: Path = Path("training/autoencoder")


@dataclass(frozen=True, kw_only=True)
class GanOptions(TrainingOptions):
    """The GAN on an autoencoder, which gives its networks; see `pc2pix.train_gan.GanConfig`."""

    autoencoder: Path = Path("training/autoencoder/checkpoint.safetensors")
    views: int = 8
    objective: str = "acgan-code"
    azimuth: Literal["scalar", "sine-cosine"] = "scalar"
    steps: int = 20_000
    warm_up: int = 0
    generator_lr: float = 1e-4
    out: Path = Path("training/gan")


@dataclass(frozen=True, kw_only=True)
class SplatNetOptions(TrainingOptions):
    """splat-net; see `baselines.splat_net.train.SplatNetConfig`.

    network  a key of `baselines.splat_net.network.NETWORKS`
    without  inputs to leave out, see `do_without`
    start    weights to start from, see `baselines.splat_net.start.read_start`; None: random ones
    """

    network: str = "default"
    views: int = 8
    start: str | None = None
    objective: str = "l1"
    without: tuple[str, ...] = ()
    augment: bool = True
    steps: int = 8000
    warm_up: int = 0
    cool_down: int = 2000
    batch: int = 24
    learning_rate: float = 2e-3
    out: Path = Path("training/splat-net")


@dataclass(frozen=True, kw_only=True)
class DecoderOptions(TrainingOptions):
    """The decoder of trained weights, on the procedural train chairs."""

    weights: str = "chair"
    steps: int = 3000
    out: Path = Path("training/decoder")


def train_autoencoder(options: AutoencoderOptions) -> Path:
    """Train the point-cloud autoencoder; returns its checkpoint. Resumes what is in `out`."""
    from learning.processes import is_first
    from pc2pix.model import LITE, PAPER
    from pc2pix.train_autoencoder import AutoencoderConfig, AutoencoderData
    from pc2pix.train_autoencoder import train_autoencoder as train

    _set_threads(options.threads)
    clouds = training_clouds(training_objects(options), quiet=not is_first())
    model = replace(
        {"lite": LITE, "paper": PAPER}[options.width],
        encoder=options.encoder,
        latent_dim=options.latent_dim,
    )
    config = _config(AutoencoderConfig, options, model=model)
    data = AutoencoderData(clouds)
    with _progress("autoencoder") as show:
        return train(data, config, options.out, device=options.device, on_progress=show)


def train_gan(options: GanOptions) -> Path:
    """Train the rendering GAN on a trained autoencoder; returns the exported weights file."""
    from learning.processes import is_first
    from pc2pix.train_autoencoder import load_encoder
    from pc2pix.train_gan import GanConfig, GanData
    from pc2pix.train_gan import train_gan as train
    from pc2pix.weights import export

    _set_threads(options.threads)
    encoder = load_encoder(options.autoencoder)
    made = training_set(training_objects(options), options.views, quiet=not is_first())
    config = _config(GanConfig, options, model=replace(encoder.config, azimuth=options.azimuth))
    data = GanData(made.images, made.azimuth_deg, made.elevation_deg, made.clouds)
    with _progress("gan") as show:
        checkpoint = train(
            data, encoder, config, options.out, device=options.device, on_progress=show
        )
    weights = options.out / "weights.safetensors"
    if is_first():
        export(checkpoint, weights)
    return weights


def train_splat_net(options: SplatNetOptions) -> Path:
    """Train splat-net; returns the exported weights file, `weights-grey` stands beside it."""
    from baselines.splat_net.network import NETWORKS
    from baselines.splat_net.start import grey_beside, read_start
    from baselines.splat_net.train import SplatNetConfig, train_splat_net
    from baselines.splat_net.weights import export
    from learning.processes import is_first

    _set_threads(options.threads)
    if options.network not in NETWORKS:
        raise BadInput(
            f"--network: unknown '{options.network}'; choose one of {', '.join(NETWORKS)}"
        )
    network = do_without(NETWORKS[options.network], options.without)
    start = None
    if options.start is not None:
        start = read_start(options.start, network, options.seed)
    config = _config(
        SplatNetConfig, options, network=network, start=start.sha256 if start else None
    )
    objects = training_objects(options)
    seen = training_set(objects, options.views, quiet=not is_first())
    with progress("silhouettes", len(objects), quiet=not is_first()) as advance:
        data = add_surfaces(seen, objects, lambda: advance(0))
    with _progress("splat-net") as show:
        checkpoint = train_splat_net(
            data,
            config,
            options.out,
            start=start.network if start else None,
            device=options.device,
            on_progress=show,
        )
    weights = options.out / "weights.safetensors"
    if is_first():
        export(checkpoint, weights, "colour")
        export(checkpoint, grey_beside(weights), "grey")
    return weights


def train_decoder(options: DecoderOptions) -> Path:
    """Fit a decoder to the encoder of `weights`; returns its file, which stands beside them.

    The data are the procedural train chairs. What is in `out` is continued. Raises BadInput where
    the weights cannot be used or a number is not positive.
    """
    count = DEFAULT_OBJECTS if options.objects is None else options.objects
    for name, value in (("objects", count), ("steps", options.steps), ("batch", options.batch)):
        if value < 1:
            raise BadInput(f"--{name} {value}: must be at least 1")
    from learning.processes import is_first
    from pc2pix.train_autoencoder import AutoencoderData
    from pc2pix.train_decoder import DecoderConfig
    from pc2pix.train_decoder import train_decoder as train
    from pc2pix.weights import decoder_path, export_decoder, load_weights

    _set_threads(options.threads)
    weights = load_weights(options.weights)
    objects = tuple(ProceduralObject("chair", "train", i) for i in range(count))
    data = AutoencoderData(training_clouds(objects, quiet=not is_first()))
    config = _config(DecoderConfig, options, weights=weights.sha256, model=weights.encoder.config)
    with _progress("decoder") as show:
        checkpoint = train(
            data, weights, config, options.out, device=options.device, on_progress=show
        )
    path = decoder_path(options.weights)
    if is_first():
        export_decoder(checkpoint, path)
    return path


def _config(kind: Callable[..., Config], options: TrainingOptions, **own: Any) -> Config:
    """The configuration: the fields that it shares with the options, and its `own`."""
    named = {field.name for field in fields(kind)}  # type: ignore[arg-type]
    shared = {name: value for name, value in vars(options).items() if name in named}
    return kind(**shared | own)


def _progress(title: str) -> AbstractContextManager[OnProgress]:
    """On standard error, by the first of several processes."""
    from learning.processes import is_first
    from learning.progress import training_progress

    return training_progress(title, quiet=not is_first())


def do_without(network: NetworkConfig, parts: Sequence[str]) -> NetworkConfig:
    """The network without these parts. Raises BadInput for one that there is not."""
    inputs = network.inputs
    for part in parts:
        if part == "discs":
            inputs = replace(inputs, windows=inputs.windows[:1])
        elif part in ("normals", "density", "flattened", "far", "noise"):
            inputs = replace(inputs, **{part: False})
        else:
            raise BadInput(
                f"--without {part}: there are normals, density, flattened, far, noise and discs "
                "(all but the narrowest)"
            )
    return replace(network, inputs=inputs)


def training_objects(options: TrainingOptions) -> tuple[SceneObject, ...]:
    """The objects to train on, class by class. Raises BadInput where there are none."""
    dataset = open_dataset(options.dataset)
    objects = tuple(
        obj
        for name in options.classes or dataset.classes or ("",)  # a folder may have no classes
        for obj in dataset.objects(name, options.objects, DEFAULT_OBJECTS, "train")
    )
    if not objects:
        raise BadInput(f"--objects {options.objects}: must be at least 1")
    return objects


def _set_threads(threads: int | None) -> None:
    if threads is not None:
        import torch

        torch.set_num_threads(threads)


app = typer.Typer(cls=Group, help="Train the networks.", **SETTINGS)
Seed = Annotated[int, typer.Option(help="Seed of initial weights and batches.")]
OUT = "Folder of the training; one that is there is continued."
Folder = Annotated[Path, typer.Option(help=OUT)]

TRAIN_OPTIONS: dict[str, str | OptionSpec] = {
    "out": OUT,
    "dataset": "Dataset as of 'bench run'; its train split is used.",
    "classes": OptionSpec(
        "Classes to train on, comma-separated, or all.",
        flag="--class",
        kind=str,
        convert=lambda text: () if text == "all" else names(text) or (),
        default="chair",
    ),
    "objects": "Objects of each class. Default: 1500 procedural ones, or all of a folder.",
    "augment": "Also train on clouds with noise and with fewer points.",
    "steps": "Steps in total, with those done before a resume.",
    "batch": "Images or clouds in a step.",
    "precision": "Number format of the training step; weights are float32.",
    "device": OptionSpec(DEVICE, kind=Device),
    "seed": "Seed of initial weights and batches.",
    "threads": "CPU threads. Default: PyTorch's choice.",
}
VIEWS = "Images of each object."


@app.command("autoencoder")
@options_from_dataclass(
    AutoencoderOptions,
    TRAIN_OPTIONS
    | {
        "width": "Channels: as in the paper, or a quarter of them (lite).",
        "encoder": "The paper's, or one that does not depend on the order of points.",
        "latent_dim": OptionSpec("Length of the code, in numbers.", flag="--latent"),
        "learning_rate": "Learning rate of RMSprop.",
    },
)
def autoencoder_command(options: AutoencoderOptions) -> None:
    """The point-cloud autoencoder (paper, section 3.1)."""
    _print_once(train_autoencoder(options))


@app.command("gan")
@options_from_dataclass(
    GanOptions,
    {"autoencoder": "Checkpoint of the trained autoencoder."}
    | TRAIN_OPTIONS
    | {
        "views": VIEWS,
        "objective": "Loss: acgan-code, acgan-paper or paired; see docs/training.md.",
        "azimuth": "Input of the azimuth: one number, as in the paper, or sine and cosine.",
        "warm_up": "Steps at the start without the discriminator (paired only).",
        "generator_lr": "Learning rate of Adam.",
    },
)
def gan_command(options: GanOptions) -> None:
    """The rendering GAN (paper, section 3.2), on a trained autoencoder."""
    _print_once(train_gan(options))


@app.command("splat-net")
@options_from_dataclass(
    SplatNetOptions,
    TRAIN_OPTIONS
    | {
        "augment": "Train on clouds with noise and with fewer points.",
        "network": "Which network: tiny, default, large, depth (the nearest depth alone) or "
        "points2pix.",
        "views": VIEWS,
        "start": "Weights to start from: a bundled name, or a file with the grey one beside. "
        "Default: random weights.",
        "objective": "Loss: l1, l1-patch or pix2pix; see docs/training.md.",
        "without": OptionSpec(
            "Inputs to leave out, comma-separated: normals, density, flattened, far, discs. "
            "Default: none.",
            convert=lambda text: names(text) or (),
            default=None,
        ),
        "warm_up": "Steps at the start without the patch discriminator (l1-patch only).",
        "cool_down": "Steps at the end over which the learning rate falls to zero.",
        "learning_rate": "Learning rate of Adam.",
    },
)
def splat_net_command(options: SplatNetOptions) -> None:
    """The U-Net on projected points: weights in colour and in grey."""
    _print_once(train_splat_net(options))


@app.command("decoder")
@options_from_dataclass(
    DecoderOptions,
    {"weights": "Weights of the encoder: a bundled name, or a file. The decoder is put beside it."}
    | TRAIN_OPTIONS,
    leave_out=("dataset", "classes", "augment"),
)
def decoder_command(options: DecoderOptions) -> None:
    """A decoder from codes to clouds, for the suite latent."""
    _print_once(train_decoder(options))


@app.command("views")
def train_views(
    objects: Annotated[int, typer.Option(help="Objects of each class.")] = 500,
    views: Annotated[int, typer.Option(help=VIEWS)] = 8,
    epochs: Annotated[int, typer.Option(help="Passes over all images.")] = 12,
    seed: Seed = 0,
    out: Folder = Path("training/views"),
) -> None:
    """The network behind fd-views. Replaces the bundled weights; all golden values change."""
    from bench.training.views import train_views as train

    print(train(objects, views, epochs, seed, folder=out).to_text())


@app.command("constant")
def train_constant(
    objects: Annotated[int, typer.Option(help="Procedural chairs to train on.")] = 1500,
    views: Annotated[int, typer.Option(help=VIEWS)] = 8,
    steps: Annotated[int, typer.Option(help="Steps, of 64 images each.")] = 400,
    seed: Seed = 0,
) -> None:
    """The best constant image. Replaces the bundled one; its golden values change."""
    from bench.training.constant import train_constant as train

    print(train(objects, views, steps, seed))


@app.command("judge")
def train_judge(
    objects: Annotated[int, typer.Option(help="Procedural chairs to train on.")] = 1500,
    views: Annotated[int, typer.Option(help=VIEWS)] = 16,
    steps: Annotated[int, typer.Option(help="Steps, of 96 images each.")] = 3000,
    seed: Seed = 0,
    out: Folder = Path("training/judge"),
) -> None:
    """The judge of view and shape. Replaces the bundled weights; what it measures changes."""
    from bench.training.judge import train_judge as train

    for name, scores in train(objects, views, steps, seed, folder=out).items():
        print(f"{name}: {scores}")


def _print_once(path: Path) -> None:
    """Print what a training made, not by every process that took part."""
    from learning.processes import is_first

    if is_first():
        print(path)
