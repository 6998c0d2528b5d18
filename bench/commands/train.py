"""`bench train`: the options of all trainings.

The packages that a training needs are imported when it starts, so that the help stays quick.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import typer

from bench.commands.options import (
    DEVICE,
    SETTINGS,
    Device,
    Group,
    OptionSpec,
    expand_file,
    names,
    options_from_dataclass,
)
from bench.training.options import OPTIONS
from learning.configuration import TimeLimit

app = typer.Typer(cls=Group, help="Train the networks.", **SETTINGS)
OUT = "Folder of the training; an earlier training in it is continued."


def _time_limit(text: str | None) -> TimeLimit | None:
    from bench.running.plan import seconds_of

    return None if text is None else TimeLimit(seconds_of(text, "--for"), text)


TRAIN_OPTIONS: dict[str, str | OptionSpec] = {
    "out": OUT,
    "dataset": "Dataset, as --dataset of 'bench run' takes it; its train split is used.",
    "classes": OptionSpec(
        "Classes to train on, comma-separated, or 'all'.",
        flag="--class",
        kind=str,
        convert=lambda text: () if text == "all" else names(text) or (),
        default="chair",
    ),
    "objects": "Objects of each class. Default: 1500 procedural ones, or all of a folder.",
    "augment": "Also train on clouds with noise and with fewer points.",
    "steps": "Steps in total; those done before the training was continued count, too.",
    "limit": OptionSpec(
        "Time for the whole command: it stops in time and writes a checkpoint, from which the same "
        "command goes on. Default: no limit.",
        flag="--for",
        metavar="90s|2m|1.5h",
        kind=str | None,
        convert=_time_limit,
    ),
    "batch": "Images or clouds in a step.",
    "precision": "Number format of the training step; weights are float32.",
    "device": OptionSpec(DEVICE, kind=Device),
    "seed": "Seed of initial weights and batches.",
    "threads": "CPU threads. Default: PyTorch's choice.",
}
VIEWS = "Images of each object."  # the help of --views, in all trainings that have it
_START = OptionSpec(
    "Weights to start from: a bundled name, or a file with the file of grey weights beside it. "
    "Default: random weights.",
    convert=expand_file,
)
_COOLED_OPTIONS: dict[str, str | OptionSpec] = {
    "augment": "Train on clouds with noise and with fewer points.",
    "cool_down": "Steps at the end over which the learning rate falls to zero.",
    "learning_rate": "Learning rate of Adam.",
}
_U_NET_OPTIONS: dict[str, str | OptionSpec] = _COOLED_OPTIONS | {
    "views": VIEWS,
    "start": _START,
    "objective": "Loss: l1, l1-patch, relief, perceptual or pix2pix; see docs/training.md.",
    "warm_up": "Steps at the start in which the patch discriminator learns but has no influence "
    "yet (not with l1).",
}

# For each training the help of its command, and its options in the order of the help.
TRAININGS: dict[str, tuple[str, dict[str, str | OptionSpec]]] = {
    "autoencoder": (
        "Train the point-cloud autoencoder (paper, section 3.1).",
        TRAIN_OPTIONS
        | {
            "width": "Channels: as in the paper, half, or a quarter (lite) as many.",
            "encoder": "Encoder: the paper's, or one that does not depend on the order of points.",
            "latent_dim": OptionSpec("Length of the code, in numbers.", flag="--latent"),
            "learning_rate": "Learning rate of RMSprop.",
        },
    ),
    "gan": (
        "Train the rendering GAN (paper, section 3.2) on a trained autoencoder.",
        {"autoencoder": "Checkpoint of the trained autoencoder."}
        | TRAIN_OPTIONS
        | {
            "views": VIEWS,
            "objective": "Loss: acgan-code, acgan-paper or paired; see docs/training.md.",
            "azimuth": "Input of the azimuth: one number, as in the paper, or sine and cosine.",
            "start": OptionSpec(
                "Weights to start from, instead of an autoencoder: a bundled name, or a file. "
                "Default: random weights.",
                convert=expand_file,
            ),
            "warm_up": "Steps at the start without the discriminator (paired), or that train it "
            "alone (with --start).",
            "generator_lr": "Learning rate of Adam.",
            "discriminator_lr": "Learning rate of Adam for the discriminator.",
        },
    ),
    "splat-net": (
        "Train the U-Net on projected points; write weights in colour and in grey.",
        TRAIN_OPTIONS
        | _U_NET_OPTIONS
        | {
            "network": "Network: default or points2pix.",
            "colours": "One colour for the image, whatever the shape, or one for each pixel.",
        },
    ),
    "fused-net": (
        "Train a splat-net that also sees meshes; write weights in colour and in grey.",
        TRAIN_OPTIONS
        | _U_NET_OPTIONS
        | {
            "turned": "Share of the objects that are turned at random, upside down too, 0 to 1.",
            "start": replace(_START, help=f"Splat-net's weights. {_START.help}"),
            "steps": "Steps in total; those done before the training was continued count, too. 0: "
            "only compute the meshes.",
        },
    ),
    "occupancy-net": (
        "Train the occupancy network on points labelled inside or outside of closed shapes.",
        TRAIN_OPTIONS | _COOLED_OPTIONS,
    ),
    "upsampler": (
        "Train the up-sampler, which moves points near a cloud onto its surface.",
        {
            name: spec
            for name, spec in (TRAIN_OPTIONS | _COOLED_OPTIONS).items()
            if name != "augment"
        },
    ),
    "decoder": (
        "Train a decoder from codes to clouds, for the suite latent.",
        {
            "weights": OptionSpec(
                "Weights of the encoder: a bundled name, or a file. The decoder is written beside "
                "it.",
                convert=expand_file,
            )
        }
        | {
            name: spec
            for name, spec in TRAIN_OPTIONS.items()
            if name not in ("dataset", "classes", "augment")
        },
    ),
}


def _add_command(name: str, summary: str, specs: dict[str, str | OptionSpec]) -> None:
    def run(options: Any) -> None:
        from bench.training.networks import train

        print_once(train(name, options))

    run.__doc__ = summary
    app.command(name)(options_from_dataclass(OPTIONS[name], specs)(run))


for _name, (_summary, _specs) in TRAININGS.items():
    _add_command(_name, _summary, _specs)


def print_once(path: Path) -> None:
    """Print the file that a training wrote, in the first of its processes only."""
    from learning.processes import is_first

    if is_first():
        print(path)
