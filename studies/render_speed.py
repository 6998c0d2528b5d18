"""The speed of the mesh renderer, and of its possible replacements.

    python -m studies.render_speed [--views 20] [--rounds 7] [--faces 400000] [--processes 2]

For procedural chairs (validation split) and for spheres of more and more faces, in ms of processor
time: the costs of `data_prep.rendering.opengl.render`, once a call (set-up: vertices, upload) and
for each view (drawing, which ends with the resolved image; and reading it back); whole calls, as
views/s; and how many times their time the same images take by pyrender itself
(`studies.plain_pyrender`), and by rays (`data_prep.rendering.raycast`, building the tree included).
Each of the three has a process of its own (two GL contexts in one process slow each other down);
they take turns (A, B, C, A, B, C ...), and numbers are medians over the rounds, with the smallest
and largest ratio of a round.

Then whole calls in one process and in as many as asked for at once, each with one thread: all
views/s on the clock. Leave the machine alone meanwhile.
"""

from __future__ import annotations

import argparse
import functools
import multiprocessing
import os
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from multiprocessing.pool import Pool
from statistics import median
from typing import Any, NamedTuple

import numpy as np
import trimesh

from bench.running.isolation import WORKER_ENVIRONMENT
from data_prep.clouds.sampling import random_views
from data_prep.datasets.registry import ProceduralObject
from data_prep.randomness import generator
from data_prep.rendering import opengl as renderer
from data_prep.rendering.camera import camera_to_world
from data_prep.rendering.opengl import gl_renderer, render
from data_prep.rendering.raycast import cast
from data_prep.scene import IMAGE_SIZE, Mesh, View
from studies.plain_pyrender import render_plainly
from studies.turns import load

CHAIRS = 24
SUBDIVISIONS = range(1, 8)  # of an icosahedron: 20 x 4^n faces
ON_THE_CLOCK = 4  # subdivisions: 5,120 faces, about the most that a true mesh has
SECONDS = 5.0  # that processes draw at once


Draw = Callable[[Mesh, Sequence[View]], object]


class Parts(NamedTuple):
    """The seconds of each part of one call of `render`."""

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
    print(f"{gl_renderer()}; {load()}")
    spheres = [n for n in SUBDIVISIONS if 20 * 4**n <= given.faces]
    print(f"{CHAIRS} procedural chairs: {describe(meshes_of(0))}\n")
    print(HEADER)
    with ExitStack() as stack:
        spawn = multiprocessing.get_context("spawn")
        pools = [stack.enter_context(spawn.Pool(1)) for _ in renderers()]
        for what in (0, *spheres):
            print(line(what, pools, given.views, given.rounds), flush=True)
    print()
    for what in (0, ON_THE_CLOCK):
        for processes in sorted({1, given.processes}):
            rate = at_once(processes, what, given.views)
            print(f"{name_of(what)}: {processes} process(es) {rate:.0f} views/s on the clock")


def renderers() -> list[Draw]:
    """Return our renderer, pyrender's, and rays.

    Each call has a mesh of its own, for the last tree is kept.
    """
    return [render, render_plainly, lambda mesh, views: cast(replace(mesh), views)]


@functools.cache
def meshes_of(what: int) -> list[Mesh]:
    """Return the chairs for 0, else the sphere of so many subdivisions."""
    return [sphere(what)] if what else procedural_chairs()


def name_of(what: int) -> str:
    """Return the name of a line of the table."""
    return f"sphere, {20 * 4**what:,} faces" if what else "chairs"


def procedural_chairs() -> list[Mesh]:
    """Return the first chairs of the validation split."""
    return [ProceduralObject("chair", "validation", i).load() for i in range(CHAIRS)]


