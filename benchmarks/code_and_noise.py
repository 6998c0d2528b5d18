"""What a trained network heeds: order and number of points, noise, z, and the cloud itself.

`python -m benchmarks.code_and_noise [WEIGHTS ...] [--out DIR]` prints, for each set of weights
(bundled names or files; default: all that are bundled), on validation chairs:

* the code's relative change |c' - c| / |c| (whitened codes; median over clouds) when the points are
  shuffled, when half or a quarter of them is left, and under noise; beside it the distance between
  the codes of two different chairs, which any of these has to be compared with;
* the deviation of a pixel over z at fixed cloud and view, over clouds at fixed view, and over
  clouds at fixed view among true pictures (all in [0, 1], root mean square over pixels and
  channels).

With `--out` it also writes a contact sheet per set of weights: a row per cloud at one view; the
first column is the truth, then z = 0, then z drawn six times.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import pc2pix
from data_prep.conditions import CONDITIONS
from data_prep.datasets import ProceduralObject
from data_prep.images import to_float, to_uint8
from data_prep.randomness import generator
from data_prep.render import render
from data_prep.sampling import sample_surface
from data_prep.scene import PointCloud, View
from pc2pix.weights import BUNDLED

CLOUDS = 40
DRAWS = 6
ROWS = 8
VIEW = View(azimuth_deg=30.0, elevation_deg=20.0)


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="What a trained network heeds.")
    parser.add_argument("weights", nargs="*", default=list(BUNDLED))
    parser.add_argument("--out", type=Path, help="folder for the contact sheets")
    options = parser.parse_args()
    meshes = [ProceduralObject("chair", "validation", i).load() for i in range(CLOUDS)]
    clouds = [sample_surface(m, generator("study", i)).points for i, m in enumerate(meshes)]
    truth = to_float(np.concatenate([render(mesh, [VIEW]) for mesh in meshes]))
    print("| weights | measure | value |\n|---|---|---|")
    for name in options.weights:
        for measure, value in codes(name, clouds).items():
            print(f"| {name} | code: {measure} | {value:.3f} |")
        plain, drawn = pictures(name, clouds)
        print(f"| {name} | pixels: over z | {_deviation(drawn, axis=1):.3f} |")
        print(f"| {name} | pixels: over clouds | {_deviation(plain, axis=0):.3f} |")
        print(f"| {name} | pixels: over clouds, truth | {_deviation(truth, axis=0):.3f} |")
        if options.out:
            print(f"| {name} | sheet | {write_sheet(options.out, name, truth, plain, drawn)} |")


def codes(name: str, clouds: list[NDArray[np.float32]]) -> dict[str, float]:
    """Median relative change of the whitened code by what is done to the cloud."""
    renderer = pc2pix.load(name)

    def code(points: NDArray[np.float32]) -> NDArray[np.float64]:
        return renderer.prepare(PointCloud(points))[0].double().numpy()

    conditions = {c.id: c.perturbation for c in CONDITIONS}
    changes: dict[str, list[float]] = {}
    whole = [code(points) for points in clouds]
    for i, (points, before) in enumerate(zip(clouds, whole, strict=True)):
        rng = generator("study", "changes", i)
        changed = {"shuffled": rng.permutation(points)}
        for condition in ("1024", "512", "noise-0.05", "noise-0.10"):
            changed[condition] = conditions[condition].apply(PointCloud(points), rng).points
        after = {name: code(points) for name, points in changed.items()}
        after["another chair"] = whole[i - 1]
        for measure, found in after.items():
            change = np.linalg.norm(found - before) / np.linalg.norm(before)
            changes.setdefault(measure, []).append(float(change))
    return {measure: float(np.median(values)) for measure, values in changes.items()}


def pictures(
    name: str, clouds: list[NDArray[np.float32]]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Pictures in [0, 1] with z = 0 [N, H, W, 3], and with z drawn [N, DRAWS, H, W, 3]."""
    centre, random = pc2pix.load(name), pc2pix.load(name, z="uniform")
    plain, drawn = [], []
    for i, points in enumerate(clouds):
        state = centre.prepare(PointCloud(points))
        plain.append(centre.draw(state, [VIEW])[0])
        drawn.append(random.draw(state, [VIEW] * DRAWS, generator("study", "z", i)))
    return np.stack(plain), np.stack(drawn)


def _deviation(images: NDArray[np.float32], axis: int) -> float:
    return float(np.sqrt(images.var(axis=axis, dtype=np.float64).mean()))


def write_sheet(
    folder: Path,
    name: str,
    truth: NDArray[np.float32],
    plain: NDArray[np.float32],
    drawn: NDArray[np.float32],
) -> Path:
    """One PNG: truth, z = 0 and z drawn, a row per cloud."""
    from PIL import Image

    columns = np.concatenate([truth[:ROWS, None], plain[:ROWS, None], drawn[:ROWS]], axis=1)
    sheet = columns.transpose(0, 2, 1, 3, 4).reshape(ROWS * 128, -1, 3)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"diversity-{Path(name).stem}.png"
    Image.fromarray(to_uint8(sheet)).save(path)
    return path


if __name__ == "__main__":
    main()
