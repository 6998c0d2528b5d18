"""Speed of a training step beside the same step in plain PyTorch.

    python -m studies.training_speed [--threads 1,2] [--rounds 9] [--width lite] [--batch 32]

Both are measured in turns (A, B, A, B ...) in one process, from the same weights; every line gives
medians over the rounds and the smallest and largest ratio of a round. Images are random numbers:
no step looks at what they show. Leave the machine alone meanwhile.

Denormal numbers are flushed in our step and not in the plain one. That can be set for the thread
that asks only: the other threads of a pool flush in both, to the plain step's advantage.
"""

from __future__ import annotations

import argparse
import dataclasses
from statistics import median

import numpy as np
import torch

from learning.training_loop import Precision, denormals_flushed, seeded
from pc2pix.losses import chamfer
from pc2pix.model import LITE, PAPER, ModelConfig, build_encoder
from pc2pix.train_gan import GanConfig, _GanTrainer
from pc2pix.training_data import GanData
from studies.arguments import numbers
from studies.plain_loop import NOISE, PlainLoop, Target
from studies.turns import Work, in_turns, ratio

OBJECTS, VIEWS = 32, 2
POINTS = 2048
CPU = torch.device("cpu")


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--threads", type=numbers, default=(1, 2), help="comma-separated")
    options.add_argument("--rounds", type=int, default=9)
    options.add_argument("--batch", type=int, default=32)
    options.add_argument("--width", choices=["lite", "paper"], default="lite")
    given = options.parse_args()
    model = {"lite": LITE, "paper": PAPER}[given.width]
    # before the pool of threads is made: its threads inherit this and keep it
    torch.set_flush_denormal(True)
    print(f"torch {torch.__version__}, width {given.width}, batch {given.batch}")
    for threads in given.threads:
        torch.set_num_threads(threads)
        print(f"\n{threads} thread(s)", flush=True)
        measure(model, given.batch, given.rounds)


def measure(model: ModelConfig, batch: int, rounds: int) -> None:
    """Measure and print all comparisons, at PyTorch's present number of threads."""
    print(f"{'images/s':<42}{'plain fp32':>12}{'ours':>10}{'ratio':>8}  of a round")
    data = make_data()
    for precision in ("bfloat16", "float32"):
        ours = our_step(data, model, "acgan-code", batch, precision)
        plain, us = in_turns([plain_step(data, model, batch), ours], rounds)
        print(
            f"{f'adversarial (acgan-code), {precision}':<42}{batch / median(plain):12.1f}"
            f"{batch / median(us):10.1f}{ratio(plain, us)}",
            flush=True,
        )
    paired = dataclasses.replace(model, encoder="pointnet", azimuth="sine-cosine")
    for name, warm_up in (("reconstruction only", 10**9), ("adversarial", 0)):
        step = our_step(data, paired, "paired", batch, "bfloat16", warm_up)
        (seconds,) = in_turns([step], rounds)
        print(
            f"{f'paired, {name}, bfloat16':<42}{'':12}{batch / median(seconds):10.1f}", flush=True
        )
    (seconds,) = in_turns([chamfer_step(batch)], rounds)
    title = f"Chamfer distance, 2 x {POINTS} points, clouds/s"
    print(f"{title:<42}{'':12}{batch / median(seconds):10.1f}", flush=True)


def make_data() -> GanData:
    """Return noise in the shape of a training set."""
    rng = np.random.default_rng(0)
    return GanData(
        images=rng.integers(0, 256, (OBJECTS, VIEWS, 128, 128, 3), dtype=np.uint8),
        azimuth_deg=rng.uniform(-180, 180, (OBJECTS, VIEWS)),
        elevation_deg=rng.uniform(-40, 40, (OBJECTS, VIEWS)),
        clouds=rng.uniform(-0.5, 0.5, (OBJECTS, POINTS, 3)).astype(np.float32),
    )


def our_step(
    data: GanData,
    model: ModelConfig,
    objective: str,
    batch: int,
    precision: Precision,
    warm_up: int = 0,
) -> Work:
    """Return the step of `bench train gan`, batches included."""
    config = GanConfig(
        model=model, objective=objective, batch=batch, precision=precision, warm_up=warm_up
    )
    trainer = _GanTrainer(data, seeded(0, lambda: build_encoder(model)), config, CPU)

    def step() -> None:
        with denormals_flushed():
            trainer.take_step()

    return step


def plain_step(data: GanData, model: ModelConfig, batch: int) -> Work:
    """Return the plain step, batches included, from the weights that ours starts with."""
    start = _GanTrainer(
        data, seeded(0, lambda: build_encoder(model)), GanConfig(model=model, batch=batch), CPU
    )
    loop = PlainLoop(model.width, model.latent_dim)
    loop.generator.load_state_dict(start.generator.state_dict())
    loop.discriminator.load_state_dict(start.discriminator.state_dict())
    images = torch.from_numpy(data.images).permute(0, 1, 4, 2, 3).contiguous()
    elevation = torch.from_numpy(data.elevation_deg / 80 + 0.5).float()
    azimuth = torch.from_numpy(data.azimuth_deg / 360 + 0.5).float()
    codes = start.codes

    def wanted() -> Target:
        return Target(
            codes[torch.randint(OBJECTS, (batch,))], torch.rand(batch, 1), torch.rand(batch, 1)
        )

    def step() -> None:
        torch.set_flush_denormal(False)
        i, j = torch.randint(OBJECTS, (batch,)), torch.randint(VIEWS, (batch,))
        shown = Target(codes[i], elevation[i, j, None], azimuth[i, j, None])
        noises = torch.rand(batch, NOISE) * 2 - 1, torch.rand(batch, NOISE) * 2 - 1
        loop.step(images[i, j].float() / 127.5 - 1, shown, noises, (wanted(), wanted()))

    return step


def chamfer_step(batch: int) -> Work:
    """Return the step of the autoencoder's loss and its gradient."""
    drawn = torch.rand(batch, POINTS, 3) * 2 - 1
    true = torch.rand(batch, POINTS, 3) * 2 - 1
    drawn.requires_grad_(True)

    def step() -> None:
        with denormals_flushed():
            chamfer(drawn, true).backward()

    return step


if __name__ == "__main__":
    main()
