"""The trainings behind `bench train`: data from a dataset, the loops from their packages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import typer

from bench.commands.options import Device, Stated, names, takes
from data_prep.datasets import ProceduralObject, SceneObject, open_dataset
from data_prep.failures import BadInput
from data_prep.progress import progress
from data_prep.training_set import add_surfaces, training_clouds, training_set

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

    size     a key of `baselines.splat_net.network.SIZES`
    without  inputs to leave out, see `do_without`
    start    weights to start from, see `baselines.splat_net.start.read_start`; None: random ones
    """

    size: str = "default"
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
    from baselines.splat_net.network import SIZES
    from baselines.splat_net.start import grey_beside, read_start
    from baselines.splat_net.train import SplatNetConfig, train_splat_net
    from baselines.splat_net.weights import export
    from learning.processes import is_first

    _set_threads(options.threads)
    if options.size not in SIZES:
        raise BadInput(f"--size: unknown '{options.size}'; choose one of {', '.join(SIZES)}")
    network = do_without(SIZES[options.size], options.without)
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
        elif part in ("normals", "density", "flattened", "far"):
            inputs = replace(inputs, **{part: False})
        else:
            raise BadInput(
                f"--without {part}: there are normals, density, flattened, far and discs (all but "
                "the narrowest)"
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
        raise BadInput(f"--objects {options.objects}: training needs at least one object")
    return objects


def _set_threads(threads: int | None) -> None:
    if threads is not None:
        import torch

        torch.set_num_threads(threads)


app = typer.Typer(help="Train the networks.", no_args_is_help=True, rich_markup_mode=None)
Seed = Annotated[int, typer.Option(help="Seed of initial weights and batches.")]
Folder = Annotated[Path, typer.Option(help="Folder; a training that is there is continued.")]

TRAIN_OPTIONS: dict[str, str | Stated] = {
    "out": "Folder; a training that is there is continued.",
    "dataset": "As of 'bench run'; its train split.",
    "classes": Stated(
        "What to train on: a class, several (a,b), or all.",
        flag="--class",
        kind=str,
        convert=lambda text: () if text == "all" else names(text) or (),
        default="chair",
    ),
    "objects": "Objects of each class; default 1500 or all.",
    "augment": "Show the encoder noise and fewer points.",
    "steps": "Steps in all, those before a resume included.",
    "batch": "Pictures or clouds a step.",
    "precision": Stated(),
    "device": Stated(kind=Device),
    "seed": "Seed of initial weights and batches.",
    "threads": "CPU threads; default: PyTorch's choice.",
}
VIEWS = "Pictures of each object."


@app.command("autoencoder")
@takes(
    AutoencoderOptions,
    TRAIN_OPTIONS
    | {
        "width": Stated(),
        "encoder": "The paper's, or one that does not depend on their order.",
        "latent_dim": Stated("Length of the code.", flag="--latent"),
        "learning_rate": "Of RMSprop.",
    },
)
def autoencoder_command(options: AutoencoderOptions) -> None:
    """The point-cloud autoencoder (paper, section 3.1)."""
    _print_once(train_autoencoder(options))


@app.command("gan")
@takes(
    GanOptions,
    {"autoencoder": "Checkpoint of the autoencoder."}
    | TRAIN_OPTIONS
    | {
        "views": VIEWS,
        "objective": "acgan-code, acgan-paper or paired.",
        "azimuth": "One number as in the paper, or two without a jump.",
        "warm_up": "First steps without the discriminator (paired only).",
        "generator_lr": "Adam's learning rate.",
    },
)
def gan_command(options: GanOptions) -> None:
    """The rendering GAN (paper, section 3.2), on a trained autoencoder."""
    _print_once(train_gan(options))


@app.command("splat-net")
@takes(
    SplatNetOptions,
    TRAIN_OPTIONS
    | {
        "augment": "Show noise and fewer points.",
        "size": "tiny, default or large.",
        "views": VIEWS,
        "start": "Go on from weights: a bundled name, or a file with the grey one beside.",
        "objective": "l1 or l1-patch.",
        "without": Stated(
            "Inputs to leave out: normals,density,flattened,far,discs.",
            convert=lambda text: names(text) or (),
            default=None,
        ),
        "warm_up": "First steps without the judge of patches (l1-patch only).",
        "cool_down": "Last steps, over which the learning rate falls to zero.",
        "learning_rate": "Of Adam.",
    },
)
def splat_net_command(options: SplatNetOptions) -> None:
    """A U-Net that sees the projected points: weights in colour and in grey."""
    _print_once(train_splat_net(options))


@app.command("decoder")
@takes(
    DecoderOptions,
    {"weights": "A bundled name or a file; the decoder is put beside it."} | TRAIN_OPTIONS,
    leave_out=("dataset", "classes", "augment"),
)
def decoder_command(options: DecoderOptions) -> None:
    """A decoder from codes to clouds for trained weights, for the suite latent."""
    _print_once(train_decoder(options))


@app.command("views")
def train_views(
    objects: Annotated[int, typer.Option(help="Objects of each class.")] = 500,
    views: Annotated[int, typer.Option(help="Pictures of each object.")] = 8,
    epochs: Annotated[int, typer.Option(help="Passes over the pictures.")] = 12,
    seed: Seed = 0,
    out: Folder = Path("training/views"),
) -> None:
    """The classifier behind fd-views: replaces the bundled weights, hence all goldens."""
    from bench.judges.train_views import train_views as train

    print(train(objects, views, epochs, seed, folder=out).to_text())


@app.command("constant")
def train_constant(
    objects: Annotated[int, typer.Option(help="Number of objects.")] = 1500,
    views: Annotated[int, typer.Option(help="Pictures of each object.")] = 8,
    steps: Annotated[int, typer.Option(help="Steps of 64 pictures.")] = 400,
    seed: Seed = 0,
) -> None:
    """The best constant picture: replaces the bundled one, hence its golden values."""
    from bench.judges.train_constant import train_constant as train

    print(train(objects, views, steps, seed))


@app.command("judge")
def train_judge(
    objects: Annotated[int, typer.Option(help="Number of objects.")] = 1500,
    views: Annotated[int, typer.Option(help="Pictures of each object.")] = 16,
    steps: Annotated[int, typer.Option(help="Steps of 96 pictures.")] = 3000,
    seed: Seed = 0,
    out: Folder = Path("training/judge"),
) -> None:
    """The judge of view and shape: replaces the bundled weights, hence what it measures."""
    from bench.judges.train_judge import train_judge as train

    for name, scores in train(objects, views, steps, seed, folder=out).items():
        print(f"{name}: {scores}")


def _print_once(path: Path) -> None:
    """Print what a training made, not by every process that took part."""
    from learning.processes import is_first

    if is_first():
        print(path)
