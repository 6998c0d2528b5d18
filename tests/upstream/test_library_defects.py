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
import types
import warnings
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
from bench.running.isolation import WORKER_ENVIRONMENT, WorkerFailure, run_tasks
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
    "bench.running.isolation.WORKER_ENVIRONMENT",
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
    r"^[1-9]\d* faces from ball pivoting, 0 from APSS",
    "baselines.reconstruction.surface.SurfaceApss.prepare",
)
def pymeshlab_apss_makes_nothing_of_a_plane() -> str:
    """Points of one plane: APSS returns an empty mesh and reports nothing."""
    points = np.random.default_rng(0).uniform(-1, 1, (2048, 3)) * (1, 0, 1)
    meshlab = pivoted(points)
    before = meshlab.face_count
    meshlab.close_holes(MAX_HOLE_EDGES)
    meshlab.marching_cubes_apss(50)
    return f"{before} faces from ball pivoting, {meshlab.face_count} from APSS"


@defect(r"^\d{3,} of \d+ vertices are not finite", "data_prep.clouds.normalise.normalise_points")
def pymeshlab_apss_breaks_far_from_the_origin() -> str:
    """A box shifted by 1e6: APSS writes thousands of vertices that are not finite."""
    vertices, _ = apss(box() + 1e6, 50)
    return f"{count_bad(vertices)} of {len(vertices)} vertices are not finite"


