"""Drawing reconstructions by rays and by OpenGL: time, difference, and where both take as long.

    python -m studies.ray_speed [--chairs 24] [--views 20] [--rounds 3] [--small 6]

1. Meshes of `surface-apss` from test chairs under the five conditions of `chair-robustness`, with
   the clouds and views of a run: processor time of OpenGL over that of rays (all views of a mesh,
   the tree of rays included), the change of SSIM against the true images, and the share of pixels
   that differ by more than 2 levels.
2. Meshes of the first `--small` of those chairs on grids of other resolutions (conditions 2048 and
   noise-0.10): the ratio by the number of faces, and the number of faces where it passes 1
   (log-linear between the medians of two resolutions).

One process with the environment of a worker, one thread; the two renderers take turns (A, B, A,
B ...), and a ratio is that of the medians over the rounds. The second part decides about
`data_prep.rendering.mesh.RAYS_FROM_FACES`. The first takes about 20 minutes.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.reconstruction.surface import RESOLUTION, SurfaceApss
from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.metrics.structural_similarity import ssim_per_image
from bench.records.job import Job
from bench.running.isolation import WORKER_ENVIRONMENT
from bench.running.options import Options
from bench.running.plan import plan
from bench.running.protocol import protocol_of
from bench.running.work import cloud_of
from data_prep.rendering.mesh import RAYS_FROM_FACES
from data_prep.rendering.opengl import gl_renderer, render
from data_prep.rendering.raycast import cast
from data_prep.scene import Mesh, View
from studies.turns import in_turns, load

METHOD = "surface-apss"
SUITE = "chair-robustness"
CONDITIONS = ("2048", "noise-0.10")  # of the second part
RESOLUTIONS = (20, 30, 40, 55, 75, 100, 140, RESOLUTION)
LEVELS = 2


class Compared(NamedTuple):
    """A mesh drawn both ways: `change` [V] of SSIM, `differing` [V] shares of pixels."""

    condition: str
    faces: int
    opengl_s: float
    rays_s: float
    change: NDArray[np.float64]
    differing: NDArray[np.float64]

    @property
    def ratio(self) -> float:
        """The factor by which the rays are faster."""
        return self.opengl_s / self.rays_s


def main() -> None:
    """Measure in a process that starts with the environment of a worker."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--chairs", type=int, default=24)
    options.add_argument("--views", type=int, default=20)
    options.add_argument("--rounds", type=int, default=3)
    options.add_argument("--small", type=int, default=6, help="chairs of the second part")
    given = options.parse_args()
    os.environ.update(WORKER_ENVIRONMENT)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        pool.apply(measure, (given.chairs, given.views, given.rounds, given.small))


def measure(chairs: int, views: int, rounds: int, small: int) -> None:
    """Measure and print both parts."""
    print(f"{gl_renderer()}; {load()}\n")
    jobs = jobs_of(max(chairs, small), views)
    whole = [compare(job, RESOLUTION, rounds) for job in first(jobs, chairs)]
    if whole:
        print(summary(whole), flush=True)
    several = [job for job in first(jobs, small) if job.condition in CONDITIONS]
    print(f"\n{'resolution':>10}{'faces':>10}{'ratio':>8}  smallest and largest")
    curve = []
    for resolution in RESOLUTIONS if several else ():
        compared = [compare(job, resolution, rounds) for job in several]
        ratios = [mesh.ratio for mesh in compared]
        curve.append((median(mesh.faces for mesh in compared), median(ratios)))
        line = f"{resolution:10}{curve[-1][0]:10,.0f}{curve[-1][1]:8.2f}"
        print(f"{line}  {min(ratios):.2f}-{max(ratios):.2f}", flush=True)
    for faces in crossings(curve):
        print(f"equal at {faces:,.0f} faces; RAYS_FROM_FACES is {RAYS_FROM_FACES:,}")


def jobs_of(chairs: int, views: int) -> tuple[Job, ...]:
    """Return a run's jobs with the method, object by object."""
    options = Options(SUITE, methods=(METHOD,), limit=chairs, views=views)
    protocol, _ = protocol_of(find(SUITE, SUITES, "suite"), options)
    return tuple(job for job in plan(protocol, Path()).method_jobs if job.method == METHOD)


def first(jobs: tuple[Job, ...], chairs: int) -> Iterator[Job]:
    """Yield the jobs of the first chairs."""
    names = list(dict.fromkeys(job.object.object_id for job in jobs))[:chairs]
    return (job for job in jobs if job.object.object_id in names)


def compare(job: Job, resolution: int, rounds: int) -> Compared:
    """Reconstruct the cloud of a job, and draw it both ways in turns."""
    mesh = SurfaceApss(resolution).prepare(cloud_of(job)).mesh
    opengl_s, rays_s = times(mesh, job.views, rounds)
    truth = job.object.truth(job.views)
    opengl, rays = render(mesh, job.views), cast(mesh, job.views)
    return Compared(
        job.condition,
        len(mesh.faces),
        opengl_s,
        rays_s,
        ssim_per_image(truth, rays).ssim - ssim_per_image(truth, opengl).ssim,
        differing(opengl, rays),
    )


def times(mesh: Mesh, views: tuple[View, ...], rounds: int) -> tuple[float, float]:
    """Return median seconds of processor time, by OpenGL and by rays."""
    # A mesh of its own for each round: the tree of the last mesh is kept.
    copies = iter([replace(mesh) for _ in range(rounds + 1)])
    works = (lambda: render(mesh, views), lambda: cast(next(copies), views))
    opengl, rays = in_turns(works, rounds, now=time.process_time)
    return median(opengl), median(rays)


def differing(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the shares [V] of pixels of images [V, H, W, 3] that differ by more than LEVELS."""
    apart = np.abs(a.astype(np.int16) - b).max(axis=-1)
    return (apart > LEVELS).mean(axis=(1, 2))


def summary(whole: list[Compared]) -> str:
    """Return a line for each condition, and one for all."""
    head = f"{'':<12}{'faces':>9}{'OpenGL':>8}{'rays':>7}{'ratio':>7}  {'':<12}"
    lines = [f"{head}{'dSSIM, mean':>12}{'mean |.|':>10}{'worst':>9}{f'> {LEVELS} levels':>12}"]
    for name in (*dict.fromkeys(mesh.condition for mesh in whole), "all"):
        chosen = [mesh for mesh in whole if name in (mesh.condition, "all")]
        ratios = [mesh.ratio for mesh in chosen]
        change = np.concatenate([mesh.change for mesh in chosen])
        lines.append(
            f"{name:<12}{median(mesh.faces for mesh in chosen):9,.0f}"
            f"{median(mesh.opengl_s for mesh in chosen):7.2f}s"
            f"{median(mesh.rays_s for mesh in chosen):6.2f}s{median(ratios):7.2f}  "
            f"{f'{min(ratios):.2f}-{max(ratios):.2f}':<12}{change.mean():12.1e}"
            f"{np.abs(change).mean():10.1e}{np.abs(change).max():9.1e}"
            f"{np.concatenate([mesh.differing for mesh in chosen]).mean():12.3%}"
        )
    return "\n".join(lines)


def crossings(curve: list[tuple[float, float]]) -> list[float]:
    """Return where the ratio of points (faces, ratio) passes 1, log-linear between neighbours."""
    faces_at_one = []
    for (faces, ratio), (more, larger) in pairwise(curve):
        if (ratio < 1) != (larger < 1):
            share = np.log(1 / ratio) / np.log(larger / ratio)
            faces_at_one.append(float(faces * (more / faces) ** share))
    return faces_at_one


if __name__ == "__main__":
    main()
