"""Defects of the libraries underneath, each shown on the bare library, past our own guards.

What the harness contains it should be seen to contain: every defect says what of ours stands
between it and a record, and is demonstrated here in a worker that can be killed. One that no longer
shows is reported too, so that a guard which has become idle is known to be. Nothing is written to
disk: what has to be a file is one in memory.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import resource
import subprocess
import sys
import types
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from textwrap import shorten
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.meshlab import MeshLab
from baselines.surface import MAX_HOLE_EDGES, NORMAL_NEIGHBOURS
from bench.catalogue.suites import Limits
from bench.running.isolation import WORKER_ENVIRONMENT, Lost, run_tasks
from bench.suites.stability.expectations import Outcome
from data_prep.mesh_files import NEUTRAL_GREY

GROUP = "library"
LIMITS = Limits(time_s=15.0, memory_gib=1.0)  # ten times what the slowest one needs
NOT_INSTALLED = "not installed"
_CLAIMED = 15 * 10**7  # rows of three float32: 1.7 GiB, more than the limit

Points = NDArray[Any]  # [N, 3], of the precision that a demonstration needs


@dataclass(frozen=True)
class Defect:
    """One defect of a library, and what contains it.

    about        what happens, for people
    demonstrate  makes it happen and says what was seen; runs in a worker, may hang or crash
    shows        regular expression, found in what was seen where the defect is there. What was seen
                 is the answer of `demonstrate`, "raises TYPE: MESSAGE" where that raised, or the
                 reason of `bench.running.isolation.Lost`
    remedy       where and how our code contains it
    """

    id: str
    library: str
    about: str
    demonstrate: Callable[[], str]
    shows: str
    remedy: str


def library_outcomes(workers: int) -> list[Outcome]:
    """All defects, library by library; some 20 s with two workers.

    A defect that is as stated is "contained"; one that is not is "unexpected".
    """
    seen = {
        defect_id: result.reason if isinstance(result, Lost) else result
        for defect_id, result in run_tasks([d.id for d in DEFECTS], demonstrate, workers, LIMITS)
    }
    libraries = list(dict.fromkeys(defect.library for defect in DEFECTS))
    outcomes = [_outcome(defect, seen[defect.id]) for defect in DEFECTS]
    return sorted(outcomes, key=lambda outcome: libraries.index(outcome.subject))


def demonstrate(defect_id: str) -> str:
    """What a defect looks like here and now; for a worker. Whatever it raises is part of that."""
    (defect,) = (d for d in DEFECTS if d.id == defect_id)
    _, most = resource.getrlimit(resource.RLIMIT_CORE)
    resource.setrlimit(resource.RLIMIT_CORE, (0, most))  # a crash leaves no file behind
    try:
        return defect.demonstrate()
    except Exception as error:
        return shorten(f"raises {type(error).__name__}: {error}", 120)


def _outcome(defect: Defect, seen: str) -> Outcome:
    shows = re.search(defect.shows, seen) is not None
    return Outcome(
        case=defect.id,
        group=GROUP,
        subject=defect.library,
        expected=f"{defect.about}; contained by {defect.remedy}",
        observed=seen if shows else f"{seen}; not as stated, the library may have been mended",
        kind="contained" if shows else "unexpected",
    )


# --- pymeshlab ------------------------------------------------------------------------------------


def _box(seed: int = 1, count: int = 2048) -> Points:
    """`count` points [count, 3], uniform on the faces of the unit box."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, (count, 3))
    points[np.arange(count), rng.integers(0, 3, count)] = rng.integers(0, 2, count) - 0.5
    return points


def _with_first(point: float) -> Points:
    points = _box()
    points[0] = point
    return points


def _pivoted(points: Points) -> MeshLab:
    """The chain of `baselines.surface` up to ball pivoting, without its checks."""
    meshlab = MeshLab(points)
    meshlab.estimate_normals(NORMAL_NEIGHBOURS)
    meshlab.ball_pivoting()
    return meshlab


def _apss(points: Points, resolution: int) -> tuple[Points, int]:
    """Vertices [V, 3] and number of faces of the whole chain, without its checks."""
    meshlab = _pivoted(points)
    meshlab.close_holes(MAX_HOLE_EDGES)
    meshlab.marching_cubes_apss(resolution)
    return meshlab.mesh(NEUTRAL_GREY).vertices, meshlab.face_count


