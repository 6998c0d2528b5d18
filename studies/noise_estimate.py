"""How well `baselines.noise` reads the noise of a cloud.

    python -m studies.noise_estimate [--chairs 8] [--meshes FOLDER] [--out docs/noise-estimate.png]

Validation chairs, or the meshes of a folder and its sub-folders, sampled with 2,048, 1,024 and 512
points, and N(0, sigma) added to each coordinate. Prints a Markdown table, mean and range of the
estimates over the objects, and draws them. A minute on one thread.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from baselines.noise import noise_scale
from data_prep.datasets import ProceduralObject
from data_prep.mesh_files import SUFFIXES, load_mesh
from data_prep.randomness import generator
from data_prep.sampling import sample_surface
from data_prep.scene import Mesh
from studies.arguments import positive
from studies.tables import markdown

COUNTS = (2048, 1024, 512)
SIGMAS = (0.0, 0.01, 0.02, 0.05, 0.10, 0.15)


def estimates(meshes: list[Mesh]) -> NDArray[np.float64]:
    """[counts, sigmas, meshes]."""
    found = np.empty((len(COUNTS), len(SIGMAS), len(meshes)))
    for i, mesh in enumerate(meshes):
        for j, count in enumerate(COUNTS):
            for k, sigma in enumerate(SIGMAS):
                rng = generator("noise estimate", i, count, k)
                points = sample_surface(mesh, rng, count).points
                noise = rng.normal(scale=sigma, size=points.shape)
                found[j, k, i] = noise_scale(points + noise.astype(np.float32))
    return found


def draw(found: NDArray[np.float64], out: Path) -> None:
    """Estimate over truth: a line for each number of points, its range shaded."""
    figure, axes = plt.subplots(figsize=(5, 4), layout="constrained")
    axes.plot(SIGMAS, SIGMAS, color="0.5", linestyle="--", label="true")
    for count, values in zip(COUNTS, found, strict=True):
        (line,) = axes.plot(SIGMAS, values.mean(axis=1), marker="o", label=f"{count} points")
        low, high = values.min(axis=1), values.max(axis=1)
        axes.fill_between(SIGMAS, low, high, color=line.get_color(), alpha=0.15, linewidth=0)
    axes.set(xlabel="noise: standard deviation", ylabel="estimate: mean and range over objects")
    axes.set(xlim=(0, None), ylim=(0, None))
    axes.legend()
    figure.savefig(out, dpi=120)


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="Estimated against true noise.")
    parser.add_argument("--chairs", type=positive, default=8)
    parser.add_argument("--meshes", type=Path)
    parser.add_argument("--out", type=Path, default=Path("docs/noise-estimate.png"))
    options = parser.parse_args()
    meshes = [ProceduralObject("chair", "validation", i).load() for i in range(options.chairs)]
    if options.meshes is not None:
        files = sorted(options.meshes.rglob("*"))
        meshes = [load_mesh(file) for file in files if file.suffix.lower() in SUFFIXES]
    found = estimates(meshes)
    rows = [
        [str(count), *(f"{v.mean():.3f} ({v.min():.3f}-{v.max():.3f})" for v in values)]
        for count, values in zip(COUNTS, found, strict=True)
    ]
    print(markdown(["points", *(f"sigma {sigma:g}" for sigma in SIGMAS)], rows), end="")
    draw(found, options.out)


if __name__ == "__main__":
    main()
