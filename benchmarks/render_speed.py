"""Speed of the mesh renderer, and of what it could be replaced by.

    python -m benchmarks.render_speed [--views 20] [--rounds 7] [--faces 400000] [--processes 2]

For procedural chairs (validation split) and for spheres of more and more faces: what a call costs
once (set-up: vertices, upload), and for each view (drawing, which ends with the resolved picture;
and reading it back), in ms of processor time; views/s of whole calls of `data_prep.render.render`;
and how many times the time of that `benchmarks.plain_pyrender` takes, which gives the same
pictures. All of them draw in turns (A, B, C, A, B, C ...) in one process; numbers are medians over
the rounds, with the smallest and largest ratio of a round. Where embreex is installed, so does the
ray-caster (`benchmarks.ray_caster`, 4 samples a pixel), which includes building its tree.

Then the chairs again in one process and in as many as asked for at once, each with one thread: all
views/s on the clock. Leave the machine alone meanwhile. Mesa's rasteriser has a thread of its own
(LP_NUM_THREADS=1, as in the workers of a run), which works while the process waits for it.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from statistics import median
from typing import Any, NamedTuple

import numpy as np
import trimesh

from bench.isolation import WORKER_ENVIRONMENT
from benchmarks.plain_pyrender import render_plainly
from benchmarks.ray_caster import OPENGL, cast
from data_prep import render as renderer
from data_prep.datasets import ProceduralObject
from data_prep.randomness import generator
from data_prep.render import gl_renderer, render
from data_prep.sampling import random_views
from data_prep.scene import Mesh, View

CHAIRS = 24
SUBDIVISIONS = range(1, 8)  # of an icosahedron: 20 x 4^n faces
SECONDS = 5.0  # that processes draw at once


class Parts(NamedTuple):
    """Seconds of one call of `render`."""

    set_up: float
    drawing: float
    reading: float


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--views", type=int, default=20, help="a mesh and call")
    options.add_argument("--rounds", type=int, default=7)
    options.add_argument("--faces", type=int, default=400_000, help="of the largest sphere")
    options.add_argument("--processes", type=int, default=2)
    given = options.parse_args()
    os.environ.update(WORKER_ENVIRONMENT)  # Mesa reads it when the context is made
    loads = ", ".join(f"{load:.2f}" for load in os.getloadavg())
    print(f"{gl_renderer()}; load of the machine {loads}")
    views = random_views(given.views, generator("render-speed"))
    chairs = procedural_chairs()
    print(f"{CHAIRS} procedural chairs: {describe(chairs)}\n")
    print(HEADER)
    report("chairs", chairs, views, given.rounds)
    for subdivisions in SUBDIVISIONS:
        if 20 * 4**subdivisions <= given.faces:
            ball = sphere(subdivisions)
            report(f"sphere, {len(ball.faces):,} faces", [ball], views, given.rounds)
    print()
    for processes in sorted({1, given.processes}):
        print(f"{processes} process(es): {at_once(processes, given.views):.0f} views/s of chairs")


def procedural_chairs() -> list[Mesh]:
    """The first chairs of the validation split."""
    return [ProceduralObject("chair", "validation", i).load() for i in range(CHAIRS)]


def sphere(subdivisions: int) -> Mesh:
    """20 x 4^subdivisions faces of one colour on the unit sphere."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    return Mesh(ball.vertices, ball.faces, np.full((len(ball.faces), 3), 150, np.uint8))


def describe(meshes: Sequence[Mesh]) -> str:
    """How many faces there are."""
    counts = sorted(len(mesh.faces) for mesh in meshes)
    return f"{counts[0]:,} to {counts[-1]:,} faces, median {median(counts):,.0f}"


HEADER = (
    f"{'':<24}{'set-up':>8}{'drawing':>9}{'reading':>9}{'views/s':>9}"
    f"{'pyrender':>11}  {'of a round':<13}{'ray-caster':>11}\n"
    f"{'':<24}{'ms':>8}{'ms/view':>9}{'ms/view':>9}{'':>9}{'x time':>11}  {'':<13}{'x time':>11}"
)


def report(name: str, meshes: Sequence[Mesh], views: Sequence[View], rounds: int) -> None:
    """One line of the table."""
    draws: list[Callable[[Mesh], object]] = [
        lambda mesh: render(mesh, views),
        lambda mesh: render_plainly(mesh, views),
    ]
    if find_spec("embreex"):
        draws.append(lambda mesh: cast(mesh, views, OPENGL))
    own, plain, *rays = in_turns(draws, meshes, rounds)
    sheet = views[: renderer.SHEET_VIEWS]
    parts = [parts_of(mesh, sheet) for _ in range(rounds) for mesh in meshes]
    set_up, drawing, reading = (1e3 * median(taken) for taken in zip(*parts, strict=True))
    ratios = [b / a for a, b in zip(own, plain, strict=True)]
    line = f"{name:<24}{set_up:8.2f}{drawing / len(sheet):9.3f}{reading / len(sheet):9.3f}"
    line += f"{len(meshes) * len(views) / median(own):9.0f}{median(ratios):11.2f}"
    line += f"  {min(ratios):5.2f}-{max(ratios):<7.2f}"
    if rays:
        line += f"{median(rays[0]) / median(own):11.2f}"
    print(line, flush=True)


def in_turns(
    draws: Sequence[Callable[[Mesh], object]], meshes: Sequence[Mesh], rounds: int
) -> list[list[float]]:
    """Seconds of processor time that each takes for all meshes, by round; one more comes first."""
    seconds: list[list[float]] = [[] for _ in draws]
    for _ in range(rounds + 1):
        for draw, kept in zip(draws, seconds, strict=True):
            start = time.process_time()
            for mesh in meshes:
                draw(mesh)
            kept.append(time.process_time() - start)
    return [kept[1:] for kept in seconds]


def parts_of(mesh: Mesh, views: Sequence[View]) -> Parts:
    """What `render` does, step by step, each waited for; at most a sheet of views."""
    context = renderer._context()
    context.make_current()
    gl = context.gl
    clock = [time.process_time()]
    context.upload(*renderer._vertices_of_one_colour(mesh))
    gl.glFinish()
    clock.append(time.process_time())
    context.draw(renderer._world_to_camera(views), mesh.faces.size)
    gl.glFinish()
    clock.append(time.process_time())
    np.array(context.read(len(views)))
    clock.append(time.process_time())
    return Parts(*np.diff(clock).tolist())


def at_once(processes: int, views: int) -> float:
    """Views of chairs a second that so many processes draw together."""
    context = multiprocessing.get_context("spawn")
    start = context.Barrier(processes)
    with context.Pool(processes, _share_barrier, (start,)) as pool:
        return sum(pool.map(_draw_for_a_while, [views] * processes, chunksize=1))


_barrier: Any = None  # of the processes of a pool, which have no other way to get one


def _share_barrier(barrier: Any) -> None:
    global _barrier
    _barrier = barrier


def _draw_for_a_while(count: int) -> float:
    """Views a second on the clock, of one process beside the others."""
    chairs, views = procedural_chairs(), random_views(count, generator("render-speed"))
    render(chairs[0], views)
    drawn = 0
    _barrier.wait()
    start = time.perf_counter()
    while time.perf_counter() - start < SECONDS:
        for mesh in chairs:
            drawn += len(render(mesh, views))
    return drawn / (time.perf_counter() - start)


if __name__ == "__main__":
    main()
