"""Properties of every method that is compared, whatever it does: each is a `Renderer`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from bench.catalogue.methods import BUNDLED, FLOORS, find_method
from bench.running.pool import WORKER_ENVIRONMENT
from data_prep.failures import StageFailure
from data_prep.rendering.images import to_float
from data_prep.rendering.mesh import draw_mesh
from data_prep.scene import PointCloud, View

from .clouds import chair_cloud, lattice_sphere

LEFT_OUT = () if find_spec("open3d") else ("open3d-poisson",)  # Open3D is an extra
SURFACES = tuple(m.id for m in BUNDLED if m.kind == "reconstruction" and m.id not in LEFT_OUT)
NETWORKS = (
    *("pc2pix", "pc2pix@acgan", "splat-net@chair"),
    *("splat-net", "points2pix", "occupancy-net", "upsampled-wrap", "fused-net"),
)
METHODS = (*SURFACES, *NETWORKS, "splat", "splat-fill", "true-mesh", *FLOORS)
ORDERLESS = (
    *("surface-fit", "alpha-wrap", "denoised-wrap"),
    *("splat-net", "splat", "splat-fill", "occupancy-net", "upsampled-wrap", "fused-net"),
)
# How far `features` may move on another machine. Where meshes are drawn, another driver or
# ray-caster samples edges elsewhere: a turn of all views by 0.1 degree, as in
# bench/check/tolerances.py, moves them by up to 1.2e-4 (`open3d-poisson`). Another
# processor rounds elsewhere, and MeshLab's normals are ill-conditioned: points moved to a
# neighbouring float32, or not, at random, do it by up to 8.5e-5 (`poisson`). Three times the larger
# is allowed. Other methods move by up to 1.2e-5 (`splat-net`), and by 6e-7 with the kernels of
# other processors. `surface-apss` moves by 2.3e-3, and with what memory held before.
DRAWS_MESHES = (*SURFACES, "true-mesh", "occupancy-net", "upsampled-wrap", "fused-net")
MOVES = dict.fromkeys(METHODS, 5e-5) | dict.fromkeys(DRAWS_MESHES, 3.6e-4) | {"surface-apss": 5e-3}
# `features` of the images of a clean cloud and, for some, of a noisy one.
VALUES: dict[str, list[tuple[float, float]]] = {
    "surface-apss": [(0.926755, 0.014446)],
    "surface-fit": [(0.936266, 0.012420), (0.874128, 0.017982)],
    "surface-bpa": [(0.958528, 0.011360)],
    "open3d-poisson": [(0.898259, 0.012832)],
    "poisson": [(0.960928, 0.011426)],
    "alpha-wrap": [(0.948896, 0.010081), (0.887121, 0.010762)],
    "denoised-wrap": [(0.948896, 0.010081), (0.943155, 0.006693)],
    "pc2pix": [(0.896597, 0.013476)],
    "pc2pix@acgan": [(0.924630, 0.018089)],
    "splat-net@chair": [(0.917226, 0.014813)],
    "splat-net": [(0.945244, 0.008798), (0.938382, 0.007316)],
    "points2pix": [(0.931353, 0.010579)],
    "occupancy-net": [(0.947588, 0.009339), (0.943953, 0.011252)],
    "upsampled-wrap": [(0.951017, 0.009987), (0.934430, 0.010730)],
    "fused-net": [(0.945698, 0.009295), (0.943117, 0.008453)],
    "splat": [(0.946857, 0.014528), (0.879335, 0.012321)],
    "splat-fill": [(0.948743, 0.007210), (0.948035, 0.004531)],
    "true-mesh": [(0.918969, 0.011765)],
    "constant": [(0.928061, 0.000498)],
    "blank": [(1.000000, 0.000000)],
}
# Other kernels add in another order. A convolution of pc2pix adds up to 16 * 256 products, and
# their sum is off by some sqrt(4096) * 2^-24 = 4e-6 of its terms. Ten layers follow each other:
# 4e-5, a hundredth of a grey level.
ROUNDING = 0.01 / 255
VIEWS = [View(10, 20), View(370, 20), View(-100, -40), View(0, 90), View(30, -90)]


def features(images: np.ndarray) -> tuple[float, float]:
    """The mean of images, and of how much neighbours in a row differ."""
    return float(images.mean()), float(np.abs(np.diff(images, axis=2)).mean())


@pytest.fixture(scope="module")
def cloud() -> PointCloud:
    return chair_cloud(1024)


@pytest.mark.parametrize("name", METHODS)
def test_images_of_any_views(cloud: PointCloud, name: str) -> None:
    method, rng = find_method(name).load("cpu"), np.random.default_rng(5)
    before, random = cloud.points.copy(), rng.bit_generator.state
    state = method.prepare(cloud, rng)
    images = method.draw(state, VIEWS, rng)
    assert images.shape == (len(VIEWS), 128, 128, 3)
    assert images.dtype == np.float32
    assert images.min() >= 0  # and none is NaN
    assert images.max() <= 1
    assert (find_method(name).color == "none") == bool((images == images[..., :1]).all())
    # a turn of 360 degrees is none; the angle that networks are given is rounded to float32
    np.testing.assert_allclose(images[1], images[0], rtol=0, atol=ROUNDING)
    assert (name in FLOORS) == np.array_equal(images[0], images[2])
    assert method.draw(state, [], rng).shape == (0, 128, 128, 3)
    # a view by itself, for which other kernels may serve
    for i in (2, 4):
        alone = method.draw(state, VIEWS[i : i + 1], rng)
        np.testing.assert_allclose(alone[0], images[i], rtol=0, atol=ROUNDING)
    assert rng.bit_generator.state == random, "chance is used"
    np.testing.assert_array_equal(cloud.points, before)
    if name in SURFACES:
        np.testing.assert_array_equal(images, to_float(draw_mesh(state.mesh, VIEWS)))
    # `surface-apss` reads unwritten memory in a process that is no worker: see tests/upstream
    if name not in ("true-mesh", "surface-apss"):  # the mesh behind the cloud is not looked at
        bare = method.prepare(PointCloud(cloud.points), rng)
        np.testing.assert_array_equal(method.draw(bare, VIEWS, rng), images)
    assert features(images) == pytest.approx(VALUES[name][0], abs=MOVES[name])


@pytest.mark.parametrize("name", ORDERLESS)
def test_neither_order_nor_repeated_points_matter(name: str) -> None:
    rng = np.random.default_rng(0)
    points = chair_cloud(512).points
    points = (points + rng.normal(scale=0.1, size=points.shape)).astype(np.float32)
    changed = rng.permutation(points if name == "splat" else np.repeat(points, 2, axis=0))
    method = find_method(name).load("cpu")
    states = [method.prepare(PointCloud(some), rng) for some in (points, changed)]
    images, others = (method.draw(state, VIEWS, rng) for state in states)
    np.testing.assert_array_equal(images, others)
    assert features(images) == pytest.approx(VALUES[name][1], abs=MOVES[name])
    if name in SURFACES:
        first, second = states
        np.testing.assert_array_equal(first.mesh.vertices, second.mesh.vertices)
        np.testing.assert_array_equal(first.mesh.faces, second.mesh.faces)
        assert first.notes == second.notes


@pytest.mark.parametrize("name", [n for n in METHODS if n not in (*FLOORS, "true-mesh")])
@pytest.mark.parametrize(
    "points",
    [np.empty((0, 3)), [[0, 0, np.nan]] * 20, [*[[0, 0, 1]] * 20, [0, -np.inf, 0]]],
    ids=["empty", "nan", "infinite"],
)
def test_impossible_clouds_fail_by_name(name: str, points) -> None:
    method = find_method(name).load("cpu")
    with pytest.raises(StageFailure) as failure:
        method.prepare(PointCloud(points), np.random.default_rng(0))
    assert failure.value.stage == ("encode" if name.startswith("pc2pix") else "input")
    assert "\n" not in failure.value.problem


LINE, PLANE = np.linspace(-1, 1, 500)[:, None] * [1, 0, 0], lattice_sphere(500) * [1, 1, 0]
TEN_PLACES = np.repeat(lattice_sphere(10), 5, axis=0)
AWAY = TEN_PLACES + np.array([9, 0, 0])
FEW_DIFFERENT = "points are different and nearer than the camera; surfaces need at least 11"
FEW = "where the camera looks, one for each grid cell; normals need at least 11"


@pytest.mark.parametrize(
    ("name", "points", "stage", "problem"),
    [
        ("alpha-wrap", TEN_PLACES, "input", f"10 of 50 {FEW_DIFFERENT}"),
        ("denoised-wrap", TEN_PLACES, "input", f"10 of 50 {FEW_DIFFERENT}"),
        ("denoised-wrap", AWAY, "input", f"0 of 50 {FEW_DIFFERENT}"),
        ("denoised-wrap", np.full((50, 3), 0.3), "input", f"1 of 50 {FEW_DIFFERENT}"),
        ("occupancy-net", np.full((5, 3), 9.0), "input", "0 of 5 points are different"),
        ("poisson", LINE, "ball-pivoting", "no faces"),
        ("poisson", np.full((50, 3), 0.3), "poisson", ""),
        ("surface-apss", np.full((50, 3), 0.3), "apss", "no faces"),
        ("surface-apss", LINE, "ball-pivoting", "no faces"),
        ("surface-apss", np.zeros((10, 3)), "input", "10 points; normals need at least 11"),
        ("surface-apss", [[np.inf, 0, np.nan], *LINE], "input", "1 of 501 points are not finite"),
        ("surface-bpa", LINE, "ball-pivoting", "no faces"),
        ("surface-fit", np.zeros((10, 3)), "input", "10 points; normals need at least 11"),
        ("surface-fit", TEN_PLACES, "input", f"10 of 50 points are left {FEW}"),
        ("surface-fit", AWAY, "input", f"0 of 50 points are left {FEW}"),
        ("surface-fit", LINE, "ball-pivoting", "no faces"),
        ("surface-fit", PLANE, "apss", "no faces"),
        ("upsampled-wrap", TEN_PLACES, "input", f"10 of 50 {FEW_DIFFERENT}"),
        ("upsampled-wrap", AWAY, "input", f"0 of 50 {FEW_DIFFERENT}"),
        ("upsampled-wrap", [[np.inf, 0, np.nan], *LINE], "input", "1 of 501 points are not finite"),
    ],
)
def test_degenerate_clouds_fail_by_name(name: str, points, stage: str, problem: str) -> None:
    with pytest.raises(StageFailure) as failure:
        find_method(name).load("cpu").prepare(PointCloud(points), np.random.default_rng(0))
    assert failure.value.stage == stage
    assert problem in failure.value.problem


DIGESTS = """
import hashlib, json, sys
import numpy as np
from bench.catalogue.methods import BUNDLED, FLOORS, find_method
from data_prep.scene import View
from tests.baselines.clouds import chair_cloud
cloud = chair_cloud(1024)
found = {}
for name in sys.argv[1:]:
    method = find_method(name).load("cpu")
    rng = np.random.default_rng(int(name == "splat"))
    images = method.draw(method.prepare(cloud, rng), [View(10, 20), View(-100, 0)], rng)
    found[name] = hashlib.sha256(images.tobytes()).hexdigest()
print(json.dumps(found))
"""
ANY_THREADS = (*SURFACES, "splat", "splat-fill", "true-mesh")  # networks sum in another order


@pytest.mark.slow
def test_same_bytes_in_any_process_with_any_number_of_threads() -> None:
    """Processes like the workers of a run, with one thread and with two, draw the same; so does
    `surface-fit` whatever memory held before, unlike `surface-apss`: see tests/upstream."""

    def digests(names, environment):
        done = subprocess.run(
            [sys.executable, "-c", DIGESTS, *names],
            env=os.environ | environment,
            capture_output=True,
            text=True,
            timeout=200,
            check=True,
            cwd=Path(__file__).parents[2],
        )
        return json.loads(done.stdout.splitlines()[-1])

    actual, threaded = (
        digests(ANY_THREADS, {**WORKER_ENVIRONMENT, "OMP_NUM_THREADS": n, "LP_NUM_THREADS": n})
        for n in ("1", "2")
    )
    assert actual == threaded
    tunables = {"GLIBC_TUNABLES": "glibc.malloc.perturb=170:glibc.malloc.tcache_count=0"}
    assert digests(["surface-fit"], tunables) == {"surface-fit": actual["surface-fit"]}
