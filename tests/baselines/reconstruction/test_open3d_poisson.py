from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError
from importlib.util import find_spec

import numpy as np
import pytest

from baselines.reconstruction.open3d_poisson import Open3dPoisson
from bench.catalogue.loaders import open3d_identity
from data_prep.clouds.sampling import face_areas
from data_prep.failures import MissingDependency, StageFailure
from data_prep.scene import PointCloud
from tests.baselines.clouds import RADIUS, lattice_sphere

needs_open3d = pytest.mark.skipif(
    find_spec("open3d") is None, reason="Open3D is not installed (extra [open3d])"
)


def test_without_open3d_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(MissingDependency, match=r"pip install 'pc2pix-bench\[open3d\]'"):
        Open3dPoisson().prepare(PointCloud(lattice_sphere()))


def installed(*packages: str) -> Callable[[str], str]:
    """Return what gives the version 7.8 for these packages, and finds no others."""

    def version(package: str) -> str:
        if package not in packages:
            raise PackageNotFoundError(package)
        return "7.8"

    return version


@pytest.mark.parametrize("package", ["open3d-cpu", "open3d"])
def test_the_version_is_that_of_either_package(package: str) -> None:
    identity = open3d_identity(installed(package))
    assert re.fullmatch(r"embreex \S+, open3d 7\.8, scipy \S+", identity)


def test_a_run_without_open3d_is_refused_before_any_work() -> None:
    with pytest.raises(MissingDependency, match=r"^Open3D is not installed: .*\[open3d\]"):
        open3d_identity(installed())


@needs_open3d
def test_a_sphere_and_outliers() -> None:
    points = np.append(lattice_sphere(), [[3, 0, 0], [0, 3, 0]], axis=0)
    first, again = (Open3dPoisson(depth=6).prepare(PointCloud(points)) for _ in range(2))
    assert first.notes[0] == "outliers: 2 of 2050 points removed"
    # As of baselines.reconstruction.poisson; up to a twentieth of the vertices is trimmed, with
    # their faces.
    error = np.linalg.norm(first.mesh.vertices.astype(np.float64), axis=1) - RADIUS
    assert np.abs(error).max() < 0.02
    assert 0.85 < face_areas(first.mesh).sum() / (4 * math.pi * RADIUS**2) < 1.0
    assert first.mesh.vertices.tobytes() == again.mesh.vertices.tobytes()
    assert first.mesh.faces.tobytes() == again.mesh.faces.tobytes()


@needs_open3d
@pytest.mark.parametrize(
    ("points", "stage"),
    [
        (np.zeros((50, 3)), "input"),
        (np.linspace(-1, 1, 500)[:, None] * [1, 0, 0], "normals"),
        ([*lattice_sphere(100), [np.nan, 0, 0]], "input"),
    ],
)
def test_degenerate_clouds_fail_by_name(points, stage: str) -> None:
    with pytest.raises(StageFailure) as failure:
        Open3dPoisson().prepare(PointCloud(points))
    assert failure.value.stage == stage