def _infinite_point_hangs() -> str:
    _, faces = _apss(_with_first(np.inf), 50)
    return f"{faces} faces"


def _clean_box_gives_nan() -> str:
    # Few vertices of few clouds, and which ones depends on rounding: hence several clouds.
    found = [_apss(_box(seed), resolution)[0] for seed, resolution in _BOXES]
    bad = sum(_count_bad(vertices) for vertices in found)
    return f"{bad} of {sum(map(len, found))} vertices are not finite"


_BOXES = ((1, 50), (14, 50), (58, 50), (1, 100))  # (seed, resolution)


def _count_bad(rows: Points) -> int:
    return int((~np.isfinite(rows)).any(axis=1).sum())


def apss_digest() -> str:
    """Of the vertices of one reconstruction in this process."""
    vertices, _ = _apss(_box(), 50)
    return hashlib.sha256(vertices.tobytes()).hexdigest()[:8]


def _memory_shows_through() -> str:
    code = "from bench.library_defects import apss_digest; print(apss_digest())"
    digests = []
    for fill in ("255", "255", "1"):  # 255 as in the workers, which is a fill of noughts
        tunables = WORKER_ENVIRONMENT["GLIBC_TUNABLES"].replace("=255", f"={fill}")
        child = subprocess.run(
            [sys.executable, "-c", code],
            env=os.environ | {"GLIBC_TUNABLES": tunables},
            capture_output=True,
            text=True,
            check=True,
            timeout=LIMITS.time_s,
        )
        digests.append(child.stdout.strip())
    same, again, other = digests
    return f"{same} and {again} over noughts, {other} over another fill"


def _coplanar_points_give_nothing() -> str:
    points = np.random.default_rng(0).uniform(-1, 1, (2048, 3)) * (1, 0, 1)
    meshlab = _pivoted(points)
    before = meshlab.face_count
    meshlab.close_holes(MAX_HOLE_EDGES)
    meshlab.marching_cubes_apss(50)
    return f"{before} faces from ball pivoting, {meshlab.face_count} from APSS"


def _shifted_cloud_breaks() -> str:
    vertices, _ = _apss(_box() + 1e6, 50)
    return f"{_count_bad(vertices)} of {len(vertices)} vertices are not finite"