@defect(r"^\d{5,} faces", "bench.running.isolation.Limits")
def pymeshlab_apss_makes_a_blob_of_16_points() -> str:
    """16 points, and half the resolution: APSS makes a mesh of tens of thousands of faces."""
    directions = np.random.default_rng(0).standard_normal((16, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return f"{apss(directions, 100)[1]} faces"


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
    r"^[1-9]\d* faces of points that coincide",
    "baselines.reconstruction.surface.SurfaceApss.prepare",
)
def pymeshlab_ball_pivoting_of_one_place() -> str:
    """2,048 points that coincide: ball pivoting makes faces of them."""
    meshlab = pivoted(np.zeros((2048, 3)))
    return f"{meshlab.face_count} faces of points that coincide"


@defect(r"^0 faces", "baselines.reconstruction.surface.SurfaceApss.prepare")
def pymeshlab_ball_pivoting_of_a_line() -> str:
    """Points of one line: ball pivoting makes no face and reports nothing."""
    return f"{pivoted(np.linspace(0, 1, 2048)[:, None] * (1.0, 0.0, 0.0)).face_count} faces"


@defect(
    r"^raises RuntimeError: .*does not have", "baselines.reconstruction.surface.SurfaceApss.prepare"
)
def pymeshlab_close_holes_without_faces() -> str:
    """No faces: closing holes raises, where there is nothing to do."""
    MeshLab(box()).close_holes(MAX_HOLE_EDGES)
    return "nothing to close"


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


TRIANGLE = np.array(((-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (0.0, 1.0, 0.0)))
WHITE = (1.0, 1.0, 1.0, 1.0)
SIDE = 32  # pixels


def pyrender() -> Any:
    """The library without its viewer, which needs packages that nobody here uses."""
    os.environ["PYOPENGL_PLATFORM"] = "egl"
    viewer = types.ModuleType("pyrender.viewer")
    viewer.Viewer = None
    sys.modules.setdefault(viewer.__name__, viewer)
    import pyrender

    return pyrender


def scene(
    background: tuple[float, float, float, float],
    triangle: Points,
    faces: NDArray[np.uint32] | None = None,
) -> Any:
    """A red triangle seen from +Z; one without extent adds nothing."""
    library = pyrender()
    np.infty = np.inf  # noqa: NPY201
    result = library.Scene(bg_color=list(background), ambient_light=[1.0, 1.0, 1.0])
    red = library.MetallicRoughnessMaterial(baseColorFactor=[1.0, 0.0, 0.0, 1.0])
    positions = triangle.astype(np.float32)
    result.add(library.Mesh([library.Primitive(positions=positions, indices=faces, material=red)]))
    pose = np.eye(4)
    pose[2, 3] = 4.0
    result.add(library.PerspectiveCamera(yfov=0.5), pose=pose)
    return result


def image(shown: Any) -> NDArray[np.uint8]:
    library = pyrender()
    renderer = library.OffscreenRenderer(SIDE, SIDE)
    try:
        return renderer.render(shown, flags=library.RenderFlags.SKIP_CULL_FACES)[0]
    finally:
        renderer.delete()


def drawn(shown: Any) -> str:
    count = int((image(shown)[..., 1] < 255).sum())
    return f"{count} of {SIDE * SIDE} pixels drawn"


@defect(r"^background [01], and 255 from floats", "data_prep.rendering.opengl.render")
def pyrender_background_of_integers_is_black() -> str:
    """A white background in integers comes out black."""
    levels = [
        int(image(scene(background, np.zeros((3, 3))))[0, 0, 0])
        for background in ((1, 1, 1, 1), WHITE)
    ]
    return "background {}, and {} from floats".format(*levels)


@defect(r"^raises AttributeError: .*np\.infty", "data_prep.rendering.opengl.render")
def pyrender_does_not_know_numpy_2() -> str:
    """The extent of a scene reads np.infty, which NumPy 2 has not."""
    red = scene(WHITE, TRIANGLE)
    del np.infty  # noqa: NPY201
    return f"scale {red.scale:g}"


@defect(
    r"^0 of 1024 pixels drawn, without the NaN [1-9]\d* of", "data_prep.rendering.opengl.render"
)
def pyrender_does_not_draw_a_nan_vertex() -> str:
    """A face with a NaN vertex is not drawn, and nothing is reported."""
    broken = TRIANGLE.copy()
    broken[0, 0] = np.nan
    whole = drawn(scene(WHITE, TRIANGLE))
    return f"{drawn(scene(WHITE, broken))}, without the NaN {whole}"


# what is found depends on the driver
@defect(r"^\d+ of 1024 pixels drawn|^crash", "data_prep.scene.Mesh")
def pyrender_draws_an_index_out_of_range() -> str:
    """A face with a vertex that is not there is drawn with whatever is found in its place."""
    return drawn(scene(WHITE, TRIANGLE, np.array([[0, 1, 99]], np.uint32)))


@defect(r"^the other one raises EGLError", "data_prep.rendering.opengl._context")
def pyrender_renderers_share_a_display() -> str:
    """Deleting one of two renderers breaks the other. We have one context a process."""
    library = pyrender()
    red = scene(WHITE, TRIANGLE)
    first, second = (library.OffscreenRenderer(SIDE, SIDE) for _ in range(2))
    first.render(red)
    second.delete()
    try:
        first.render(red)
    except Exception as error:
        return f"the other one raises {type(error).__name__}"
    first.delete()
    return "the other one still draws"


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


@defect(r"^4 of 6 vertices", "data_prep.files.meshes.load_mesh")
def trimesh_merges_vertices() -> str:
    """Loading merges equal vertices by default (`process`), and changes the surface."""
    loaded = load(ply(SQUARE, ((0, 1, 2), (3, 4, 5))))
    return f"{len(loaded.vertices)} of {len(SQUARE)} vertices"


@defect(r"^a Trimesh of 0 vertices", "data_prep.files.meshes.load_mesh")
def trimesh_loads_points_as_an_empty_mesh() -> str:
    """A PLY of points only loads as an empty mesh, and nothing is reported."""
    loaded = trimesh.load_mesh(ply(SQUARE), file_type="ply")
    return f"a {type(loaded).__name__} of {len(loaded.vertices)} vertices"


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


@defect(r"\[0, 1, 99\] of 3$", "data_prep.scene.Mesh")
def trimesh_keeps_an_index_out_of_range() -> str:
    """A face may name a vertex that is not there."""
    loaded = load(ply(SQUARE[:3], ((0, 1, 99),)), process=False)
    return f"a face with the vertices {loaded.faces[0].tolist()} of {len(loaded.vertices)}"


@defect(r"^bounds \[nan", "data_prep.clouds.normalise.normalise")
def trimesh_keeps_a_nan_vertex() -> str:
    """NaN loads as a coordinate, and nothing is reported."""
    loaded = load(ply((("nan", 0, 0), *SQUARE[1:3]), ((0, 1, 2),)), process=False)
    return f"bounds {loaded.bounds[0].tolist()}"


def cast_nan(cast: Callable[[float], Any]) -> str:
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        pixel = int(cast(np.nan))
    return f"pixel {pixel}, {f'a {seen[0].category.__name__}' if seen else 'no warning'}"


@defect(r"^pixel \d+, a RuntimeWarning$", "bench.running.work.checked_images")
def numpy_makes_a_pixel_of_nan() -> str:
    """NaN cast to uint8 is some number, with no more than a warning."""
    return cast_nan(lambda nan: np.array([nan]).astype(np.uint8)[0])


@defect(r"^variance inf", "bench.metrics.frechet.checked_features")
def numpy_moments_overflow_in_half_precision() -> str:
    """The variance of float16 values overflows from 256 on."""
    with np.errstate(over="ignore"):
        return f"variance {np.array([-1000, 1000], np.float16).var()} of -1000 and 1000"


@defect(r"^raises LinAlgError: SVD did not converge", "bench.metrics.frechet.checked_features")
def numpy_decomposition_names_no_cause() -> str:
    """Singular values of NaN: 'did not converge', which names no cause."""
    return str(np.linalg.svd(np.full((2, 2), np.nan), compute_uv=False))


@defect(r"^(complex|negative): ", "bench.metrics.frechet.centred_to_frechet")
def scipy_matrix_root_turns_complex() -> str:
    """sqrtm for identical sets of 20 rows and 256 features: a complex or negative distance."""
    from scipy.linalg import sqrtm

    features = np.random.default_rng(0).standard_normal((20, 256))
    covariance = np.cov(features, rowvar=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # some versions say that the product is singular
        trace = complex(np.trace(sqrtm(covariance @ covariance)))
    distance = 2 * complex(np.trace(covariance)) - 2 * trace
    if abs(distance.imag) > 1e-9:  # of a trace of 512: rounding would leave 1e-12
        return f"complex: {distance:.1e}"
    return f"{'negative' if distance.real < -1e-9 else 'real'}: {distance.real:.1e}"


@defect(r"^neighbour 1 of 1 point, at inf$", "baselines.splat.Splat.prepare")
def scipy_finds_a_neighbour_that_is_not_there() -> str:
    """The second neighbour in a tree of one point: an index out of range, at infinity."""
    from scipy.spatial import cKDTree

    distance, index = cKDTree(np.zeros((1, 3))).query(np.zeros(3), k=[2])
    return f"neighbour {np.ravel(index)[0]} of 1 point, at {np.ravel(distance)[0]}"


@defect(r"^interval nan to nan", "bench.analysis.intervals.mean_interval")
def scipy_bootstrap_of_equal_values() -> str:
    """Equal values: the default bootstrap has no interval. Ours takes percentiles."""
    from scipy.stats import bootstrap

    with warnings.catch_warnings(), np.errstate(invalid="ignore"):
        warnings.simplefilter("ignore")
        result = bootstrap((np.ones(5),), np.mean, rng=np.random.default_rng(0))
    return f"interval {result.confidence_interval.low} to {result.confidence_interval.high}"


@defect(r"^means \{'a': 1\.0, 'b': nan\}, 1\.0$", "bench.tables")
def pandas_leaves_failures_out_of_the_mean() -> str:
    """Means leave NaN out, and nothing is reported. Ours stand beside n_ok of n."""
    import pandas as pd

    frame = pd.DataFrame({"object": ["a", "a", "b"], "score": [1.0, np.nan, np.nan]})
    return f"means {frame.groupby('object')['score'].mean().to_dict()}, {frame['score'].mean()}"


@defect(r"^pixel \d+, no warning$", "bench.running.work.checked_images")
def torch_makes_a_pixel_of_nan() -> str:
    """NaN cast to uint8 is some number, and nothing is reported."""
    import torch

    return cast_nan(lambda nan: torch.tensor([nan]).to(torch.uint8)[0])


@defect(r"^raises ValueError: .*negative", "bench.judges.views.view_features")
def torch_refuses_mirrored_arrays() -> str:
    """Arrays with negative strides, a mirrored image say, are refused."""
    import torch

    return f"{torch.from_numpy(np.arange(3)[::-1]).tolist()}"


def similarity(a: NDArray[Any], b: NDArray[Any], **options: Any) -> str:
    from skimage.metrics import structural_similarity

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the range is guessed
        return f"ssim {float(structural_similarity(a, b, gaussian_weights=True, **options))}"


@defect(r"^ssim 1\.0$", "bench.metrics.structural_similarity.require_images")
def skimage_guesses_the_range() -> str:
    """Black and white in int64: the range is guessed from the type, and they are alike."""
    return similarity(np.zeros((16, 16), np.int64), np.full((16, 16), 255, np.int64))


@defect(r"^ssim nan$", "bench.metrics.structural_similarity.require_images")
def skimage_accepts_a_nan_pixel() -> str:
    """A NaN pixel: SSIM is NaN, and nothing is reported."""
    broken = np.full((16, 16), 0.5)
    broken[8, 8] = np.nan
    return similarity(np.full((16, 16), 0.5), broken, data_range=1.0)


@defect(
    r"^raises ValueError: win_size exceeds", "bench.metrics.structural_similarity.window_weights"
)
def skimage_refuses_small_images() -> str:
    """Images with a side below the window of 11 are refused."""
    image = np.zeros((10, 10), np.uint8)
    return similarity(image, image, data_range=255)


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
