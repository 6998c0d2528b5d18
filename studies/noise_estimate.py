"""How well `baselines.reconstruction.noise` reads the noise of a cloud.

    python -m studies.noise_estimate [--chairs 8] [--meshes FOLDER] [--out docs/noise-estimate.png]

Validation chairs, and the meshes of a folder and its sub-folders, sampled with 2,048, 1,024 and 512
points, and N(0, sigma) added to each coordinate. Prints a Markdown table of each, mean and range of
the estimates over the objects, and draws them side by side. Eight seconds an object on one thread.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from baselines.reconstruction.noise import noise_scale
from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.registry import ProceduralObject
from data_prep.files.meshes import SUFFIXES, load_mesh
from data_prep.randomness import generator
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


def draw(by_name: Mapping[str, NDArray[np.float64]], out: Path) -> None:
    """Estimate over truth, a panel a name."""
    panels = {"sharey": True, "squeeze": False, "layout": "constrained"}
    figure, grid = plt.subplots(1, len(by_name), figsize=(5 * len(by_name), 4), **panels)
    for axes, (name, found) in zip(grid[0], by_name.items(), strict=True):
        _panel(axes, name, found)
    grid[0][0].set_ylabel("estimate: mean and range over objects")
    grid[0][0].legend()
    figure.savefig(out, dpi=120)


def _panel(axes: Axes, name: str, found: NDArray[np.float64]) -> None:
    """A line for each number of points, its range shaded."""
    axes.plot(SIGMAS, SIGMAS, color="0.5", linestyle="--", label="true")
    for count, values in zip(COUNTS, found, strict=True):
        (line,) = axes.plot(SIGMAS, values.mean(axis=1), marker="o", label=f"{count} points")
        low, high = values.min(axis=1), values.max(axis=1)
        axes.fill_between(SIGMAS, low, high, color=line.get_color(), alpha=0.15, linewidth=0)
    axes.set(xlabel="noise: standard deviation", title=name, xlim=(0, None), ylim=(0, None))


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="Estimated against true noise.")
    parser.add_argument("--chairs", type=positive, default=8)
    parser.add_argument("--meshes", type=Path)
    parser.add_argument("--out", type=Path, default=Path("docs/noise-estimate.png"))
    options = parser.parse_args()
    chairs = [ProceduralObject("chair", "validation", i).load() for i in range(options.chairs)]
    by_name = {f"{len(chairs)} validation chairs": estimates(chairs)}
    if options.meshes is not None:
        files = sorted(options.meshes.rglob("*"))
        meshes = [load_mesh(file) for file in files if file.suffix.lower() in SUFFIXES]
        by_name[f"{len(meshes)} meshes"] = estimates(meshes)
    for name, found in by_name.items():
        rows = [
            [str(count), *(f"{v.mean():.3f} ({v.min():.3f}-{v.max():.3f})" for v in values)]
            for count, values in zip(COUNTS, found, strict=True)
        ]
        print(f"\n{name}\n")
        print(markdown(["points", *(f"sigma {sigma:g}" for sigma in SIGMAS)], rows), end="")
    draw(by_name, options.out)


if __name__ == "__main__":
    main()