def _few_points_make_a_blob() -> str:
    directions = np.random.default_rng(0).standard_normal((16, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return f"{_apss(directions, 100)[1]} faces"


def _crash_of_no_neighbours() -> str:
    meshlab = MeshLab(_box())
    meshlab.estimate_normals(0)
    return "normals of no neighbours"


def _crash_of_a_negative_grid() -> str:
    meshlab = _pivoted(_box())
    meshlab.marching_cubes_apss(-5)
    return f"{meshlab.face_count} faces"


def _normals_hide_what_is_not_finite() -> str:
    counts = []
    for value in (np.inf, np.nan):
        meshlab = _pivoted(_with_first(value))
        counts.append(meshlab.face_count)
        if not np.isfinite(meshlab.normals()).all():
            return "a normal is not finite"
    whole = _pivoted(_box()).face_count
    return f"finite normals; {counts[0]} and {counts[1]} faces, where the clean cloud has {whole}"


def _one_place_has_faces() -> str:
    meshlab = _pivoted(np.zeros((2048, 3)))
    return f"{meshlab.face_count} faces of points that coincide"


def _a_line_has_none() -> str:
    return f"{_pivoted(np.linspace(0, 1, 2048)[:, None] * (1.0, 0.0, 0.0)).face_count} faces"


def _no_faces_no_holes() -> str:
    MeshLab(_box()).close_holes(MAX_HOLE_EDGES)
    return "nothing to close"


def _order_matters() -> str:
    counts = [_pivoted(points).face_count for points in (_box(), _box()[::-1].copy())]
    return "{} faces, {} of the same points in reverse".format(*counts)


# --- pyrender -------------------------------------------------------------------------------------

_TRIANGLE = ((-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (0.0, 1.0, 0.0))
_FLOATS = (1.0, 1.0, 1.0, 1.0)
_SIDE = 32  # pixels
_White = tuple[float, float, float, float]


def _pyrender() -> Any:
    """The library without its viewer, which needs packages that nobody here uses."""
    os.environ["PYOPENGL_PLATFORM"] = "egl"
    viewer = types.ModuleType("pyrender.viewer")
    viewer.Viewer = None  # type: ignore[attr-defined]
    sys.modules.setdefault(viewer.__name__, viewer)
    import pyrender

    return pyrender


def _scene(background: _White, triangle: Points, faces: NDArray[np.uint32] | None = None) -> Any:
    """A red triangle seen from +Z; one without extent adds nothing."""
    pyrender = _pyrender()
    np.infty = np.inf  # type: ignore[attr-defined]  # noqa: NPY201
    scene = pyrender.Scene(bg_color=list(background), ambient_light=[1.0, 1.0, 1.0])
    red = pyrender.MetallicRoughnessMaterial(baseColorFactor=[1.0, 0.0, 0.0, 1.0])
    scene.add(
        pyrender.Mesh(
            [pyrender.Primitive(positions=triangle.astype(np.float32), indices=faces, material=red)]
        )
    )
    pose = np.eye(4)
    pose[2, 3] = 4.0
    scene.add(pyrender.PerspectiveCamera(yfov=0.5), pose=pose)
    return scene


def _picture(scene: Any) -> NDArray[np.uint8]:
    pyrender = _pyrender()
    renderer = pyrender.OffscreenRenderer(_SIDE, _SIDE)
    try:
        return renderer.render(scene, flags=pyrender.RenderFlags.SKIP_CULL_FACES)[0]
    finally:
        renderer.delete()


def _drawn(scene: Any) -> str:
    count = int((_picture(scene)[..., 1] < 255).sum())
    return f"{count} of {_SIDE * _SIDE} pixels drawn"


def _integers_are_black() -> str:
    triangle = np.zeros((3, 3))
    levels = [
        int(_picture(_scene(background, triangle))[0, 0, 0])
        for background in ((1, 1, 1, 1), _FLOATS)
    ]
    return "background {}, and {} from floats".format(*levels)


def _numpy_2_is_unknown() -> str:
    scene = _scene(_FLOATS, np.array(_TRIANGLE))
    del np.infty  # type: ignore[attr-defined]  # noqa: NPY201
    return f"scale {scene.scale:g}"


def _nan_vertex_vanishes() -> str:
    broken = np.array(_TRIANGLE)
    broken[0, 0] = np.nan
    whole = _drawn(_scene(_FLOATS, np.array(_TRIANGLE)))
    return f"{_drawn(_scene(_FLOATS, broken))}, without the NaN {whole}"


def _index_out_of_range_is_drawn() -> str:
    return _drawn(_scene(_FLOATS, np.array(_TRIANGLE), np.array([[0, 1, 99]], np.uint32)))


def _renderers_share_a_display() -> str:
    pyrender = _pyrender()
    scene = _scene(_FLOATS, np.array(_TRIANGLE))
    first, second = (pyrender.OffscreenRenderer(_SIDE, _SIDE) for _ in range(2))
    first.render(scene)
    second.delete()
    try:
        first.render(scene)
    except Exception as error:
        return f"the other one raises {type(error).__name__}"
    first.delete()
    return "the other one still draws"


# --- trimesh, plyfile -----------------------------------------------------------------------------

_SQUARE = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 0, 0), (1, 1, 0), (0, 1, 0))  # two triangles


def _ply(vertices: Any, faces: Any = None) -> io.BytesIO:
    lines = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    if faces is not None:
        lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    lines += ["end_header"]
    lines += [" ".join(map(str, vertex)) for vertex in vertices]
    lines += [" ".join(map(str, (len(face), *face))) for face in faces or ()]
    return io.BytesIO(("\n".join(lines) + "\n").encode())


def _vertices_are_merged() -> str:
    import trimesh

    loaded: Any = trimesh.load(_ply(_SQUARE, ((0, 1, 2), (3, 4, 5))), file_type="ply")
    return f"{len(loaded.vertices)} of {len(_SQUARE)} vertices"


def _points_are_no_mesh() -> str:
    import trimesh

    loaded: Any = trimesh.load_mesh(_ply(_SQUARE), file_type="ply")
    return f"a {type(loaded).__name__} of {len(loaded.vertices)} vertices"


def _index_out_of_range_is_kept() -> str:
    import trimesh

    file = _ply(_SQUARE[:3], ((0, 1, 99),))
    loaded: Any = trimesh.load(file, file_type="ply", process=False)
    return f"a face with the vertices {loaded.faces[0].tolist()} of {len(loaded.vertices)}"


def _nan_vertex_is_kept() -> str:
    import trimesh

    file = _ply((("nan", 0, 0), *_SQUARE[1:3]), ((0, 1, 2),))
    loaded: Any = trimesh.load(file, file_type="ply", process=False)
    return f"bounds {loaded.bounds[0].tolist()}"


def _claims_of_a_header_are_believed() -> str:
    """By plyfile, which only the tests need."""
    try:
        from plyfile import PlyData
    except ImportError:
        return NOT_INSTALLED
    text = f"ply\nformat binary_little_endian 1.0\nelement vertex {_CLAIMED}\n"
    text += "property float x\nproperty float y\nproperty float z\nend_header\n"
    PlyData.read(io.BytesIO(text.encode() + bytes(12)))  # there is one vertex
    return "read"


# --- numpy, scipy, pandas, torch ------------------------------------------------------------------


def _warned(warnings_seen: list[warnings.WarningMessage]) -> str:
    return f"a {warnings_seen[0].category.__name__}" if warnings_seen else "no warning"


def _claims_of_an_npy_are_believed() -> str:
    file = io.BytesIO()
    header = {"descr": "<f4", "fortran_order": False, "shape": (_CLAIMED, 3)}
    np.lib.format.write_array_header_1_0(file, header)  # and no values at all
    file.seek(0)
    np.load(file)
    return "read"


def _nan_becomes_a_pixel() -> str:
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        pixel = np.array([np.nan]).astype(np.uint8)[0]
    return f"pixel {pixel}, {_warned(seen)}"


def _half_precision_moments_overflow() -> str:
    with np.errstate(over="ignore"):
        return f"variance {np.array([-1000, 1000], np.float16).var()} of -1000 and 1000"


def _decomposition_names_no_cause() -> str:
    return str(np.linalg.svd(np.full((2, 2), np.nan), compute_uv=False))


def _matrix_root_turns_complex() -> str:
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


def _neighbour_that_is_not_there() -> str:
    from scipy.spatial import cKDTree

    distance, index = cKDTree(np.zeros((1, 3))).query(np.zeros(3), k=[2])
    return f"neighbour {np.ravel(index)[0]} of 1 point, at {np.ravel(distance)[0]}"


def _tree_without_end() -> str:
    import torch
    from scipy.spatial import KDTree

    points = np.random.default_rng(0).uniform(size=(100, 3))
    points[:60, 0] = 0.0
    points[60:, 0] *= 4.0
    torch.set_flush_denormal(True)
    return f"a tree of {KDTree(points).n} points"


def _bootstrap_of_equal_values() -> str:
    from scipy.stats import bootstrap

    with warnings.catch_warnings(), np.errstate(invalid="ignore"):
        warnings.simplefilter("ignore")
        found = bootstrap((np.ones(5),), np.mean, rng=np.random.default_rng(0))
    return f"interval {found.confidence_interval.low} to {found.confidence_interval.high}"


def _failures_leave_the_mean() -> str:
    import pandas as pd

    frame = pd.DataFrame({"object": ["a", "a", "b"], "score": [1.0, np.nan, np.nan]})
    return f"means {frame.groupby('object')['score'].mean().to_dict()}, {frame['score'].mean()}"


def _nan_becomes_a_pixel_of_torch() -> str:
    import torch

    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        pixel = int(torch.tensor([float("nan")]).to(torch.uint8)[0])
    return f"pixel {pixel}, {_warned(seen)}"


def _mirrored_arrays_are_refused() -> str:
    import torch

    return f"{torch.from_numpy(np.arange(3)[::-1]).tolist()}"


# --- scikit-image ---------------------------------------------------------------------------------


def _similarity(a: NDArray[Any], b: NDArray[Any], **options: Any) -> str:
    """By scikit-image, which only the tests need."""
    try:
        from skimage.metrics import structural_similarity
    except ImportError:
        return NOT_INSTALLED
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the range is guessed
        return f"ssim {float(structural_similarity(a, b, gaussian_weights=True, **options))}"  # type: ignore[arg-type]


def _range_is_guessed() -> str:
    return _similarity(np.zeros((16, 16), np.int64), np.full((16, 16), 255, np.int64))


def _nan_pixel_is_accepted() -> str:
    broken = np.full((16, 16), 0.5)
    broken[8, 8] = np.nan
    return _similarity(np.full((16, 16), 0.5), broken, data_range=1.0)


def _small_images_are_refused() -> str:
    image = np.zeros((10, 10), np.uint8)
    return _similarity(image, image, data_range=255)


# --- the table ------------------------------------------------------------------------------------

# What ends its worker comes first: the others need not wait for the end, or for a new worker.
DEFECTS = (
    Defect(
        "apss-infinite-point-hangs",
        "pymeshlab",
        "one infinite point of 2,048: APSS never returns",
        _infinite_point_hangs,
        r"^timeout",
        "`surface.SurfaceApss.prepare`, which refuses such clouds, and by the time limit",
    ),
    Defect(
        "normals-of-no-neighbours-crash",
        "pymeshlab",
        "normals from 0 neighbours: a segmentation fault, where -1 raises",
        _crash_of_no_neighbours,
        r"^crash: the worker died \(SIG",
        "`surface.NORMAL_NEIGHBOURS`, which is 10, and workers that may die",
    ),
    Defect(
        "apss-negative-grid-crash",
        "pymeshlab",
        "a grid of -5 cells: APSS divides by 0 and ends the process",
        _crash_of_a_negative_grid,
        r"^crash: the worker died \(SIG",
        "`surface.SurfaceApss`, whose grid is a constant, and workers that may die",
    ),
    Defect(
        "header-believed-ply",
        "plyfile",
        "a PLY of 200 bytes that claims 1.5e8 vertices: memory is taken for all of them",
        _claims_of_a_header_are_believed,
        rf"^memory|MemoryError|^{NOT_INSTALLED}$",
        "`cloud_files.load_points`, which reads by hand, and by the memory limit",
    ),
    Defect(
        "header-believed-npy",
        "numpy",
        "an NPY of 128 bytes that claims 1.5e8 rows: memory is taken for all of them",
        _claims_of_an_npy_are_believed,
        r"^memory|MemoryError",
        "`cloud_files.load_points`, which compares the claim with the file first",
    ),
    Defect(
        "apss-nan-vertices-from-a-clean-box",
        "pymeshlab",
        "clean points of a box: APSS writes vertices that are not finite",
        _clean_box_gives_nan,
        r"^[1-9]\d* of \d+ vertices are not finite",
        "`stages.finite_part`: their faces are dropped, and counted in the notes",
    ),
    Defect(
        "apss-reads-unwritten-memory",
        "pymeshlab",
        "the result of APSS depends on what memory held before",
        _memory_shows_through,
        r"^(\w{8}) and \1 over noughts, (?!\1)\w{8} over another fill$",
        "`isolation.WORKER_ENVIRONMENT`: all workers get memory filled alike",
    ),
    Defect(
        "apss-coplanar-points-nothing",
        "pymeshlab",
        "points of one plane: APSS returns an empty mesh without a word",
        _coplanar_points_give_nothing,
        r"^[1-9]\d* faces from ball pivoting, 0 from APSS",
        "`surface.SurfaceApss.prepare`: the stage `apss` fails with no faces",
    ),
    Defect(
        "apss-far-from-the-origin",
        "pymeshlab",
        "a box shifted by 1e6: APSS writes thousands of vertices that are not finite",
        _shifted_cloud_breaks,
        r"^\d{3,} of \d+ vertices are not finite",
        "`normalise.normalise_points`: clouds are centred first",
    ),
    Defect(
        "apss-blob-of-16-points",
        "pymeshlab",
        "16 points, and half the resolution: APSS makes a mesh of tens of thousands of faces",
        _few_points_make_a_blob,
        r"^\d{5,} faces",
        "`isolation.Limits`, which bound what it takes; the score says what it is worth",
    ),
    Defect(
        "normals-hide-what-is-not-finite",
        "pymeshlab",
        "an infinite point or NaN: normals are finite, and ball pivoting loses faces in silence",
        _normals_hide_what_is_not_finite,
        r"^finite normals; \d{1,3} and \d{1,3} faces, where the clean cloud has \d{4}$",
        "`surface.SurfaceApss.prepare`: the points are checked before the first filter",
    ),
    Defect(
        "ball-pivoting-of-one-place",
        "pymeshlab",
        "2,048 points that coincide: ball pivoting makes faces of them",
        _one_place_has_faces,
        r"^[1-9]\d* faces of points that coincide",
        "`surface.SurfaceApss.prepare`: of such faces APSS makes none, and the stage `apss` fails",
    ),
    Defect(
        "ball-pivoting-of-a-line",
        "pymeshlab",
        "points of one line: ball pivoting makes no face and says nothing",
        _a_line_has_none,
        r"^0 faces",
        "`surface.SurfaceApss.prepare`: the stage `ball-pivoting` fails with no faces",
    ),
    Defect(
        "close-holes-without-faces",
        "pymeshlab",
        "no faces: closing holes raises, where there is nothing to do",
        _no_faces_no_holes,
        r"^raises RuntimeError: .*does not have",
        "`surface.SurfaceApss.prepare`: faces are counted before, and errors carry their stage",
    ),
    Defect(
        "ball-pivoting-depends-on-the-order",
        "pymeshlab",
        "the same points in reverse: ball pivoting makes another mesh",
        _order_matters,
        r"^(\d+) faces, (?!\1 )\d+ of the same points in reverse$",
        "`sampling.sample_surface`: the order of the points is seeded with them",
    ),
    Defect(
        "integer-background-black",
        "pyrender",
        "a white background in integers comes out black",
        _integers_are_black,
        r"^background [01], and 255 from floats",
        "`render.render`, which clears by OpenGL itself, in floats",
    ),
    Defect(
        "numpy-2-unknown",
        "pyrender",
        "the extent of a scene reads np.infty, which NumPy 2 has not",
        _numpy_2_is_unknown,
        r"^raises AttributeError: .*np\.infty",
        "`render.render`, which makes no scene of pyrender's",
    ),
    Defect(
        "nan-vertex-vanishes",
        "pyrender",
        "a face with a NaN vertex is not drawn, without a word",
        _nan_vertex_vanishes,
        r"^0 of 1024 pixels drawn, without the NaN [1-9]\d* of",
        "`render.render`, which refuses such meshes by name",
    ),
    Defect(
        "index-out-of-range-drawn",
        "pyrender",
        "a face with a vertex that is not there is drawn with whatever is found in its place",
        _index_out_of_range_is_drawn,
        r"^\d+ of 1024 pixels drawn|^crash",  # what is found depends on the driver
        "`scene.Mesh`, which refuses such faces by name",
    ),
    Defect(
        "renderers-share-a-display",
        "pyrender",
        "deleting one of two renderers breaks the other",
        _renderers_share_a_display,
        r"^the other one raises EGLError",
        "`render._context`: one context a process, deleted only at its exit",
    ),
    Defect(
        "vertices-merged",
        "trimesh",
        "loading merges equal vertices by default, and changes the surface",
        _vertices_are_merged,
        r"^4 of 6 vertices",
        "`mesh_files.load_mesh`: process=False",
    ),
    Defect(
        "points-are-no-mesh",
        "trimesh",
        "a PLY of points only loads as an empty mesh, without a word",
        _points_are_no_mesh,
        r"^a Trimesh of 0 vertices",
        "`mesh_files.load_mesh`, which says that a bare cloud cannot be scored",
    ),
    Defect(
        "index-out-of-range-kept",
        "trimesh",
        "a face may name a vertex that is not there",
        _index_out_of_range_is_kept,
        r"\[0, 1, 99\] of 3$",
        "`scene.Mesh`, which refuses such faces by name",
    ),
    Defect(
        "nan-vertex-kept",
        "trimesh",
        "NaN loads as a coordinate, without a word",
        _nan_vertex_is_kept,
        r"^bounds \[nan",
        "`normalise.normalise`, which refuses such meshes by name",
    ),
    Defect(
        "nan-becomes-a-pixel",
        "numpy",
        "NaN cast to uint8 is some number, with no more than a warning",
        _nan_becomes_a_pixel,
        r"^pixel \d+, a RuntimeWarning$",
        "`work._checked`, which fails pictures that are not finite",
    ),
    Defect(
        "half-precision-moments-overflow",
        "numpy",
        "the variance of float16 values overflows from 256 on",
        _half_precision_moments_overflow,
        r"^variance inf",
        "`frechet._checked`, before any arithmetic",
    ),
    Defect(
        "decomposition-names-no-cause",
        "numpy",
        "singular values of NaN: 'did not converge', which names no cause",
        _decomposition_names_no_cause,
        r"^raises LinAlgError: SVD did not converge",
        "`frechet._checked`, which counts the values that are not finite first",
    ),
    Defect(
        "matrix-root-complex",
        "scipy",
        "sqrtm for identical sets of 20 rows and 256 features: a complex or negative distance",
        _matrix_root_turns_complex,
        r"^(complex|negative): ",
        "`frechet.centred_to_frechet`: singular values of the features, and no covariance",
    ),
    Defect(
        "tree-of-half-a-plane-crash",
        "scipy",
        "KDTree steps from a median of 0 to a denormal number; flushed to 0, that goes on for ever",
        _tree_without_end,
        r"^crash: the worker died \(SIG",
        "`losses.chamfer`, which splits in the middle: trainings flush denormals",
    ),
    Defect(
        "neighbour-that-is-not-there",
        "scipy",
        "the second neighbour in a tree of one point: an index out of range, at infinity",
        _neighbour_that_is_not_there,
        r"^neighbour 1 of 1 point, at inf$",
        "`splat.Splat.prepare`, which does not ask for it",
    ),
    Defect(
        "bootstrap-of-equal-values",
        "scipy",
        "equal values: the default bootstrap has no interval",
        _bootstrap_of_equal_values,
        r"^interval nan to nan",
        "`statistics.mean_interval`: percentiles, and equal values are their own interval",
    ),
    Defect(
        "failures-leave-the-mean",
        "pandas",
        "means leave NaN out, without a word",
        _failures_leave_the_mean,
        r"^means \{'a': 1\.0, 'b': nan\}, 1\.0$",
        "`tables`: n_ok of n stands beside every mean, and failures are also scored as blank",
    ),
    Defect(
        "nan-becomes-a-pixel-torch",
        "torch",
        "NaN cast to uint8 is some number, without a word",
        _nan_becomes_a_pixel_of_torch,
        r"^pixel \d+, no warning$",
        "`work._checked`, which fails pictures that are not finite",
    ),
    Defect(
        "mirrored-arrays-refused",
        "torch",
        "arrays with negative strides, a mirrored picture say, are refused",
        _mirrored_arrays_are_refused,
        r"^raises ValueError: .*negative",
        "`views_network.view_features`, which copies them",
    ),
    Defect(
        "range-guessed",
        "scikit-image",
        "black and white in int64: the range is guessed from the type, and they are alike",
        _range_is_guessed,
        rf"^(ssim 1\.0|{NOT_INSTALLED})$",
        "`ssim._require_images`: uint8 only",
    ),
    Defect(
        "nan-pixel-accepted",
        "scikit-image",
        "a NaN pixel: SSIM is NaN, without a word",
        _nan_pixel_is_accepted,
        rf"^(ssim nan|{NOT_INSTALLED})$",
        "`ssim._require_images`: uint8 only",
    ),
    Defect(
        "small-images-refused",
        "scikit-image",
        "images with a side below the window of 11 are refused",
        _small_images_are_refused,
        rf"^(raises ValueError: win_size exceeds|{NOT_INSTALLED}$)",
        "`ssim._window`, which shrinks",
    ),
)
