"""Mean SSIM of reconstructions on validation chairs, with and without smoothing.

    python -m studies.denoising [--chairs 8] [--views 4] [--methods a,b] [--conditions a,b]

The scenes are those of `studies.noise_floor`. A variant is a method's id, also with a parameter set
(`denoised-alpha@strength=0`). What fails is scored as a white image. The last column is the median
processor time of `prepare`, in seconds on one thread. The constants of `baselines.reconstruction.denoised` were
chosen by this table. Ten minutes of processor time for all.
"""

from __future__ import annotations

import argparse
import time
from statistics import median

import numpy as np

from bench.catalogue.methods import find_method
from bench.metrics import ssim
from data_prep.failures import StageFailure
from data_prep.rendering.images import to_uint8
from data_prep.scene import PointCloud, Renderer, UInt8Images, View
from studies.arguments import names, positive
from studies.images import render_all
from studies.noise_floor import make_scene
from studies.tables import markdown

CONDITIONS = ("2048", "1024", "512", "noise-0.05", "noise-0.10")
METHODS = (
    *("denoised-alpha", "denoised-bpa", "denoised-poisson", "pgr"),
    *("alpha-shape", "surface-bpa", "poisson", "surface-apss", "blank"),
)


def drawn(
    renderer: Renderer, cloud: PointCloud, views: tuple[View, ...]
) -> tuple[UInt8Images, float]:
    """Images of a cloud, white where the method fails, and the processor time of `prepare`."""
    rng = np.random.default_rng(0)
    start = time.process_time()
    try:
        state = renderer.prepare(cloud, rng)
    except StageFailure:
        return np.full((len(views), 128, 128, 3), 255, np.uint8), time.process_time() - start
    seconds = time.process_time() - start
    return to_uint8(renderer.draw(state, views, rng)), seconds


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="Reconstruction with and without smoothing.")
    parser.add_argument("--chairs", type=positive, default=8)
    parser.add_argument("--views", type=positive, default=4)
    parser.add_argument("--methods", type=names, default=METHODS)
    parser.add_argument("--conditions", type=names, default=CONDITIONS)
    options = parser.parse_args()
    scenes = [make_scene(options.chairs, options.views, 0, c) for c in options.conditions]
    truths = [render_all(scene.meshes, scene.views) for scene in scenes]
    rows = []
    for method in options.methods:
        renderer, cells, times = find_method(method).load("cpu"), [], []
        for scene, truth in zip(scenes, truths, strict=True):
            values = []
            for cloud, views, true in zip(scene.clouds, scene.views, truth, strict=True):
                images, seconds = drawn(renderer, cloud, views)
                values.append(np.mean(ssim(true, images).ssim))
                times.append(seconds)
            cells.append(f"{np.mean(values):.3f}")
        rows.append([method, *cells, f"{median(times):.2f}"])
        print(*rows[-1], flush=True)
    print(markdown(["method", *options.conditions, "s a cloud"], rows), end="")


if __name__ == "__main__":
    main()
