"""Speed and accuracy of drawing, beside the same network in plain PyTorch.

    python -m studies.inference_speed [--threads 2] [--rounds 9] [--batches 1,20] [--chairs 24]

The plain network (`studies.plain_loop.PlainGenerator`: float32, contiguous memory, nearest
up-sampling and then a 3x3 convolution, BatchNorm as modules) and both precisions of
`pc2pix.engine` draw the same views of one cloud in turns (A, B, C, A, B, C ...) in one process;
every line gives medians over the rounds, ratios and the smallest and largest ratio of a round. The
module as it is trained (up-sampling and convolution in one, channels last) takes its turn, too. The
network of the paper's width is the bundled one made wider (`pc2pix.widen`): it draws the same.

The machine's rate is that of one well-shaped convolution (RATE_SHAPE), its kernel prepacked; the
share is the rate of a whole image beside it. It counts the products of Table 1 once the zeros and
repetitions of up-sampling are taken out (four 2x2 convolutions for the second one of a block); the
engine computes fewer still, so that the share could exceed 100 %. Leave the machine alone
meanwhile.

Exactness: images of validation chairs by the bundled weights; |dSSIM| is that of the score
against the true image, which is what a table shows.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from statistics import median
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from bench.catalogue.loaders import BUNDLED, TO_PAPER_WIDTH
from bench.metrics.structural_similarity import ssim_per_image
from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.registry import ProceduralObject
from data_prep.randomness import generator as random_numbers
from data_prep.rendering.images import to_uint8
from data_prep.rendering.opengl import render
from data_prep.scene import View
from learning.convolution import DTYPES, Convolution
from pc2pix.engine import UnfoldedGenerator, fold
from pc2pix.model import GENERATOR_CHANNELS, NOISE_DIM, Generator
from pc2pix.renderer import Pc2pixRenderer, normalised_angles
from pc2pix.weights import Weights, load_weights
from pc2pix.widen import widen
from studies.arguments import numbers
from studies.plain_loop import PlainGenerator, Target
from studies.turns import Work, in_turns, load, ratio

RATE_SHAPE = (20, 512, 16, 16)  # 3x3, to as many channels
PLAIN = "plain float32"


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--threads", type=int, default=2)
    options.add_argument("--rounds", type=int, default=9)
    options.add_argument("--batches", type=numbers, default=(1, 20), help="comma-separated")
    options.add_argument("--chairs", type=int, default=24, help="0 leaves exactness out")
    options.add_argument("--views", type=int, default=5, help="of each chair")
    given = options.parse_args()
    torch.set_num_threads(given.threads)
    print(f"torch {torch.__version__}, {given.threads} thread(s), {load()}")
    weights = load_weights(BUNDLED)
    wide = replace(weights, generator=widen(weights.generator, TO_PAPER_WIDTH))
    sets = {"paper": wide, "lite": weights}
    torch.manual_seed(0)
    with torch.inference_mode():
        rates = dict(zip(DTYPES, measure_rates(given.rounds), strict=True))
        for name, rate in rates.items():
            print(f"{name} convolution: {rate / 1e9:.0f} GFLOP/s")
        print(f"\n{'ms an image':<34}{'median':>9}{'ratio':>8}  {'of a round':<13}{'share':>7}")
        for name, of_width in sets.items():
            for batch in given.batches:
                report_speed(name, of_width.generator, batch, given.rounds, rates)
    if given.chairs:
        for name, of_width in sets.items():
            report_exactness(name, of_width, given.chairs, given.views)


def report_speed(
    name: str, network: Generator, batch: int, rounds: int, rates: Mapping[Any, float]
) -> None:
    """Measure and print the speed of plain and folded, at one width and batch."""
    config = network.config
    code = torch.randn(1, config.latent_dim)
    elevation01, azimuth01 = torch.rand(2, batch, 1)
    plain = plain_draw(network, code, elevation01, azimuth01)
    unfolded = UnfoldedGenerator(network)
    draws = {
        PLAIN: plain,
        "module float32": lambda: unfolded(code, elevation01, azimuth01),
    }
    for precision in DTYPES:
        folded = fold(network, precision)
        draws[f"folded {precision}"] = lambda folded=folded: folded(code, elevation01, azimuth01)
    seconds = dict(zip(draws, in_turns(list(draws.values()), rounds, idle=2), strict=True))
    expected = plain()
    products = products_an_image([config.scaled(c) for c in GENERATOR_CHANNELS])
    for title, taken in seconds.items():
        rate = 2 * products * batch / median(taken)
        line = f"{name}, batch {batch}, {title}"
        line = f"{line:<34}{1e3 * median(taken) / batch:9.2f}"
        if title != PLAIN:
            apart = float((draws[title]() - expected).abs().max())
            share = rate / rates[title.split()[1]]
            line += f"{ratio(seconds[PLAIN], taken)}{share:7.0%}"
            line += f"  largest difference {apart:.1e}"
        print(line, flush=True)


def plain_draw(
    network: Generator, code: torch.Tensor, elevation01: torch.Tensor, azimuth01: torch.Tensor
) -> Callable[[], torch.Tensor]:
    """Return images [V, 128, 128, 3] in [0, 1] by the plain network with the same weights."""
    config = network.config
    # the plain network takes one number for the azimuth; a second one passes as part of the code
    plain = PlainGenerator(config.width, config.latent_dim + config.azimuth_numbers - 1).eval()
    plain.load_state_dict(network.state_dict())
    count = len(elevation01)
    codes = code.expand(count, -1)
    if config.azimuth == "scalar":
        wanted = Target(codes, elevation01, azimuth01)
    else:
        turn = 2 * torch.pi * (azimuth01 - 0.5)
        wanted = Target(torch.cat([codes, elevation01], dim=1), turn.sin(), turn.cos())
    noise = torch.zeros(count, NOISE_DIM)
    return lambda: ((plain(noise, wanted) + 1) / 2).permute(0, 2, 3, 1).contiguous()


def measure_rates(rounds: int) -> list[float]:
    """Return the operations a second of a well-shaped convolution, by the formats in DTYPES."""
    batch, channels, height, width = RATE_SHAPE
    kernel = torch.randn(channels, channels, 3, 3, dtype=torch.float64) / 100
    draws: list[Work] = []
    for dtype in DTYPES.values():
        x = torch.randn(RATE_SHAPE).to(dtype, memory_format=torch.channels_last)
        convolution = Convolution(kernel, None, RATE_SHAPE, dtype, padding=1)
        draws.append(lambda x=x, convolution=convolution: convolution(x))
    operations = 2 * 9 * batch * channels**2 * height * width
    return [operations / median(taken) for taken in in_turns(draws, rounds, idle=2)]


def products_an_image(channels: list[int]) -> int:
    """Return the products of blocks and last convolution, up-sampling done by phases."""
    total, pixels = 0, 16
    for cin, cout in pairwise(channels):
        total += pixels * cout * (9 * cin + 16 * cout + cin)
        pixels *= 4
    return total + 9 * 3 * channels[-1] * pixels


def report_exactness(name: str, weights: Weights, chairs: int, views: int) -> None:
    """Print largest differences and |dSSIM| of the folded networks, on validation chairs."""
    exact: list[NDArray[np.float32]] = []
    drawn_images: dict[str, list[NDArray[np.float32]]] = {precision: [] for precision in DTYPES}
    true: list[NDArray[np.uint8]] = []
    renderers = {precision: Pc2pixRenderer(weights, precision=precision) for precision in DTYPES}
    for i in range(chairs):
        mesh = ProceduralObject("chair", "validation", i).load()
        rng = random_numbers("inference-speed", i)
        state = renderers["float32"].prepare(sample_surface(mesh, rng))
        shown = [
            View(float(a), float(e))
            for a, e in zip(rng.uniform(-180, 180, views), rng.uniform(-40, 40, views), strict=True)
        ]
        with torch.inference_mode():
            exact.append(
                plain_draw(
                    weights.generator, state, *torch.tensor(normalised_angles(shown)).split(1, 1)
                )().numpy()
            )
        for precision, renderer in renderers.items():
            drawn_images[precision].append(renderer.draw(state, shown))
        true.append(render(mesh, shown))
    expected, truth = np.concatenate(exact), np.concatenate(true)
    scores = ssim_per_image(to_uint8(expected), truth).ssim
    print(f"\n{name}, {chairs} chairs x {views} views; SSIM of the plain one {scores.mean():.4f}")
    for precision, images in drawn_images.items():
        drawn = np.concatenate(images)
        apart = np.abs(drawn - expected)
        levels = np.abs(to_uint8(drawn).astype(int) - to_uint8(expected))
        moved = ssim_per_image(to_uint8(drawn), truth).ssim - scores
        between = ssim_per_image(to_uint8(drawn), to_uint8(expected)).ssim
        print(
            f"{precision}: difference {apart.max():.1e} at most, {apart.mean():.1e} on average; "
            f"{np.count_nonzero(levels)} of {levels.size} grey levels move, by {levels.max()} at "
            f"most; dSSIM {moved.mean():+.1e} on average, {np.abs(moved).max():.1e} at most; "
            f"SSIM of one with the other {between.min():.5f} at least"
        )


if __name__ == "__main__":
    main()
