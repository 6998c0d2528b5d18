"""Defects of the libraries underneath, each shown on the bare library, past our own guards.

A case here passes while the defect is there. It fails when the library no longer shows it, or shows
it otherwise: then the guard that it names can be removed, and the case with it, or has to be looked
at anew. Every case runs in a worker that can be killed; nothing is written to disk.
"""

from __future__ import annotations

import hashlib
import io
import os
import pkgutil
import re
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from textwrap import shorten
from typing import Any, NamedTuple

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from baselines.reconstruction.meshlab import MeshLab
from baselines.reconstruction.surface import MAX_HOLE_EDGES, NORMAL_NEIGHBOURS
from bench.catalogue.suites import Limits
from bench.running.pool import WORKER_ENVIRONMENT, WorkerFailure, run_tasks
from data_prep.scene import NEUTRAL_GREY

pytestmark = pytest.mark.slow

LIMITS = Limits(time_s=30.0, memory_gib=1.0)  # 20 times what the slowest one needs
ROOT = Path(__file__).parents[2]
CLAIMED = 15 * 10**7  # rows of three float32: 1.7 GiB, more than the limit

Points = NDArray[Any]  # [N, 3], of the precision that a demonstration needs


class Defect(NamedTuple):
    """A demonstration, a pattern of its answer, and the name of our guard against the defect."""

    demonstrate: Callable[[], str]
    shows: str
    guard: str


DEFECTS: dict[str, Defect] = {}


def defect(shows: str, guard: str) -> Callable[[Callable[[], str]], Callable[[], str]]:
    """Enter a demonstration in DEFECTS.

    shows  regular expression that is in the answer of the demonstration as long as the defect
           exists, in "raises TYPE: MESSAGE" where it raises, or in the reason of `WorkerFailure`
    guard  the function, class or module of ours that contains the defect
    """

    def enter(demonstrate: Callable[[], str]) -> Callable[[], str]:
        DEFECTS[demonstrate.__name__] = Defect(demonstrate, shows, guard)
        return demonstrate

    return enter


def show(name: str) -> str:
    """Return the answer of a demonstration, or its exception, in a worker."""
    _, most = resource.getrlimit(resource.RLIMIT_CORE)
    resource.setrlimit(resource.RLIMIT_CORE, (0, most))  # a crash leaves no file behind
    try:
        return DEFECTS[name].demonstrate()
    except Exception as error:
        return shorten(f"raises {type(error).__name__}: {error}", 120)


def box(seed: int = 1) -> Points:
    """2,048 points [2048, 3], uniform on the faces of the unit box."""
    rng, count = np.random.default_rng(seed), 2048
    points = rng.uniform(-0.5, 0.5, (count, 3))
    points[np.arange(count), rng.integers(0, 3, count)] = rng.integers(0, 2, count) - 0.5
    return points


def with_first(point: float) -> Points:
    points = box()
    points[0] = point
    return points


def pivoted(points: Points) -> MeshLab:
    """The chain of `baselines.reconstruction.surface` up to ball pivoting, without its checks."""
    meshlab = MeshLab(points)
    meshlab.estimate_normals(NORMAL_NEIGHBOURS)
    meshlab.ball_pivoting()
    return meshlab


def apss(points: Points, resolution: int) -> tuple[Points, int]:
    """Vertices [V, 3] and number of faces of the whole chain, without its checks."""
    meshlab = pivoted(points)
    meshlab.close_holes(MAX_HOLE_EDGES)
    meshlab.marching_cubes_apss(resolution)
    return meshlab.mesh(NEUTRAL_GREY).vertices, meshlab.face_count


@defect(r"^timeout: no result within 30 s$", "baselines.reconstruction.stages.check_points")
def pymeshlab_apss_hangs_on_an_infinite_point() -> str:
    """One infinite point of 2,048: APSS never returns."""
    _, faces = apss(with_first(np.inf), 50)
    return f"{faces} faces"


@defect(
    r"^crash: the worker died \(SIGSEGV\)$", "baselines.reconstruction.surface.NORMAL_NEIGHBOURS"
)
def pymeshlab_normals_of_no_neighbours_crash() -> str:
    """Normals from 0 neighbours: a segmentation fault, where -1 raises."""
    meshlab = MeshLab(box())
    meshlab.estimate_normals(0)
    return "normals of no neighbours"


