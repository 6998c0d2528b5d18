"""The stage of `surface-apss` that loses its digits, and changes that might keep them.

    python -m studies.apss_digits [--condition 2048] [--chairs 4] [--views 4] [--repetitions 30]
        [--stages points,normals,...] [--changes none,sorted,...] [--workers 1] [--faces]

Chairs of the validation split, each reconstructed again and again while every number that one stage
hands on is moved by -1, 0 or 1 rounding error, drawn anew in each repetition:

nothing   nothing is moved: the same mesh each time
points    the points that the chain gets, in float32
order     the points are handed on in another order, to the bit as they are
normals   the normals of the points, in float64
pivoted   the vertices after ball pivoting, in float64
closed    the vertices after closing holes, in float64; their normals follow
drawn     the vertices of the mesh that APSS makes, in float32

Changes of the chain, each alone (the method itself has none of them):

sorted      points in the order of their coordinates
snapped     coordinates rounded to multiples of 2^-12
both        snapped, then sorted
spaced      of two points nearer than a quarter of the median spacing, only one
fixed       15 projection steps for each vertex, whatever memory holds
oriented    normals and their signs from principal axes and a spanning tree, in place of MeshLab's
crossing    holes are closed without a test whether faces intersect
used        without the points that no face uses when APSS begins
unit        normals of length 1, and no faces, when APSS begins
near        without the faces of the mesh that lie farther than two spacings from each point
no-apss     the mesh before APSS (`surface-bpa`)

Prints a row for each stage and change: for each metric the mean of the chairs where nothing is
moved, and the standard deviation of a chair's mean over that one and the repetitions, root mean
square over the chairs. One repetition takes 3 to 6 s; workers have the environment of a run.
`--faces` counts instead, on average over the repetitions, the faces and the normals that become
others before APSS; that takes a tenth of a second.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import cKDTree

from baselines.reconstruction.meshlab import MeshLab
from baselines.reconstruction.stages import finite_part, kept_faces, spacing
from baselines.reconstruction.surface import MAX_HOLE_EDGES, NORMAL_NEIGHBOURS, RESOLUTION
from bench.catalogue.suites import Limits
from bench.running.isolation import WorkerFailure, run_tasks
from data_prep.randomness import generator
from data_prep.rendering.mesh import draw_mesh
from data_prep.scene import NEUTRAL_GREY, Mesh, Points
from studies.arguments import names, positive
from studies.cells import make_chairs
from studies.images import all_scores, render_all
from studies.tables import markdown

STAGES = ("nothing", "points", "order", "normals", "pivoted", "closed", "drawn")
CHANGES = (
    *("none", "sorted", "snapped", "both", "spaced", "fixed", "oriented", "crossing", "used"),
    *("unit", "near", "no-apss"),
)
METRICS = ("ssim", "ssim_object", "lpips")  # columns of records
FACES = ("other faces, pivoted", "other faces, closed", "other normals")
GRID = 2.0**12
LIMITS = Limits(time_s=3600.0, memory_gib=4.0)
Floats = NDArray[np.floating]


class Case(NamedTuple):
    """A chair, and what is done to it."""

    condition: str
    chair: int
    stage: str
    change: str
    views: int
    repetitions: int


@dataclass(frozen=True)
class Chain:
    """The stages of `surface-apss` with one change, and one stage whose numbers are moved."""

    stage: str
    change: str

    def reconstruct(self, points: Points, rng: np.random.Generator | None) -> Mesh:
        """Return the mesh that is drawn; without `rng` nothing is moved."""
        points = self.start(points, rng)
        meshlab = self.close(self.pivot(points, rng), rng)
        if self.change == "no-apss":
            mesh = meshlab.mesh(NEUTRAL_GREY)
        else:
            # accurate normals change no vertex and no face, and take a quarter of the time
            accuracy = 0.0 if self.change == "fixed" else 1e-4
            meshlab.marching_cubes_apss(RESOLUTION, accuracy, accurate_normals=False)
            mesh = finite_part("apss", meshlab.mesh(NEUTRAL_GREY)).mesh
        if self.change == "near":
            distances = np.asarray(cKDTree(points).query(mesh.vertices)[0])
            near = distances < 2 * spacing(points)
            mesh = kept_faces(mesh, np.all(near[mesh.faces], axis=1))
        vertices = self._moved("drawn", mesh.vertices.astype(np.float32), rng)
        return Mesh(vertices, mesh.faces, mesh.face_colors)

    def start(self, points: Points, rng: np.random.Generator | None) -> Points:
        """Return the points that the chain begins with, moved and changed."""
        if self.stage == "order" and rng is not None:
            points = rng.permutation(points)
        return self._changed(self._moved("points", points, rng))

    def _changed(self, points: Points) -> Points:
        """Return the points after the change, if it is one of points."""
        if self.change in ("snapped", "both"):
            points = np.round(points * np.float32(GRID)) / np.float32(GRID)
        if self.change in ("sorted", "both"):
            return points[np.lexsort(points.T)]
        if self.change == "spaced":
            pairs = cKDTree(points).query_pairs(spacing(points) / 4, output_type="ndarray")
            return np.delete(points, np.unique(pairs.max(axis=1, initial=0)), axis=0)
        return points

    def pivot(self, points: Points, rng: np.random.Generator | None) -> MeshLab:
        """Return the document after normals and ball pivoting."""
        meshlab = MeshLab(points)
        if self.change == "oriented":
            meshlab = MeshLab(points, normals=oriented_normals(points))
        else:
            meshlab.estimate_normals(NORMAL_NEIGHBOURS)
        if self.stage == "normals":
            meshlab = MeshLab(points, normals=self._moved("normals", meshlab.normals(), rng))
        meshlab.ball_pivoting()
        if self.stage == "pivoted":  # MeshLab makes the normals of an imported mesh anew
            return self._imported(meshlab, rng)
        return meshlab

    def close(self, meshlab: MeshLab, rng: np.random.Generator | None) -> MeshLab:
        """Close the holes of a document, and return what APSS gets."""
        meshlab.close_holes(MAX_HOLE_EDGES, intersecting=self.change == "crossing")
        if self.stage == "closed":
            meshlab = self._imported(meshlab, rng)
        if self.change == "used":
            mesh = meshlab.mesh(NEUTRAL_GREY)
            used, faces = np.unique(mesh.faces, return_inverse=True)
            return MeshLab(mesh.vertices[used], faces=faces.reshape(-1, 3))
        if self.change == "unit":
            normals = meshlab.normals()
            lengths = np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
            return MeshLab(meshlab.mesh(NEUTRAL_GREY).vertices, normals=normals / lengths)
        return meshlab

    def _imported(self, meshlab: MeshLab, rng: np.random.Generator | None) -> MeshLab:
        """Return a document with the same mesh, its vertices moved."""
        mesh = meshlab.mesh(NEUTRAL_GREY)
        vertices = self._moved(self.stage, mesh.vertices, rng)
        return MeshLab(vertices, normals=meshlab.normals(), faces=mesh.faces)

    def _moved(self, stage: str, values: Floats, rng: np.random.Generator | None) -> Floats:
        """Return numbers a rounding error below, the same, or above, where it is their stage."""
        if stage != self.stage or rng is None:
            return values
        towards = rng.integers(-1, 2, values.shape).astype(values.dtype)
        return np.nextafter(values, values + towards)


def oriented_normals(points: Points) -> NDArray[np.float64]:
    """Return unit normals whose signs agree along a spanning tree (Hoppe et al. 1992)."""
    exact = points.astype(np.float64)
    distances, near = map(np.asarray, cKDTree(exact).query(exact, NORMAL_NEIGHBOURS + 1))
    patches = exact[near] - exact[near].mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", patches, patches))
    normals = axes[:, :, 0]
    rows = np.repeat(np.arange(len(exact)), NORMAL_NEIGHBOURS)
    columns = near[:, 1:].ravel()
    differ = 1 - np.abs(np.sum(normals[rows] * normals[columns], axis=1))
    # a weight of 0 would be no edge; far neighbours come last among equal ones
    weights = differ + 1e-6 + 1e-3 * distances[:, 1:].ravel()
    tree = minimum_spanning_tree(csr_matrix((weights, (rows, columns))))
    visited = np.zeros(len(exact), bool)
    for start in np.argsort(-exact[:, 2], kind="stable"):
        if visited[start]:
            continue
        normals[start] *= np.copysign(1, normals[start, 2])  # the highest one points up
        order, before = breadth_first_order(tree, start, directed=False)
        visited[order] = True
        for point in order[1:]:
            if normals[point] @ normals[before[point]] < 0:
                normals[point] *= -1
    return normals


def scores_of(case: Case) -> NDArray[np.float64]:
    """Return the metrics of each repetition, means over views, [1 + repetitions, metrics].

    Nothing is moved in the first one.
    """
    scene = make_chairs(case.chair + 1, case.views, 0, case.condition)
    views = scene.views[case.chair]
    truth = render_all([scene.meshes[case.chair]], [views])[0]
    chain = Chain(case.stage, case.change)
    values = []
    for repetition in range(1 + case.repetitions):
        rng = generator("apss digits", case.condition, case.chair, repetition)
        mesh = chain.reconstruct(scene.clouds[case.chair].points, rng if repetition else None)
        scored = all_scores(truth, draw_mesh(mesh, views))
        values.append([np.nanmean(scored[metric]) for metric in METRICS])
    return np.array(values)


def other_faces(case: Case) -> NDArray[np.float64]:
    """Return how much is another than where nothing is moved, [repetitions, 3].

    The columns are the faces after ball pivoting, those after closing holes, and the points whose
    normal then differs by more than 8 degrees.
    """
    points = make_chairs(case.chair + 1, 1, 0, case.condition).clouds[-1].points
    chain = Chain(case.stage, case.change)

    def state(rng: np.random.Generator | None) -> tuple[set[bytes], set[bytes], Floats]:
        pivoted = chain.pivot(chain.start(points, rng), rng)
        faces = _face_set(pivoted)
        closed = chain.close(pivoted, rng)  # the same document, changed
        lengths = np.maximum(np.linalg.norm(closed.normals(), axis=1, keepdims=True), 1e-12)
        return faces, _face_set(closed), closed.normals() / lengths

    before = state(None)
    counts = []
    for repetition in range(1, 1 + case.repetitions):
        after = state(generator("apss digits", case.condition, case.chair, repetition))
        cosines = np.sum(before[2] * after[2], axis=1)
        turned = int((cosines < np.cos(np.radians(8))).sum())
        counts.append((len(before[0] - after[0]), len(before[1] - after[1]), turned))
    return np.array(counts, float)


def _face_set(meshlab: MeshLab) -> set[bytes]:
    """Return the faces of a document, whatever their order and their first corner."""
    faces = meshlab.mesh(NEUTRAL_GREY).faces
    first = np.argmin(faces, axis=1)[:, None]
    turned = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    return {face.tobytes() for face in turned}


def measure(
    cases: Sequence[Case], work: Callable[[Case], NDArray[np.float64]], workers: int
) -> list[NDArray[np.float64]]:
    """Return what `work` gives for each case. Raises RuntimeError where a worker is lost."""
    results = []
    for case, values in run_tasks(cases, work, workers, LIMITS):
        if isinstance(values, WorkerFailure):
            raise RuntimeError(f"{case}: {values.reason}")
        results.append(values)
    return results


def row(of_chairs: Sequence[NDArray[np.float64]]) -> list[str]:
    """Return mean and deviation of each metric, from the repetitions of each chair."""
    means = np.mean([values[0] for values in of_chairs], axis=0)
    variances = [values.var(axis=0, ddof=1) for values in of_chairs]
    deviations = np.sqrt(np.mean(variances, axis=0))
    return [f"{m:.4f} ± {d:.2g}" for m, d in zip(means, deviations, strict=True)]


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="Where surface-apss loses its digits.")
    parser.add_argument("--condition", default="2048")
    parser.add_argument("--chairs", type=positive, default=4)
    parser.add_argument("--views", type=positive, default=4)
    parser.add_argument("--repetitions", type=int, default=30)
    parser.add_argument("--stages", type=names, default=STAGES)
    parser.add_argument("--changes", type=names, default=("none",))
    parser.add_argument("--workers", type=positive, default=1)
    parser.add_argument("--faces", action="store_true", help="count faces, without APSS")
    options = parser.parse_args()
    columns = FACES if options.faces else METRICS
    print(markdown(["condition", "stage", "change", *columns], [], left=3), end="")
    for stage, change in product(options.stages, options.changes):
        cases = [
            Case(options.condition, chair, stage, change, options.views, options.repetitions)
            for chair in range(options.chairs)
        ]
        if options.faces:
            counts = np.concatenate(measure(cases, other_faces, options.workers))
            cells = [f"{count:.2f}" for count in counts.mean(axis=0)]
        else:
            cells = row(measure(cases, scores_of, options.workers))
        print(f"| {' | '.join((options.condition, stage, change, *cells))} |", flush=True)


if __name__ == "__main__":
    main()