def sphere(subdivisions: int) -> Mesh:
    """Return 20 x 4^subdivisions faces of one colour on the unit sphere."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    return Mesh(ball.vertices, ball.faces, np.full((len(ball.faces), 3), 150, np.uint8))


def describe(meshes: Sequence[Mesh]) -> str:
    """Return how many faces there are."""
    counts = sorted(len(mesh.faces) for mesh in meshes)
    return f"{counts[0]:,} to {counts[-1]:,} faces, median {median(counts):,.0f}"


HEADER = (
    f"{'':<24}{'set-up':>8}{'drawing':>9}{'reading':>9}{'views/s':>9}"
    f"{'pyrender':>11}  {'of a round':<13}{'rays':>11}  of a round\n"
    f"{'':<24}{'ms':>8}{'ms/view':>9}{'ms/view':>9}{'':>9}{'x time':>11}  {'':<13}{'x time':>11}"
)


def line(what: int, pools: Sequence[Pool], views: int, rounds: int) -> str:
    """Return one line of the table; the first pool is ours."""
    first_times, *others = in_turns(pools, what, views, rounds)
    parts = pools[0].apply(_parts, (what, views, rounds))
    set_up, drawing, reading = (1e3 * median(taken) for taken in zip(*parts, strict=True))
    count = min(views, renderer.SHEET_VIEWS)
    text = f"{name_of(what):<24}{set_up:8.2f}{drawing / count:9.3f}{reading / count:9.3f}"
    text += f"{len(meshes_of(what)) * views / median(first_times):9.0f}"
    for other in others:
        ratios = [b / a for a, b in zip(first_times, other, strict=True)]
        text += f"{median(ratios):11.2f}  {f'{min(ratios):.2f}-{max(ratios):.2f}':<13}"
    return text.rstrip()


def in_turns(pools: Sequence[Pool], what: int, views: int, rounds: int) -> list[list[float]]:
    """Return seconds of processor time by renderer and round, for all meshes.

    One more round comes first and is not counted.
    """
    taken = [
        [pool.apply(_seconds, (i, what, views)) for i, pool in enumerate(pools)]
        for _ in range(rounds + 1)
    ]
    return [list(seconds) for seconds in zip(*taken[1:], strict=True)]


def _seconds(index: int, what: int, views: int) -> float:
    draw, shown, meshes = renderers()[index], _views(views), meshes_of(what)
    start = time.process_time()
    for mesh in meshes:
        draw(mesh, shown)
    return time.process_time() - start


def _parts(what: int, views: int, rounds: int) -> list[Parts]:
    sheet = _views(views)[: renderer.SHEET_VIEWS]
    return [parts_of(mesh, sheet) for _ in range(rounds) for mesh in meshes_of(what)]


def _views(count: int) -> tuple[View, ...]:
    return random_views(count, generator("render-speed"))


def parts_of(mesh: Mesh, views: Sequence[View]) -> Parts:
    """Time the steps of `render` one by one, each waited for; at most a sheet of views."""
    context = renderer._context()
    context.make_current()
    gl, buffers = context.gl, context.buffers(IMAGE_SIZE)
    clock = [time.process_time()]
    context.upload(*renderer._vertices_of_one_colour(mesh))
    gl.glFinish()
    clock.append(time.process_time())
    poses = np.stack([camera_to_world(view) for view in views])
    context.draw(np.linalg.inv(poses).astype(np.float32), mesh.faces.size, buffers)
    gl.glFinish()
    clock.append(time.process_time())
    np.array(context.read(len(views), buffers))
    clock.append(time.process_time())
    return Parts(*np.diff(clock).tolist())


def at_once(processes: int, what: int, views: int) -> float:
    """Return the views a second that so many processes draw together."""
    context = multiprocessing.get_context("spawn")
    start = context.Barrier(processes)
    with context.Pool(processes, _share_barrier, (start,)) as pool:
        return sum(pool.starmap(_draw_for_a_while, [(what, views)] * processes, chunksize=1))


_barrier: Any = None  # of the processes of a pool, which have no other way to get one


def _share_barrier(barrier: Any) -> None:
    global _barrier
    _barrier = barrier


def _draw_for_a_while(what: int, count: int) -> float:
    """Return views a second on the clock, of one process beside the others."""
    meshes, views = meshes_of(what), _views(count)
    render(meshes[0], views)
    drawn = 0
    _barrier.wait()
    start = time.perf_counter()
    while time.perf_counter() - start < SECONDS:
        for mesh in meshes:
            drawn += len(render(mesh, views))
    return drawn / (time.perf_counter() - start)


if __name__ == "__main__":
    main()