@defect(r"^crash: the worker died \(SIGFPE\)$", "baselines.reconstruction.surface.RESOLUTION")
def pymeshlab_apss_crashes_on_a_negative_grid() -> str:
    """A grid of -5 cells: APSS divides by 0 and ends the process."""
    meshlab = pivoted(box())
    meshlab.marching_cubes_apss(-5)
    return f"{meshlab.face_count} faces"


@defect(r"^memory: the worker used more than 1 GiB$", "data_prep.files.clouds.load_points")
def plyfile_believes_a_header() -> str:
    """A PLY of 200 bytes that claims 1.5e8 vertices: memory is taken for all of them."""
    from plyfile import PlyData

    text = f"ply\nformat binary_little_endian 1.0\nelement vertex {CLAIMED}\n"
    text += "property float x\nproperty float y\nproperty float z\nend_header\n"
    PlyData.read(io.BytesIO(text.encode() + bytes(12)))  # there is one vertex
    return "read"


@defect(r"^memory: the worker used more than 1 GiB$", "data_prep.files.clouds.load_points")
def numpy_believes_a_header() -> str:
    """An NPY of 128 bytes that claims 1.5e8 rows: memory is taken for all of them."""
    file = io.BytesIO()
    header = {"descr": "<f4", "fortran_order": False, "shape": (CLAIMED, 3)}
    np.lib.format.write_array_header_1_0(file, header)  # and no values at all
    file.seek(0)
    np.load(file)
    return "read"


@defect(r"^crash: the worker died \(SIG", "pc2pix.losses.chamfer")
def scipy_tree_of_half_a_plane_crashes() -> str:
    """KDTree steps from a median of 0 to a denormal number; flushed to 0, that never ends.

    Trainings flush denormals; `chamfer` splits in the middle.
    """
    import torch
    from scipy.spatial import KDTree

    points = np.random.default_rng(0).uniform(size=(100, 3))
    points[:60, 0] = 0.0
    points[60:, 0] *= 4.0
    torch.set_flush_denormal(True)
    return f"a tree of {KDTree(points).n} points"


@defect(r"^[1-9]\d* of \d+ vertices are not finite", "baselines.reconstruction.stages.finite_part")
def pymeshlab_apss_gives_nan_for_a_clean_box() -> str:
    """Clean points of a box: APSS writes vertices that are not finite."""
    # Few vertices of few clouds, and which ones depends on rounding: hence several clouds.
    seeds_and_resolutions = ((1, 50), (14, 50), (58, 50), (1, 100))
    clouds = [apss(box(seed), resolution)[0] for seed, resolution in seeds_and_resolutions]
    bad = sum(count_bad(vertices) for vertices in clouds)
    return f"{bad} of {sum(map(len, clouds))} vertices are not finite"


def count_bad(rows: Points) -> int:
    return int((~np.isfinite(rows)).any(axis=1).sum())


@defect(
    r"^(\w{8}) and \1 over zeros, (?!\1)\w{8} over another fill$",
    "bench.running.pool.WORKER_ENVIRONMENT",
)
def pymeshlab_apss_reads_unwritten_memory() -> str:
    """The result of APSS depends on what memory held before."""
    code = f"from {__name__} import apss_digest; print(apss_digest())"
    digests = []
    for fill in ("255", "255", "1"):  # 255 as in the workers, which is a fill of zeros
        tunables = WORKER_ENVIRONMENT["GLIBC_TUNABLES"].replace("=255", f"={fill}")
        child = subprocess.run(
            [sys.executable, "-c", code],
            env=os.environ | {"GLIBC_TUNABLES": tunables},
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
            timeout=LIMITS.time_s,
        )
        digests.append(child.stdout.strip())
    same, again, other = digests
    return f"{same} and {again} over zeros, {other} over another fill"


def apss_digest() -> str:
    """Return a digest of the vertices of one reconstruction in this process."""
    vertices, _ = apss(box(), 50)
    return hashlib.sha256(vertices.tobytes()).hexdigest()[:8]


@defect(
    r"^finite normals; \d{1,3} and \d{1,3} faces, where the clean cloud has \d{4}$",
    "baselines.reconstruction.stages.check_points",
)
def pymeshlab_normals_hide_what_is_not_finite() -> str:
    """An infinite point or NaN: normals are finite, and ball pivoting silently loses faces."""
    counts = []
    for value in (np.inf, np.nan):
        meshlab = pivoted(with_first(value))
        counts.append(meshlab.face_count)
        if not np.isfinite(meshlab.normals()).all():
            return "a normal is not finite"
    whole = pivoted(box()).face_count
    return f"finite normals; {counts[0]} and {counts[1]} faces, where the clean cloud has {whole}"


