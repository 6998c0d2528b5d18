"""Files that nobody in this project made; their manifest is the independent witness."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from data_prep.datasets.registry import open_dataset
from data_prep.files.meshes import load_mesh
from data_prep.rendering.opengl import render
from data_prep.scene import View

MESHES = Path(__file__).parents[3] / "shared" / "meshes"
pytestmark = [
    pytest.mark.opengl,
    pytest.mark.skipif(
        not (MESHES / "manifest.csv").is_file(), reason="needs the real meshes in ../shared/meshes"
    ),
]

ROUNDING = float(np.finfo(np.float32).eps)  # see test_normalise
VIEW = View(30, 20)


@pytest.fixture(scope="module")
def manifest() -> list[dict[str, str]]:
    with (MESHES / "manifest.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_every_mesh_loads_and_renders(manifest: list[dict[str, str]]) -> None:
    rows = [row for row in manifest if row["kind"] == "mesh"]
    assert len(rows) == 107
    for row in rows:
        what = row["file"]
        mesh = load_mesh(MESHES / what)
        assert len(mesh.faces) == int(row["faces"]), what
        assert len(mesh.vertices) == int(row["vertices"]), what
        shades = np.unique(mesh.face_colors, axis=0)
        assert len(shades) == int(row["distinct_colours"]), what
        used = mesh.vertices[np.unique(mesh.faces)].astype(np.float64)
        assert np.abs(used.min(axis=0) + used.max(axis=0)).max() <= 2 * ROUNDING, what
        assert abs(np.linalg.norm(used, axis=1).max() - 1) <= ROUNDING, what
        (image,) = render(mesh, [VIEW])
        assert (image[0] == 255).all(), what  # the unit sphere leaves a margin of 4 pixels
        assert (image[:, [0, -1]] == 255).all(), what
        covered = (image < 255).any(axis=2).mean()
        assert 0.005 < covered < 0.70, what  # the sphere itself covers 0.69


def test_the_folder_is_a_dataset_of_classes(manifest: list[dict[str, str]]) -> None:
    dataset = open_dataset(f"folder:{MESHES}")
    classes = {row["class"] for row in manifest}
    assert set(dataset.classes) - {"pointclouds"} == classes
    assert len(dataset.objects("chair", None, 0)) == 20
    assert len({obj.fingerprint() for obj in dataset.finite}) == len(dataset.finite) == 110