@defect(
    r"^(\d+) faces, (?!\1 )\d+ of the same points in reverse$",
    "data_prep.clouds.sampling.sample_surface",
)
def pymeshlab_ball_pivoting_depends_on_the_order() -> str:
    """Ball pivoting makes another mesh of the same points in reverse."""  # ours seeds it
    counts = [pivoted(points).face_count for points in (box(), box()[::-1].copy())]
    return "{} faces, {} of the same points in reverse".format(*counts)


@defect(r"^crash: the worker died \(SIGSEGV\)$", "baselines.reconstruction.alpha_wrap.SPECK")
def pymeshlab_alpha_wrap_of_points_crashes() -> str:
    """The alpha wrap of points without faces: a segmentation fault. CGAL can wrap points."""
    meshlab = MeshLab(box())
    meshlab.alpha_wrap(0.1, 0.01)
    return f"{meshlab.face_count} faces"


SQUARE = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 0, 0), (1, 1, 0), (0, 1, 0))  # two triangles


def ply(vertices: Any, faces: Any = None) -> io.BytesIO:
    lines = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    if faces is not None:
        lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    lines += ["end_header"]
    lines += [" ".join(map(str, vertex)) for vertex in vertices]
    lines += [" ".join(map(str, (len(face), *face))) for face in faces or ()]
    return io.BytesIO(("\n".join(lines) + "\n").encode())


def load(file: io.BytesIO, **options: Any) -> Any:
    return trimesh.load(file, file_type="ply", **options)


@defect(r"^3 points, where the header has 9; refused$", "data_prep.files.clouds.load_points")
def trimesh_reads_part_of_a_cloud() -> str:
    """A PLY in text that is cut short loads as if it were whole; faces of 3 and 4 corners in a
    binary one are refused."""
    from plyfile import PlyData, PlyElement

    cut = io.BytesIO(ply(SQUARE[:3]).getvalue().replace(b"vertex 3", b"vertex 9"))
    cut_short = load(cut)
    corners = np.array([tuple(map(float, c)) for c in SQUARE], [(axis, "f4") for axis in "xyz"])
    faces = np.array([([0, 1, 2],), ([0, 1, 2, 5],)], [("vertex_indices", object)])
    mixed = io.BytesIO()
    PlyData([PlyElement.describe(corners, "vertex"), PlyElement.describe(faces, "face")]).write(
        mixed
    )
    mixed.seek(0)
    try:
        load(mixed)
        other = "reads both"
    except ValueError:
        other = "refused"
    return f"{len(cut_short.vertices)} points, where the header has 9; {other}"


@defect(
    r"^relative 3\.5 of 0\.5, concave 3\.0 of 1\.0$",
    "data_prep.files.meshes.read_contents",
)
def trimesh_reads_other_meshes() -> str:
    """Indices of an OBJ that count backwards count from the end of the file, and concave polygons
    are fans."""

    def area(text: str) -> float:
        return round(float(trimesh.load(io.StringIO(text), file_type="obj").area), 6)

    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    relative = area(f"{corners}f -3 -2 -1\nv 0 8 0\n")
    concave = area("v 0 0 0\nv 2 0 0\nv .5 .5 0\nv 0 2 0\nf 2 3 4 1\n")
    return f"relative {relative} of 0.5, concave {concave} of 1.0"


@pytest.fixture(scope="module")
def observed() -> dict[str, str]:
    """Return the answer of each demonstration; some 40 s with two workers."""
    results = run_tasks(list(DEFECTS), show, 2, LIMITS)
    return {
        name: seen.reason if isinstance(seen, WorkerFailure) else seen for name, seen in results
    }


@pytest.mark.upstream
@pytest.mark.parametrize("name", DEFECTS)
def test_the_defect_is_still_there(name: str, observed: dict[str, str]) -> None:
    demonstrate, shows, guard = DEFECTS[name]
    assert re.search(shows, observed[name]), (
        f"{demonstrate.__doc__} If the library is fixed, remove this case and its guard, {guard}."
    )


def test_the_guards_are_there() -> None:
    for defect in DEFECTS.values():
        pkgutil.resolve_name(defect.guard)
